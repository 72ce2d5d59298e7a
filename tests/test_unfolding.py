"""What a sharp picture shows between its pixels is neither too much nor too little, and its law is found."""

import numpy as np
import pytest
from scipy import fft, ndimage

from calib.unfolding import FINER, law, unfolded

SIDE, PARTS = 160, 15
SLOPE, SOFT = 1.5, 0.4
"""Of the power, and sigma of a blur in pixels."""


@pytest.fixture(scope="module")
def scene():
    """On pixels of a fifteenth, averaged over a pixel around every one of them."""
    cycles = np.hypot(fft.fftfreq(SIDE * PARTS)[:, None], fft.rfftfreq(SIDE * PARTS))
    cycles[0, 0] = np.inf
    noise = fft.rfft2(np.random.default_rng(5).standard_normal((SIDE * PARTS,) * 2))
    rough = fft.irfft2(noise * cycles ** (-SLOPE / 2), (SIDE * PARTS,) * 2)
    return ndimage.uniform_filter(ndimage.gaussian_filter(rough, SOFT * PARTS, mode="wrap"), PARTS, mode="wrap")


def high(image):
    """Only what is finer than 0.35 cycles a pixel, clear of the border."""
    edge = 12 * FINER
    part = image[edge:-edge, edge:-edge]
    cycles = FINER * np.hypot(fft.fftfreq(len(part))[:, None], fft.rfftfreq(part.shape[1]))
    return fft.irfft2(fft.rfft2(part) * (cycles > 0.35), part.shape)


@pytest.fixture(scope="module")
def pixels(scene):
    return scene[::PARTS, ::PARTS]


@pytest.fixture(scope="module")
def found(pixels):
    return law(pixels)


def test_the_truth_is_what_is_shown_plus_what_is_uncorrelated_with_it(scene, pixels, found):
    """A straight line of the truth on it has the slope 1; where nothing is said to fold it has not."""
    truth = high(scene[:: PARTS // FINER, :: PARTS // FINER][: 1 - FINER, : 1 - FINER])
    shown = [high(unfolded(pixels, each)) for each in (found, [found[0], found[1], 5.0, -200.0])]
    ours, control = (np.sum(truth * each) / np.sum(each**2) for each in shown)
    assert ours == pytest.approx(1.0, abs=0.03)
    assert control != pytest.approx(1.0, abs=0.03)
    assert np.sum((truth - shown[0]) ** 2) < np.sum((truth - shown[1]) ** 2)


def test_the_law_is_that_of_the_scene(found):
    assert found[1] == pytest.approx(SLOPE, abs=0.15)
    assert np.sqrt(np.exp(found[2])) / (2 * np.pi) == pytest.approx(SOFT, abs=0.06)


def test_noise_is_told_from_the_scene_and_left_out(pixels, rng):
    sigma = 0.2 * pixels.std()
    noisy = pixels + sigma * rng.standard_normal(pixels.shape)
    found = law(noisy)
    assert np.sqrt(np.exp(found[3]) / noisy.size) == pytest.approx(sigma, rel=0.1)
    assert np.std(unfolded(noisy, found)[::FINER, ::FINER] - pixels) < np.std(noisy - pixels)
