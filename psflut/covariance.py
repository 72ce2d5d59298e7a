"""How the powers of neighbouring annuli vary together: what the taper makes of a field's independent frequencies."""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from psflut.spectrum import Annuli, annuli, whitening

Floats = NDArray[np.float64]

REACH = 5
"""Bins (squared distance) up to which two are taken to be correlated."""

LEAST = 1e-6
"""Of the whitening, which is 0 at zero frequency; no annulus holds that."""


def covariance(rings: Annuli, power: Floats) -> Floats:
    """Covariance of the annuli's relative powers P_k / V_k, (K, K), for patches of a Gaussian field.

    With F the field's power spectrum and U the transform of the taper, the tapered transforms at bins i and j have the
    covariance G(i, j) = sum_f F(f) U(i - f) U*(j - f), so that

        cov(P_i, P_j) = |G(i, j)|^2 + |G(i, -j)|^2

    (Percival and Walden 1993, chapter 6), summed here over the bins of two annuli. Of a steep one
    neighbours are not tied where power leaks in from either side.

    Parameters
    ----------
    rings : Annuli
        Of the patches' shape, whole or in sectors.
    power : (2 H, W + 1) array
        F of the capture, on the grid of `Annuli.doubled`; up to a factor.
    """
    shape, (height, width) = rings.shape, rings.shape
    power = power * whitening(rings.doubled) ** 2
    count, index = len(rings.frequency) + 1, _whole_plane(rings.index, width)
    weight = _whole_plane(np.maximum(whitening(shape), LEAST), width) ** -2.0 / np.bincount(index.ravel())[index]
    lags, total = fft.irfft2(power, s=rings.doubled), np.zeros((count, count))
    for offset, product in _products(shape).items():
        folded = (lags * product).reshape(2, height, 2, width).sum(axis=(0, 2))  # every other bin is asked for
        shared = fft.fft2(folded)
        if offset == (0, 0):
            mean = np.bincount(index.ravel(), weight.ravel() * shared.real.ravel())
        other, share = (np.roll(plane, (-offset[0], -offset[1]), axis=(0, 1)) for plane in (index, weight))
        each = (weight * share * np.abs(shared) ** 2).ravel()
        pairs = np.bincount((index * count + other).ravel(), each, minlength=count**2).reshape(count, count)
        total += 2.0 * pairs if offset == (0, 0) else 2.0 * (pairs + pairs.T)
    return np.asarray((total / np.outer(mean, mean))[:-1, :-1])


@lru_cache(maxsize=2)
def _products(shape: tuple[int, int]) -> dict[tuple[int, int], NDArray[np.complex128]]:
    """For an offset d between two bins, one of each d and -d: sum_x w(x) w(x + lag) exp(2 pi i d x) by lag."""
    taper = annuli(shape).taper
    base = fft.fft2(taper, s=annuli(shape).doubled)
    near = [(y, x) for y in range(-2, 3) for x in range(3) if (x, y) >= (0, 0) and y * y + x * x <= REACH]
    return {(y, x): fft.ifft2(base * np.roll(base, (-2 * y, -2 * x), axis=(0, 1)).conj()) for y, x in near}


def _whole_plane(half: NDArray[Any], width: int) -> NDArray[Any]:
    """What belongs to every bin (H, W), from that of the half plane: bin -i has the frequency of bin i."""
    mirrored = np.roll(half[::-1], 1, axis=0)[:, (width - 1) // 2 : 0 : -1]
    return np.concatenate([half, mirrored], axis=1)
