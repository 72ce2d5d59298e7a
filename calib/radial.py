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
    split = 2 * int(np.ceil(sampling)) + 1
    half = size // 2
    line = (np.arange(split * (half + 1)) - split // 2) / split * sampling  # fine pixels right and below the centre
    away = np.hypot(line[:, None], line)
    rho, weight, bessel = _nodes(int(np.ceil(away.max() / 20.0)) * 20)
    wave = 0.25 * sampling * np.asarray(radius)[:, None] * rho**2 + spherical * (6 * rho**4 - 6 * rho**2 + 1)
    intensity = np.abs((weight * rho * np.exp(2j * np.pi * wave)) @ bessel) ** 2
    place = away / STEP
    low = place.astype(int)
    part = place - low
    shape = (half + 1, split, half + 1, split)
    quarter = [((1 - part) * each[low] + part * each[low + 1]).reshape(shape).mean(axis=(1, 3)) for each in intensity]
    quarters = np.stack(quarter)
    right = np.concatenate([quarters[:, :, :0:-1], quarters], axis=2)
    planes = np.concatenate([right[:, :0:-1], right], axis=1)
    return np.asarray(planes / planes.sum(axis=(1, 2), keepdims=True))


@lru_cache(maxsize=8)
def _nodes(reach: int) -> tuple[Floats, Floats, Floats]:
    """Gauss-Legendre nodes and weights over the pupil's radius, and J0 for s from 0 to a little beyond `reach`."""
    nodes, weights = np.polynomial.legendre.leggauss(64 + 2 * reach)
    rho = 0.5 * (nodes + 1.0)
    return rho, 0.5 * weights, j0(np.pi * np.outer(rho, STEP * np.arange(reach / STEP + 3)))


@lru_cache(maxsize=8)
def rings(size: int) -> NDArray[np.int_]:
    """(size, size) the distance of every pixel from the middle one, rounded to whole pixels."""
    across = np.arange(size) - size // 2
    return np.hypot(across[:, None], across).round().astype(int)
