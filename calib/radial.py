"""PSFs of a round pupil whose aberrations are round too, by a Hankel transform: fast enough to be fitted."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import j0

Floats = NDArray[np.float64]

STEP = 0.2
"""Between samples of the intensity along the radius, in wavelength * detector distance / aperture."""


def radial_planes(radius: Floats, sampling: float, spherical: float, size: int) -> Floats:
    """What `psflut.psfs.pupil` says without other aberrations, 20 times faster; within 1 % of its peak.

    With rho = 1 at the rim and s the distance from the centre in wavelength * detector distance / aperture, the
    amplitude is the integral of exp(2 pi i W) J0(pi s rho) rho d rho, and W in waves
    sampling * radius / 4 * rho^2 + spherical * (6 rho^4 - 6 rho^2 + 1). Pixels are means over a finer grid.

    Parameters
    ----------
    radius : (M,) array
        Of the geometric blur disc, pixels, with the sign of the defocus.
    sampling : float
        Pixel pitch in units of s.
    spherical : float
        Waves.
    size : int
        Odd.

    Returns
    -------
    (M, size, size) array, sum 1.
    """
    means = _means(float(sampling), size)
    rho, weight, bessel = _nodes(len(means))
    wave = 0.25 * sampling * np.asarray(radius)[:, None] * rho**2 + spherical * (6 * rho**4 - 6 * rho**2 + 1)
    phase, light = 2 * np.pi * wave, weight * rho
    intensity = ((light * np.cos(phase)) @ bessel) ** 2 + ((light * np.sin(phase)) @ bessel) ** 2
    quarters = (intensity @ means).reshape(-1, size // 2 + 1, size // 2 + 1)
    right = np.concatenate([quarters[:, :, :0:-1], quarters], axis=2)
    planes = np.concatenate([right[:, :0:-1], right], axis=1)
    return np.asarray(planes / planes.sum(axis=(1, 2), keepdims=True))


@lru_cache(maxsize=8)
def _means(sampling: float, size: int) -> Floats:
    """From samples of the intensity to the pixels of the quarter right and below the centre: (samples, pixels).

    A fit changes the sampling once in six steps: all planes, and the other five, share it.
    """
    split = 2 * int(np.ceil(sampling)) + 1
    half = size // 2
    fine = np.arange(split * (half + 1))
    line = (fine - split // 2) / split * sampling
    place = np.hypot(line[:, None], line) / STEP
    low = place.astype(int)
    part = (place - low) / split**2
    pixel = fine[:, None] // split * (half + 1) + fine // split
    shape = _samples(place.max() * STEP), (half + 1) ** 2
    at = np.concatenate([low, low + 1]) * shape[1] + np.concatenate([pixel, pixel])
    share = np.concatenate([1 / split**2 - part, part])
    return np.asarray(np.bincount(at.ravel(), share.ravel(), shape[0] * shape[1]).reshape(shape), np.float64)


def _samples(reach: float) -> int:
    """From the centre to a little beyond s = `reach`, rounded up so that few kinds of `_nodes` are kept."""
    return int(np.ceil(reach / 20.0) * 20 / STEP) + 3


@lru_cache(maxsize=8)
def _nodes(samples: int) -> tuple[Floats, Floats, Floats]:
    """Gauss-Legendre nodes and weights over the pupil's radius, and J0 at so many samples along the radius."""
    nodes, weights = np.polynomial.legendre.leggauss(64 + int(2 * STEP * samples))
    rho = 0.5 * (nodes + 1.0)
    return rho, 0.5 * weights, j0(np.pi * np.outer(rho, STEP * np.arange(samples)))


@lru_cache(maxsize=8)
def rings(size: int) -> NDArray[np.int_]:
    """(size, size) the distance of every pixel from the middle one, rounded to whole pixels."""
    across = np.arange(size) - size // 2
    return np.hypot(across[:, None], across).round().astype(int)
