"""Spots that blur a photograph, and captures of it, for tests of restoration."""

import numpy as np
from scipy import ndimage


def gaussian(sigma, size=17, stretch=1.0, shift=0.0):
    """A Gaussian spot, sum 1; `stretch` and `shift` (pixels, down) make it lopsided."""
    y, x = np.mgrid[:size, :size] - size // 2
    spot = np.exp(-0.5 * ((y - shift) ** 2 / stretch**2 + x**2) / sigma**2)
    return spot / spot.sum()


def rms(error):
    return np.sqrt(np.mean(np.square(error)))


def capture(big, psf, noise=0.0):
    """A scene of 128 x 128 and its capture, whose border saw what lies beyond."""
    window = slice(60, 188), slice(60, 188)
    image = ndimage.convolve(big, psf, mode="reflect")[window]
    image = image + np.random.default_rng(3).normal(0, noise, image.shape)
    return big[window], np.maximum(image, 0)
