"""Two captures of one scene, g1 = h1(z) * f + n1 and g2 = c h2(z) * s * f + n2, made ready to be compared.

At each frequency A = |H1|^2 / N1 + c^2 |H2|^2 / N2, and w = S A / (1 + S A) is the share of the fused images that is
scene: where noise drowns the scene, nothing counts. S A is read from the two images themselves, as
|g1|^2 / N1 + |g2|^2 / N2 has the mean S A + 2 at any distance.
"""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from psflut import fourier
from psflut.estimation import Problem
from psflut.fourier import once, phase, transfer
from psflut.spectrum import annuli
from psflut.table import PSFTable
from psflut.window import Window, window

Floats = NDArray[np.float64]
Spectrum = NDArray[np.complexfloating]

LOST = 1e-3
"""Share of a PSF's light that may come from beyond the border of what is compared."""

GAP = 8
"""Pixels over which opposite borders fade into each other, at least, at either end."""


@dataclass(frozen=True, eq=False)
class Pair:
    """Two captures on one periodic grid.

    Parameters
    ----------
    first, second : Problem
        Of one shape and imager.
    margin : int
        Pixels along each border that are left out.
    shift : (float, float)
        Of the second image, about which a further one is linearised, pixels.
    """

    first: Problem
    second: Problem
    margin: int
    shift: tuple[float, float] = (0.0, 0.0)

    @cached_property
    def grid(self) -> tuple[int, int]:
        """Shape of the periodic grid."""
        return fourier.padded_shape(self.first.shape, GAP)

    @cached_property
    def window(self) -> Window:
        """What is compared."""
        return window(self.first.shape, self.grid, self.margin)

    @cached_property
    def spectra(self) -> tuple[Spectrum, Spectrum]:
        """Of both images about their means, the first moved by the shift."""
        one, two = (
            fft.rfft2(fourier.continued(each.image - each.image.mean(), self.grid))
            for each in (self.first, self.second)
        )
        return (one * phase(self.grid, self.shift)).astype(np.complex64), two.astype(np.complex64)

    @cached_property
    def noises(self) -> tuple[Floats, Floats]:
        """N1 and N2 on the half plane of the grid."""
        return self.noise(self.grid)

    def noise(self, grid: tuple[int, int]) -> tuple[Floats, Floats]:
        """N1 and N2 on the half plane of another grid."""
        response = self.first.imager.transfer(grid) ** 2
        one, two = (each.noise.power(response, each.mean_level) for each in (self.first, self.second))
        return one, two

    @cached_property
    def contrast(self) -> float:
        """A first guess of c: the ratio of contrasts."""
        powers = [np.sum(each.power[: len(each.power) // 8 + 1]) for each in (self.first, self.second)]
        return float(np.sqrt(powers[1] / powers[0]))

    @cached_property
    def excess(self) -> Floats:
        """(K,) S A + 1, the fused power of both images over their noise, by annulus of the patch."""
        return np.asarray(np.maximum(over_noise(self.first) + over_noise(self.second) - 1, 0.1))

    @cached_property
    def share(self) -> Floats:
        """w of every bin."""
        frequency = fourier.frequency(self.grid)
        share = np.maximum(1 - 1 / self.excess, 0.0)
        return np.asarray(np.interp(frequency, annuli(self.first.shape).frequency, share))

    @cached_property
    def weight(self) -> Floats:
        """The same times the independent frequencies that a bin of the half plane stands for."""
        return np.asarray(self.window.freedom / self.window.taper.size * once(self.grid) * self.share)

    @cached_property
    def count(self) -> float:
        """Independent frequencies that count, sum of w."""
        return float(np.sum(self.weight))

    def recentred(self, shift: Floats) -> "Pair":
        """The same about another shift."""
        return replace(self, shift=(float(shift[0]), float(shift[1])))


def paired(first: Problem, second: Problem, even: Floats) -> Pair:
    """Two captures to be compared at distances within those given."""
    reach = max(_reach(each.table, float(even.min()), float(even.max())) for each in (first, second))
    return Pair(first, second, min(reach, (min(first.shape) - 1) // 4))


def over_noise(problem: Problem) -> Floats:
    """(K,) power of a patch over that of its noise, by annulus."""
    rings = annuli(problem.shape)
    response = rings.leaked(problem.imager.transfer(rings.doubled) ** 2)
    return np.asarray(problem.power / problem.noise.power(response, problem.mean_level, rings.white))


def otf(table: PSFTable, even: float, grid: tuple[int, int]) -> Spectrum:
    """A table's transfer function at an even coordinate, in single precision."""
    position = np.clip(table.position(even), *table.span)
    return transfer(table.at(position).astype(np.float32), grid)


@lru_cache(maxsize=16)
def _reach(table: PSFTable, low: float, high: float) -> int:
    """Half the side of the square that holds all but `LOST` of every PSF between two even coordinates."""
    own, half = table.even(table.axis), table.size // 2
    planes = table.psf[(own >= low) & (own <= high)]
    ring = np.maximum(*np.abs(np.indices((table.size, table.size)) - half))
    held = np.cumsum([planes[:, ring == k].sum(axis=1) for k in range(half + 1)], axis=0)
    return int(np.argmax(np.all(held >= 1 - LOST - 1e-9, axis=1)))
