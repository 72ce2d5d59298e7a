"""How the powers of neighbouring annuli vary together: what the taper makes of independent bins."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from psflut.spectrum import annuli

Floats = NDArray[np.float64]

FAINT = 1e-6
"""Squared correlation of two bins below which it is left out; a Hann window's reaches two bins."""


@lru_cache(maxsize=8)
def covariance(shape: tuple[int, int]) -> Floats:
    """Covariance of the annuli's relative powers P_k / V_k, (K, K), for patches of that shape.

    Of a stationary Gaussian field whose spectrum is level over a few bins, the tapered transforms at bins i and j have
    the correlation W(i - j), with W the transform of the squared taper, W(0) = 1, so that

        cov(P_i / V_i, P_j / V_j) = |W(i - j)|^2 + |W(i + j)|^2

    (Percival and Walden 1993, chapter 6), summed here over the bins of two annuli. Its whole sum agrees with
    `Annuli.effective`; what that leaves out is that a Hann window's neighbours share 0.46 of their variance, which
    matters where the transfer function changes from one annulus to the next: near the zeros of a large blur disc.
    """
    rings, (height, width) = annuli(shape), shape
    transform = fft.fft2(rings.taper**2)
    squared = np.abs(transform / transform[0, 0]) ** 2
    count = len(rings.frequency) + 1
    index = _whole_plane(rings.index, width)
    column = np.arange(width)
    # Of the half plane whose bins are averaged, an inner one stands here for itself and its mirror image.
    weight = np.where((column == 0) | (2 * column == width), 1.0, 0.5) * np.ones((height, 1))
    weight /= np.bincount(index.ravel(), weight.ravel())[index]
    total = np.zeros(count**2)
    for offset in np.argwhere(squared > FAINT):
        other, share = (np.roll(plane, offset, axis=(0, 1)) for plane in (index, weight))
        pairs = np.bincount((index * count + other).ravel(), (weight * share).ravel(), minlength=count**2)
        total += 2.0 * squared[tuple(offset)] * pairs
    return np.asarray(total.reshape(count, count)[:-1, :-1])


def _whole_plane(half: NDArray[np.intp], width: int) -> NDArray[np.intp]:
    """The annulus of every bin (H, W), from that of the half plane: bin -i has the frequency of bin i."""
    mirrored = np.roll(half[::-1], 1, axis=0)[:, (width - 1) // 2 : 0 : -1]
    return np.concatenate([half, mirrored], axis=1)
