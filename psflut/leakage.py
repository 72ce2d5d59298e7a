"""What optics and imager leave of a scene's power in every annulus, as a tapered patch shows it.

The taper smears the product of spectrum and transfer function, not the latter alone: where the transfer is small, power
leaks in from lower frequencies, of which a scene has more. So a typical spectrum S = f^-`STEEPNESS` goes with it: what
is left is the mean of (S |L|^2 T) * W over that of S * W, W being the taper's power spectrum.

That is linear in T, the squared transfer function of the optics, which a grid of twice the PSF's size tells whole. So
the numbers it is multiplied by are worked out once, one annulus after another; to convolve the T of every distance on
the patch's own grid gives the same to 1e-9 and takes four times as long, and more for every table after the first.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from psflut.fourier import frequency, once
from psflut.imagers import Imager
from psflut.spectrum import Annuli, whitening

Floats = NDArray[np.float64]

STEEPNESS = 2.5
"""Of the spectrum that leaks: S ~ f^-2.5, between power laws of photographs. 2 and 3 give the same distances to 0.05 %;
without it (0) those of near objects came out 0.24 % too far."""


def passed(psf: Floats, rings: Annuli, imager: Imager) -> Floats:
    """Share of a scene's power that is left in each annulus: PSFs (M, S, S) -> (M, K)."""
    shares = _shares(rings, imager, psf.shape[-1])
    power = np.abs(fft.rfft2(psf, s=_grid(rings.shape, psf.shape[-1]))) ** 2
    return np.asarray(power.reshape(len(psf), -1) @ shares.reshape(len(shares), -1).T)


def _grid(shape: tuple[int, int], size: int) -> tuple[int, int]:
    """The grid on which a PSF of that size has its autocorrelation, whole."""
    down, across = (min(fft.next_fast_len(2 * size - 1, real=True), 2 * side) for side in shape)
    return down, across


@lru_cache(maxsize=2)
def _shares(rings: Annuli, imager: Imager, size: int) -> Floats:
    """What T counts for in each annulus, by frequency: (K, h, w // 2 + 1) on the grid (h, w) of `_grid`."""
    shape, grid = rings.shape, _grid(rings.shape, size)
    scene = np.maximum(frequency(rings.doubled), 1.0 / min(shape)) ** -STEEPNESS
    weight = scene * (imager.transfer(rings.doubled) * whitening(rings.doubled)) ** 2
    near = np.ix_(*(np.r_[0 : (side + 1) // 2, -(side // 2) : 0] for side in grid))
    shares = np.empty((len(rings.frequency), grid[0], grid[1] // 2 + 1))
    for number, share in enumerate(shares):
        ring = np.where(rings.index == number, rings.unwhitening, 0.0)
        lags = np.tile(fft.irfft2(ring, s=shape), (2, 2)) * rings.lags  # every other bin of the grid is a patch's
        share[:] = fft.rfft2(fft.irfft2(fft.rfft2(lags) * weight, s=rings.doubled)[near]).real
    whole = rings.leaked(scene) * rings.bins * np.prod(grid) / np.prod(shape)
    return np.asarray(shares * once(grid) / whole[:, None, None])
