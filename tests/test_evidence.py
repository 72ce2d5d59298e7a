"""The heart, against independent calculations: quadrature, Wiener inversion, simulation from the model."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate, stats

from psflut import capture, evidence, laplace, restore, texture
from psflut.density import Density
from psflut.estimation import Problem
from psflut.fourier import once
from psflut.grid import grid
from psflut.imagers.laplacian import Laplacian
from psflut.imagers.plain import Plain
from psflut.kernels import climbing
from psflut.noise import Noise
from psflut.spectrum import annular_power, annuli


@pytest.fixture(scope="module")
def bank(lab16mm):
    return evidence.bank(lab16mm, (128, 128), Plain(), texture.learnt(), 100)


def test_laplace_agrees_with_quadrature(lab16mm, lab_patch):
    """Two coefficients only, so that the integral over the spectrum can be done by brute force."""
    prior = texture.learnt()
    small = replace(prior, mean=prior.mean[:2], covariance=prior.covariance[:2, :2])
    bank = evidence.bank(lab16mm, (128, 128), Plain(), small, 200)
    power = annular_power(lab_patch)
    noise = evidence.noise_power(bank, Noise(0.005), 0.5)
    fit = laplace.integrate(power, noise, bank)
    curvature = laplace.curvature_at(power, noise, bank.attenuation, fit.theta, bank)
    best = int(np.argmax(fit.log_evidence))
    exact = []
    for z in (best - 1, best, best + 1):
        sd = np.sqrt(np.diag(np.linalg.inv(curvature[z])))
        axes = [np.linspace(c - 9 * s, c + 9 * s, 301) for c, s in zip(fit.theta[z], sd, strict=True)]
        theta = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        log = evidence.log_joint(power, bank.attenuation[z], noise, theta, bank)
        area = integrate.trapezoid(integrate.trapezoid(np.exp(log - log.max()), axes[1]), axes[0])
        exact.append(log.max() + np.log(area))
    steps = np.diff(fit.log_evidence[best - 1 : best + 2])
    np.testing.assert_allclose(np.diff(exact), steps, atol=2 * climbing.TOLERANCE)


@pytest.mark.parametrize("imager", [Plain(), Laplacian()])
def test_wiener_restoration_has_the_evidence_as_its_energy(lab16mm, lab_patch, imager):
    """At a fixed spectrum: misfit + prior energy + log-determinant of the restored patch, whitened and tapered."""
    rings = annuli((128, 128))
    bank = evidence.bank(lab16mm, (128, 128), imager, texture.learnt(), 12)
    noise = evidence.noise_power(bank, Noise(0.005), 0.5)
    power = annular_power(lab_patch)
    theta = texture.learnt().mean
    g = rings.transformed(lab_patch)
    ring = np.minimum(rings.index, len(power) - 1)
    share = np.where(rings.index < len(power), (bank.shape / rings.bins)[ring] * once(rings.shape), 0.0)
    scene, floor = np.exp(bank.basis @ theta)[ring], noise[ring]
    for z in range(12):
        h = np.sqrt(bank.attenuation[z])[ring]
        f = restore.wiener_filter(h.astype(complex), floor / scene) * g
        misfit = np.abs(g - h * f) ** 2 / floor
        energy = np.abs(f) ** 2 / scene
        log_determinant = np.log(h**2 * scene + floor)
        total = np.sum(share * (misfit + energy + log_determinant))
        mean = bank.attenuation[z] * np.exp(bank.basis @ theta) + noise
        assert -evidence.log_likelihood(power, mean, bank.shape) == pytest.approx(total, rel=1e-10)


def intervals(bank, noise, believed, rng, trials, level):
    """Whether each interval covers, for powers drawn from the model itself at distances drawn from the prior."""
    theta = rng.multivariate_normal(bank.prior.mean, bank.prior.covariance, size=trials)
    hits = 0
    for row in theta:
        row[0] = bank.prior.mean[0]  # the contrast is a wide prior's: keep to patches with texture
        k = int(rng.integers(0, len(bank.even)))
        mean = bank.attenuation[k] * np.exp(bank.basis @ row) + noise
        power = rng.gamma(bank.shape, mean / bank.shape)
        fit = laplace.integrate(power, believed, bank)
        density = Density(bank.even, fit.log_evidence, lambda v: 1 / np.asarray(v))
        near, far = density.interval(level)
        hits += near <= 1 / bank.even[k] <= far
    return hits / trials


def test_intervals_cover_what_the_model_itself_draws_and_a_wrong_noise_is_caught(bank):
    noise = evidence.noise_power(bank, Noise(0.02), 0.5)
    level, trials = 0.9, 300
    spread = np.sqrt(level * (1 - level) / trials)
    assert abs(intervals(bank, noise, noise, np.random.default_rng(1), trials, level) - level) < 3.5 * spread
    wrong = intervals(bank, noise, 0.6 * noise, np.random.default_rng(1), trials, level)
    assert wrong < level - 3.5 * spread  # the control


def test_gain_and_offset_do_not_move_the_distance(bank, lab_patch):
    """Free contrast: the evidence of 0.4 g + 0.3 under 0.4 times the noise peaks where that of g does."""
    peaks = []
    for gain, offset in ((1.0, 0.0), (0.4, 0.3)):
        noise = evidence.noise_power(bank, Noise(0.005 * gain), 0.5)
        fit = laplace.integrate(annular_power(gain * lab_patch + offset), noise, bank)
        peaks.append(Density(bank.even, fit.log_evidence, lambda v: 1 / np.asarray(v)).modes()[0].distance)
    assert peaks[0] == pytest.approx(peaks[1], rel=2e-4)


def test_a_flatter_noise_floor_says_less(bank, lab_patch):
    """More noise, on average, never narrows the interval."""
    rng = np.random.default_rng(2)
    widths = []
    for sigma in (0.005, 0.02, 0.08):
        noisy = lab_patch + np.sqrt(sigma**2 - 0.005**2) * rng.standard_normal(lab_patch.shape)
        fit = laplace.integrate(annular_power(noisy), evidence.noise_power(bank, Noise(sigma), 0.5), bank)
        near, far = Density(bank.even, fit.log_evidence, lambda v: 1 / np.asarray(v)).interval(0.68)
        widths.append(far - near)
    assert widths[0] < widths[1] < widths[2]


def test_the_maximum_is_a_maximum(bank, lab_patch):
    power = annular_power(lab_patch)
    noise = evidence.noise_power(bank, Noise(0.005), 0.5)
    fit = laplace.integrate(power, noise, bank)
    peak = evidence.log_joint(power, bank.attenuation, noise, fit.theta, bank)
    rng, likely = np.random.default_rng(0), peak > peak.max() - 30  # others are given up early
    factor = np.linalg.cholesky(np.linalg.inv(laplace.curvature_at(power, noise, bank.attenuation, fit.theta, bank)))
    for _ in range(20):
        step = (factor @ rng.standard_normal((len(peak), factor.shape[1], 1)))[..., 0]
        moved = evidence.log_joint(power, bank.attenuation, noise, fit.theta + 0.1 * step, bank)
        assert np.all(moved[likely] < peak[likely] + 1e-3)


def test_gamma_powers_have_the_likelihood_they_are_given():
    """log_likelihood against scipy's gamma distribution, differences in V."""
    shape, power = np.array([3.0, 10.0]), np.array([0.5, 2.0])
    means = np.array([0.4, 1.0]), np.array([1.0, 3.0])
    ours = [evidence.log_likelihood(power, mean, shape) for mean in means]
    theirs = [
        stats.gamma.logpdf(power, shape, scale=mean / shape).sum()
        for mean in (np.array([0.4, 1.0]), np.array([1.0, 3.0]))
    ]
    assert ours[1] - ours[0] == pytest.approx(theirs[1] - theirs[0])


@pytest.mark.parametrize("period", [3, 9, 20])
def test_maxima_are_maxima_for_patterns_that_no_smooth_spectrum_explains(bank, period):
    """Laplace's method needs a positive curvature at every distance, however badly it fits."""
    grid = np.indices((128, 128)).sum(axis=0)
    noise = 0.005 * np.random.default_rng(0).standard_normal((128, 128))
    stripes = 0.5 + 0.4 * np.sin(2 * np.pi * grid / period) + noise
    power, noise = annular_power(stripes), evidence.noise_power(bank, Noise(0.005), 0.5)
    fit = laplace.integrate(power, noise, bank)
    assert np.all(np.isfinite(fit.log_evidence))
    likely = fit.log_evidence > fit.log_evidence.max() - 30  # others are given up early
    curvature = laplace.curvature_at(power, noise, bank.attenuation, fit.theta, bank)[likely]
    assert np.linalg.eigvalsh(curvature).min() > 0


def test_the_posterior_does_not_depend_on_the_candidates(lab16mm, scene):
    """Where blur says little a cliff meets level ground, at which a spline through few candidates rings."""
    for distance in (1.05, 4.3):
        image = capture.simulate(scene, lab16mm, distance, capture.Setup(noise="0.005"), 2)[0][64:192, 64:192]
        problem = Problem(image, lab16mm, Plain(), Noise(0.005), "given", 0.95)
        (near, far), (low, high) = (grid(problem, count).density.interval(0.95) for count in (100, 800))
        assert [near, far] == pytest.approx([low, high], abs=0.1 * (high - low))
