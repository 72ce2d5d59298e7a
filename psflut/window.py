"""What of two images is compared: a window on a periodic grid, zero where either convolution sees beyond its image."""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from psflut.fourier import autocorrelation

Reals = NDArray[np.floating]

EDGE = 0.1
"""Share of the side of what is compared that the taper's rise takes, at either end."""


@dataclass(frozen=True, eq=False)
class Window:
    """A taper, and what it does to power spectra.

    Parameters
    ----------
    taper : array on the grid
        0 along the borders, 1 in the middle, a cosine between.
    """

    taper: Reals

    @cached_property
    def energy(self) -> float:
        """Sum of the taper's squares."""
        return float(np.sum(self.taper**2, dtype=float))

    @cached_property
    def freedom(self) -> float:
        """Independent pixels that the taper leaves."""
        return float(self.energy**2 / np.sum(self.taper**4, dtype=float))

    def smeared(self, power: Reals) -> NDArray[np.float64]:
        """A noise's power spectrum (half plane of the grid) as the taper shows it."""
        return np.asarray(fft.rfft2(fft.irfft2(power, s=self.taper.shape) * self._lags).real)

    @cached_property
    def _lags(self) -> Reals:
        """Autocorrelation of the taper on the grid, 1 at lag zero."""
        height, width = self.taper.shape
        return autocorrelation(self.taper, (height, width))


@lru_cache(maxsize=16)
def window(shape: tuple[int, int], grid: tuple[int, int], margin: int) -> Window:
    """For an image of that shape at the grid's origin, without `margin` pixels along each border."""
    sides = []
    for n, total in zip(shape, grid, strict=True):
        inner = n - 2 * margin
        rise = max(int(EDGE * inner), 1)
        ramp = np.sin(0.5 * np.pi * (np.arange(rise) + 0.5) / rise) ** 2
        side = np.zeros(total)
        side[margin : margin + inner] = 1.0
        side[margin : margin + rise] = ramp
        side[margin + inner - rise : margin + inner] = ramp[::-1]
        sides.append(side)
    return Window(np.outer(*sides).astype(np.float32))
