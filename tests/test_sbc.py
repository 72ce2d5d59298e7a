"""Simulation-based calibration (Talts et al. 2018) of the model's own posterior: is what it says of what it draws true?

Distances are drawn from the prior, spectra from the texture prior, annular powers from the gamma distribution; the
share of the posterior below the truth must be uniform, and 95 % intervals must cover 95 %.

    python -m pytest -m campaign tests/test_sbc.py -s

does a thousand trials of the grid and of emcee, in about half an hour. Two controls must fail: noise that is believed
10 % too small, and walkers that start at one of two modes.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy import stats

from psflut import chain, evidence, texture
from psflut.candidates import solve, solve_all
from psflut.density import Density
from psflut.estimators.posterior import Posterior
from psflut.evidence import Bank
from psflut.grid import Grid
from psflut.imagers.plain import Plain
from psflut.noise import Noise
from psflut.optics import Camera
from psflut.psfs.pupil import Pupil
from psflut.table import PSFTable

SIGMA, TOO_SMALL, BATCH, WALKERS = 0.005, 0.9, 50, Posterior().walkers
REJECTED, COVERS = 0.001, (0.926, 0.971)


@dataclass(frozen=True)
class Trials:
    """What the model drew: the bank, noise powers (K,), true even coordinates (n,), spectra (n, J), powers (n, K)."""

    bank: Bank
    noise: np.ndarray
    even: np.ndarray
    theta: np.ndarray
    power: np.ndarray


def drawn(table, count, seed):
    """Trials of a table; no patch is discounted, as all suit the model."""
    rng, prior = np.random.default_rng(seed), replace(texture.learnt().over(texture.SECTORS), misfit=texture.EVERY)
    bank = evidence.bank(table, (128, 128), Plain(), prior, 100, texture.SECTORS)
    noise = evidence.noise_power(bank, Noise(SIGMA), 0.0)
    even = rng.uniform(bank.even.min(), bank.even.max(), count)
    theta = rng.multivariate_normal(prior.mean, prior.covariance, count)
    mean = evidence.scene_power(bank.at(even), theta, bank) + noise
    return Trials(bank, noise, even, theta, rng.gamma(bank.shape, mean / bank.shape))


def shares_of_the_grid(trials, believed=1.0):
    """Posterior probability below each truth, (n,), the noise believed to be so many times its sigma."""
    noise, out = np.tile(believed**2 * trials.noise, (BATCH, 1)), []
    for first in range(0, len(trials.even), BATCH):
        power, truth = trials.power[first : first + BATCH], trials.even[first : first + BATCH]
        for found, even in zip(solve_all(power, noise[: len(power)], trials.bank), truth, strict=True):
            density = Density(found.even, found.fit.log_evidence, np.asarray)
            out.append(np.interp(even, density.nodes, density.cumulative))
    return np.array(out)


def found_by_the_grid(trials, k):
    """The grid of a trial, for a table without errors."""
    even, fit, bank, misfit = solve(trials.power[k], trials.noise, trials.bank)
    exact = Density(even, fit.log_evidence, np.asarray)
    return Grid(bank, even, trials.power[k], trials.noise, fit, exact, np.zeros_like, exact, misfit)


def shares_of_emcee(trials, rng):
    """The same of (distance, first coefficients of the spectrum), from draws an autocorrelation time apart: (n, 4)."""
    out = []
    for k, (even, theta) in enumerate(zip(trials.even, trials.theta, strict=True)):
        walk = chain.sample(found_by_the_grid(trials, k), 4000, WALKERS, k)
        kept = walk.points[:: int(np.ceil(2 * walk.times.max()))].reshape(-1, walk.points.shape[2])[:, :4]
        below = np.sum(kept < np.r_[even, theta[:3]], axis=0)
        out.append((below + rng.random(4)) / (len(kept) + 1))
    return np.array(out)


def shares_from_one_mode(trials, rng):
    """The control: differential evolution alone, from walkers about the best place on one side of focus."""
    import emcee

    out = []
    for k, even in enumerate(trials.even):
        found = found_by_the_grid(trials, k)
        side = np.flatnonzero(np.sign(found.even) == rng.choice([-1, 1]))
        best = side[np.argmax(found.fit.log_evidence[side])]
        start = np.r_[found.even[best], found.fit.theta[best]] + 1e-4 * rng.standard_normal(
            (WALKERS, 1 + found.fit.theta.shape[1])
        )
        start[:, 0] = np.clip(start[:, 0], found.even.min(), found.even.max())
        sampler = emcee.EnsembleSampler(
            *start.shape, chain.log_probability(found, False), moves=emcee.moves.DEMove(), vectorize=True
        )
        sampler.run_mcmc(emcee.State(start, random_state=np.random.RandomState(k).get_state()), 400)
        out.append(np.mean(sampler.get_chain(discard=100, flat=True)[:, 0] < even))
    return np.array(out)


def two_sided():
    """A table on both sides of focus, of a lens with so little aberration that patches hardly tell them apart."""
    camera = Camera.of(0.016, 6e-6, aperture_diameter=0.008, focus_distance=0.3)
    lens = Pupil(((4, 0, 0.02),), (470e-9, 550e-9, 630e-9))
    axis = np.linspace(-0.025, 0.025, 41)
    return PSFTable(axis, np.stack([lens(camera, 0.3 + z, 31) for z in axis]), camera.pixel_pitch, kind="stage")


def judged(name, shares):
    """p of uniform shares (Kolmogorov and Smirnov), and how many 95 % intervals cover; both printed."""
    p, covers = stats.kstest(shares, "uniform").pvalue, np.mean(np.abs(shares - 0.5) <= 0.475)
    print(f"\n{name}: {len(shares)} trials, p {p:.2g}, 95 % intervals cover {100 * covers:.1f} %")
    return p, covers


def test_the_grid_is_calibrated_and_wrong_noise_is_caught(lab16mm):
    trials = drawn(lab16mm, 300, 1)
    p, covers = judged("grid", shares_of_the_grid(trials))
    assert p > REJECTED
    assert abs(covers - 0.95) < 3.5 * np.sqrt(0.95 * 0.05 / 300)
    assert judged("grid, noise believed 10 % too small", shares_of_the_grid(trials, TOO_SMALL))[0] < REJECTED


@pytest.mark.campaign
def test_a_thousand_trials_of_the_grid(lab16mm):
    trials = drawn(lab16mm, 1000, 2)
    p, covers = judged("grid", shares_of_the_grid(trials))
    assert p > REJECTED
    assert COVERS[0] <= covers <= COVERS[1]
    assert judged("grid, noise believed 10 % too small", shares_of_the_grid(trials, TOO_SMALL))[0] < REJECTED


@pytest.mark.campaign
def test_a_thousand_trials_of_emcee(lab16mm):
    shares = shares_of_emcee(drawn(lab16mm, 1000, 3), np.random.default_rng(3))
    p, covers = judged("emcee", shares[:, 0])
    assert p > REJECTED
    assert COVERS[0] <= covers <= COVERS[1]
    for j in range(3):
        assert judged(f"emcee, theta {j}", shares[:, 1 + j])[0] > REJECTED


@pytest.mark.campaign
def test_both_sides_of_focus():
    trials = drawn(two_sided(), 250, 4)
    rng = np.random.default_rng(4)
    assert judged("grid, across focus", shares_of_the_grid(trials))[0] > REJECTED
    assert judged("emcee, across focus", shares_of_emcee(trials, rng)[:, 0])[0] > REJECTED
    assert judged("walkers at one mode", shares_from_one_mode(trials, rng))[0] < REJECTED
