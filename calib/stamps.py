"""Bright points found in a frame, and the windows cut out around them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Floats = NDArray[np.float64]

FOUND_SIGMAS = 6.0
"""A point stands out of the smoothed frame by so many of its robust standard deviations."""


class Stamp(NamedTuple):
    """A point's window less its background, its centre less the window's (pixels), noise variance, and name."""

    image: Floats
    shift: Floats
    variance: float
    name: str


def find(image: Floats, size: int, signed: bool) -> Floats:
    """Places (N, 2) of what stands out of the frame; a signed imager shows only the rim of a large disc."""
    light = np.where(np.isnan(image), 1.0, image) - np.nanmedian(image)
    light = np.abs(light) if signed else light
    smooth = ndimage.gaussian_filter(light, size / (4 if signed else 8)) - ndimage.gaussian_filter(light, size)
    sigma = 1.4826 * np.median(np.abs(smooth - np.median(smooth)))
    peak = smooth == ndimage.maximum_filter(smooth, size if signed else size // 2)
    return np.argwhere(peak & (smooth > FOUND_SIGMAS * sigma + 1e-12)).astype(float)


def cut(image: Floats, place: Floats, size: int, name: str, least_snr: float) -> Stamp | str:
    """The stamp of a point, or why there is none."""
    half = size // 2 + max(4, size // 6)
    outside = around(2 * half + 1, size)
    start, shift = place, np.zeros(2)
    for _ in range(3):  # the place found may be some pixels off
        place = np.rint(place + shift)
        if np.hypot(*(place - start)) > size / 4:
            return "other light beside it"
        y, x = place.astype(int)
        if min(y, x) < half or y + half >= image.shape[0] or x + half >= image.shape[1]:
            return "too near to the border"
        window = image[y - half : y + half + 1, x - half : x + half + 1]
        if np.any(np.isnan(window)):
            return "saturated"
        level, variance = _background(window[outside])
        if np.sum((window - level) ** 2) < variance * (window.size + least_snr**2):
            return "too faint"
        light = ndimage.gaussian_filter(np.abs(window - level), 1.0)
        shift = np.array(ndimage.center_of_mass(np.maximum(light - 0.3 * light.max(), 0.0))) - half
    return Stamp(window - level, shift, variance, name)


def _background(dark: Floats) -> tuple[float, float]:
    """Level and variance of the pixels that lie within four robust deviations."""
    away = np.abs(dark - np.median(dark))
    kept = dark[away <= 4 * 1.4826 * np.median(away) + 1e-12]
    return float(kept.mean()), max(float(kept.var()), 1e-16)


def around(width: int, size: int) -> NDArray[np.bool_]:
    """Which pixels of a window lie outside the PSF's own."""
    line = np.abs(np.arange(width) - width // 2) > size // 2
    return np.asarray(line[:, None] | line)
