"""Tapered, annular power: white noise, degrees of freedom, the smear of a transfer function."""

import numpy as np
import pytest
from scipy import fft

from psflut.imagers.laplacian import Laplacian
from psflut.imagers.plain import Plain
from psflut.leakage import STEEPNESS, passed
from psflut.spectrum import RISE, annular_power, annuli


@pytest.mark.parametrize("shape", [(64, 64), (65, 65), (64, 96), (97, 80)])
def test_white_noise_has_its_variance_and_what_leaks_in_every_annulus(shape, rng):
    power = np.mean([annular_power(0.3 * rng.standard_normal(shape)) for _ in range(400)], axis=0)
    expected = 0.09 * annuli(shape).white
    assert np.all(np.abs(power - expected) < 5 * expected / np.sqrt(400 * annuli(shape).effective))


def test_effective_bins_are_what_the_scatter_of_the_total_says(rng):
    """The sum over annuli of n_k (P_k / N - 1) has the variance sum n_k, correlations included."""
    shape = (64, 64)
    effective = annuli(shape).effective
    white = annuli(shape).white
    totals = [np.sum(effective * (annular_power(rng.standard_normal(shape)) / white - 1)) for _ in range(1500)]
    assert np.var(totals) == pytest.approx(effective.sum(), rel=0.15)


def test_a_taper_leaves_the_known_share_of_bins():
    """Over a rise the means of sin^4 and sin^8 are 3/8 and 35/128; a pixel at either end is not seen."""
    rings = annuli((128, 128))
    nominal = np.sum(np.where(rings.index < len(rings.frequency), 1.0, 0.0))
    squares, fourths = 1 - 2 * RISE * 5 / 8, 1 - 2 * RISE * 93 / 128
    assert rings.effective.sum() / nominal == pytest.approx((squares**2 / fourths * 126 / 128) ** 2, rel=0.01)


def test_smear_predicts_the_mean_power_of_blurred_noise(lab16mm, rng):
    """An OTF with zeros, seen through a taper: |H|^2 alone would be wrong at the zeros."""
    from scipy.signal import oaconvolve

    shape, psf = (96, 96), lab16mm.at(0.9)
    rings = annuli(shape)
    seen = np.mean(
        [annular_power(oaconvolve(rng.standard_normal((144, 144)), psf, mode="valid")) for _ in range(300)], axis=0
    )
    sharp = rings.mean(lab16mm.power(shape, 0.9))
    smeared = rings.mean(rings.smear(lab16mm.power(shape, 0.9)))
    error = np.abs(np.log(seen / smeared))
    assert np.median(error) < 0.03
    assert np.max(error) < 0.25
    assert np.max(np.abs(np.log(seen / sharp))) > 1.0  # the control: without the smear


@pytest.mark.parametrize("shape", [(64, 64), (97, 80)])
@pytest.mark.parametrize("imager", [Plain(), Laplacian()], ids=["plain", "laplacian"])
def test_what_is_passed_is_the_share_of_a_typical_scene_that_leaks(lab16mm, shape, imager):
    """The definition, on the patch's own grid, one distance at a time."""
    rings, positions = annuli(shape), np.array([0.97, 1.7, 3.1])
    frequency = np.hypot(fft.fftfreq(rings.doubled[0])[:, None], fft.rfftfreq(rings.doubled[1]))
    scene = np.maximum(frequency, 1 / min(shape)) ** -STEEPNESS
    seen = scene * imager.transfer(rings.doubled) ** 2 * lab16mm.power(rings.doubled, positions)
    expected = np.stack([rings.leaked(each) for each in seen]) / rings.leaked(scene)
    np.testing.assert_allclose(passed(lab16mm.at(positions), annuli(shape), imager), expected, rtol=1e-6)


def test_the_mean_does_not_count(rng):
    image = rng.standard_normal((64, 64))
    np.testing.assert_allclose(annular_power(image + 100.0), annular_power(image), rtol=1e-6)


def test_single_precision_agrees_with_double(rng):
    image = rng.random((128, 128))
    np.testing.assert_allclose(annular_power(image.astype(np.float32)), annular_power(image), rtol=1e-3)


def test_annuli_average_over_themselves():
    rings = annuli((64, 64))
    plane = np.hypot(fft.fftfreq(64)[:, None], fft.rfftfreq(64))
    assert np.all(np.abs(rings.mean(plane) - rings.frequency) < 1 / 64)
