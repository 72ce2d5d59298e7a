"""Candidates where they are needed, against the evidence at very many."""

from dataclasses import replace

import numpy as np
import pytest

from psflut import evidence, laplace, texture
from psflut.candidates import solve, solve_all
from psflut.capture import capture, psf_of
from psflut.density import Density
from psflut.imagers.plain import Plain
from psflut.kernels import climbing
from psflut.noise import Noise
from psflut.spectrum import annular_power

NOISE = Noise(0.005)
PROBABILITIES = [0.025, 0.16, 0.5, 0.84, 0.975]


@pytest.fixture(scope="module")
def bank(lab16mm):
    return evidence.bank(lab16mm, (128, 128), Plain(), texture.learnt(), 100)


@pytest.fixture(scope="module")
def powers(lab16mm, lab_patch):
    """(5, K) near and far, textured and almost blank."""
    rng = np.random.default_rng(5)
    shots = [
        capture(0.5 + contrast * (lab_patch - 0.5), psf_of(lab16mm, z), NOISE, rng, imager=Plain())
        for z, contrast in ((0.83, 1.0), (1.52, 1.0), (2.9, 1.0), (4.6, 1.0), (2.0, 0.03))
    ]
    return np.stack([annular_power(shot) for shot in shots])


def test_the_posterior_is_that_of_a_dense_grid(bank, powers):
    prior = replace(bank.prior, misfit=texture.EVERY)
    noise = evidence.noise_power(bank, NOISE, 0.5)
    even = np.linspace(bank.even.min(), bank.even.max(), 1500)
    dense = replace(bank, even=even, attenuation=bank.at(even), prior=prior)
    for power in powers:
        found = solve(power, noise, replace(bank, prior=prior))
        exact = Density(even, laplace.integrate(power, noise, dense).log_evidence, np.asarray)
        ours = Density(found.even, found.fit.log_evidence, np.asarray)
        width = np.ptp(exact.quantile([0.16, 0.84])) / 2
        np.testing.assert_allclose(ours.quantile(PROBABILITIES), exact.quantile(PROBABILITIES), atol=0.06 * width)


def test_patches_do_not_know_of_each_other(bank, powers):
    noise = np.tile(evidence.noise_power(bank, NOISE, 0.5), (len(powers), 1))
    together = solve_all(powers, noise, bank)
    for power, own, found in zip(powers, noise, together, strict=True):
        alone = solve(power, own, bank)
        np.testing.assert_allclose(found.even, alone.even)
        np.testing.assert_allclose(found.fit.log_evidence, alone.fit.log_evidence, atol=climbing.TOLERANCE)
        assert found.misfit == pytest.approx(alone.misfit)
