"""The smooth course of measured PSFs, against the model they were drawn from."""

import numpy as np
import pytest
from scipy.interpolate import make_smoothing_spline

from calib.build import STRENGTHS, _smoothers, smooth
from calib.targets import Measurement
from psflut.optics import Camera
from psflut.psfs.pupil import Pupil

CAMERA = Camera.of(16e-3, 6e-6, f_number=2, focus_distance=6.0)


def course(count, noise, rng, size=31):
    """True PSFs even in vergence, and noisy measurements of them."""
    even = np.linspace(1 / 4.0, 1 / 1.2, count)
    truth = np.stack([Pupil()(CAMERA, float(1 / v), size) for v in even])
    std = noise * truth.max(axis=(1, 2), keepdims=True) * np.ones_like(truth)
    noisy = truth + std * rng.standard_normal(truth.shape)
    return even, truth, [Measurement(psf, error, 1) for psf, error in zip(noisy, std, strict=True)]


@pytest.mark.parametrize("noise", [0.003, 0.03])
def test_smoothing_brings_measurements_nearer_to_the_truth(noise, rng):
    even, truth, measured = course(20, noise, rng)
    raw = np.stack([each.psf for each in measured])
    found = smooth(even, measured)
    assert np.abs(found.psf - truth).sum() < 0.15 * np.abs(raw - truth).sum()
    assert found.psf.min() >= 0
    np.testing.assert_allclose(found.psf.sum(axis=(1, 2)), 1.0)


def test_real_structure_is_not_smoothed_away(rng):
    """Hardly any noise: rims move by whole pixels between positions, and must stay where they are."""
    even, truth, measured = course(20, 1e-6, rng)
    error = np.abs(smooth(even, measured).psf - truth).max(axis=(1, 2)) / truth.max(axis=(1, 2))
    assert error.max() < 1e-3


def test_standard_errors_are_honest(rng):
    even, truth, measured = course(20, 0.02, rng)
    found = smooth(even, measured)
    lit = truth > 0.05 * truth.max(axis=(1, 2), keepdims=True)  # clipping at zero makes the dark pixels better
    scaled = ((found.psf - truth) / found.std)[lit]
    assert 1 / 1.3 < np.sqrt(np.mean(scaled**2)) < 1.3


def test_errors_that_a_ring_shares_are_smoothed_and_told_as_well():
    """PSFs from edges are round, and so are their errors: many pixels, but one number a ring and position."""
    across = np.arange(31) - 15
    ring = np.hypot(across[:, None], across).round().astype(int)
    even = np.linspace(1 / 1.6, 1 / 1.2, 20)
    truth = np.stack([Pupil()(CAMERA, float(1 / v), 31) for v in even])
    lit = truth > 0.05 * truth.max(axis=(1, 2), keepdims=True)
    std, scaled = 0.02 * truth.max(axis=(1, 2), keepdims=True) * np.ones_like(truth), []
    for seed in range(8):
        noisy = truth + std * np.random.default_rng(seed).standard_normal((20, ring.max() + 1))[:, ring]
        found = smooth(even, [Measurement(psf, error, 1) for psf, error in zip(noisy, std, strict=True)])
        scaled.append(((found.psf - truth) / found.std)[lit])
    assert np.sqrt(np.mean(np.square(scaled))) < 1.3  # 1.5 if each ring's least risk decides


@pytest.mark.parametrize("told", [True, False])
def test_what_a_target_hides_at_every_position_is_not_averaged_away(told):
    """An error that positions share, 1.5 times the noise; unless it is told, it is taken for smaller than it is."""
    scaled = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        even, truth, measured = course(20, 0.02, rng)
        noise = measured[0].std.mean()
        fixed = 1.5 * noise * rng.standard_normal(truth.shape[1:])
        parts = [(one.psf + fixed, np.hypot(one.std, 1.5 * noise)) for one in measured]
        hidden = np.full(truth.shape[1:], 1.5 * noise) if told else None
        found = smooth(even, [Measurement(psf, std, 1, hidden=hidden) for psf, std in parts])
        lit = truth > 0.05 * truth.max(axis=(1, 2), keepdims=True)
        scaled.append(((found.psf - truth) / found.std)[lit])
    honest = np.sqrt(np.mean(np.square(np.concatenate(scaled))))
    assert 1 / 1.3 < honest < 1.3 if told else honest > 1.4


def test_few_positions_are_left_as_they_are(rng):
    even, _, measured = course(4, 1e-9, rng)
    found = smooth(even, measured)
    np.testing.assert_allclose(found.psf, np.stack([each.psf for each in measured]), atol=1e-6)


def test_smoothers_are_scipys_smoothing_splines(rng):
    even, sigma = np.linspace(0, 1, 16) + 0.02 * rng.standard_normal(16), rng.uniform(0.5, 2, 16)
    scaled = (even - even[0]) / (even[-1] - even[0])
    found = _smoothers(even, sigma)
    np.testing.assert_array_equal(found[0], np.eye(16))
    for each, strength in zip(found[1:], STRENGTHS, strict=True):
        expected = make_smoothing_spline(scaled, np.eye(16), (sigma.min() / sigma) ** 2, lam=strength)(scaled)
        np.testing.assert_allclose(each, expected, atol=1e-9)
