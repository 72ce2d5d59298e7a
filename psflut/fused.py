"""Two images of one scene made one, by Wiener inversion of both at a distance: F = w (H1* G1 / N1 + c H2* G2 / N2) / A.

A = |H1|^2 / N1 + c^2 |H2|^2 / N2 and w = S A / (1 + S A) as in `psflut.pair`.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from psflut.fourier import phase
from psflut.pair import Pair, Spectrum, otf
from psflut.spectrum import Annuli

Floats = NDArray[np.float64]


def power(pair: Pair, even: float, gain: float, rings: Annuli) -> Floats:
    """(K,) power over noise of the images fused at a distance: of mean S A + 1 in each annulus of the patch."""
    moved = phase(pair.first.shape, pair.shift)
    one, two = (rings.transformed(each.image) for each in (pair.first, pair.second))
    fused, total = _fused(pair, (one * moved, two), rings.shape, even, gain)
    return rings.mean(np.abs(fused) ** 2 / total)


def restored(pair: Pair, even: float, gain: float) -> Floats:
    """The ideal image (H, W) at a distance, in the first one's place: Wiener inversion of both together."""
    fused, total = _fused(pair, pair.spectra, pair.grid, even, gain)
    height, width = pair.first.shape
    scene = fft.irfft2(phase(pair.grid, pair.shift).conj() * pair.share * fused / total, s=pair.grid)
    return np.asarray(scene[:height, :width] + pair.first.image.mean(), dtype=float)


def _fused(
    pair: Pair, spectra: tuple[Spectrum, Spectrum], grid: tuple[int, int], even: float, gain: float
) -> tuple[Spectrum, Floats]:
    """H1* F1 / N1 + c H2* F2 / N2, and A."""
    noises = pair.noise(grid)
    one, two = otf(pair.first.table, even, grid), gain * otf(pair.second.table, even, grid)
    fused = one.conj() * spectra[0] / noises[0] + two.conj() * spectra[1] / noises[1]
    return fused, np.abs(one) ** 2 / noises[0] + np.abs(two) ** 2 / noises[1]
