"""PSFs as rings times waves around the centre: few numbers for what a lens does, finer than the pixels."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

FINE = 21
"""Places a pixel, each way, at which the basis is integrated."""

ALIKE = 1.0
"""Sigma, pixels, of the Gaussian over which the light at a radius is averaged."""

GROWTH = 1.15
"""Of the width from ring to ring in the wings."""

FAINT = 1e-3
"""Least light at a radius, in units of the largest."""


@dataclass(frozen=True)
class Polar:
    """Densities hat(r) {1, cos m theta, sin m theta}, m <= order, of rings between neighbouring knots.

    theta runs from +x towards +y, y down. Waves (m > 0) are zero in the middle, and have every other knot: what goes
    around the centre is coarser than what goes outwards.

    Parameters
    ----------
    knots : tuple of float
        Radii of the rings, pixels, ascending from 0; the last ring ends as far beyond the last knot as the one before.
    order : int
        Of the finest wave: 1 is coma, 2 astigmatism, 3 trefoil; an iris of n blades makes waves of order n.
    """

    knots: tuple[float, ...]
    order: int

    @classmethod
    def graded(cls, core: float, reach: float, order: int) -> "Polar":
        """Fine rings up to a radius `core`, from there ever wider ones up to `reach`, for the faint wings."""
        width = float(np.clip(core / 45.0, 0.12, 0.3))
        knots = list(np.arange(0.0, core, width))
        while knots[-1] + GROWTH * (knots[-1] - knots[-2]) < reach:
            knots.append(knots[-1] + GROWTH * (knots[-1] - knots[-2]))
        return cls(tuple(knots), order)

    @property
    def waves(self) -> tuple[int, ...]:
        """The order of every block of the basis: 0, 1, 1, 2, 2, .."""
        return (0, *(m for m in range(1, self.order + 1) for _ in "cs"))

    def radii(self, order: int) -> Floats:
        """Knots of the rings of a wave."""
        return np.array(self.knots if order == 0 else self.knots[::2])

    @property
    def block(self) -> NDArray[np.int_]:
        """Which block a function belongs to, (n,)."""
        return np.repeat(np.arange(len(self.waves)), [len(self.radii(m)) - (m > 0) for m in self.waves])

    def planes(self, size: int, per: int) -> Floats:
        """Every function integrated over cells of 1 / per pixel, centred: (n, k, k), k odd, size * per or one less."""
        side, split = size * per - (size * per + 1) % 2, FINE // per
        out = np.zeros((len(self.block), side, side))
        line = (np.arange(side * split) + 0.5) / (split * per) - side / (2.0 * per)
        cells = np.broadcast_to(np.arange(side * split) // split, (split, side * split))
        for row in range(side):  # a row of cells at a time, for the memory
            y = line[row * split : (row + 1) * split, None]
            place, angle, begin = np.hypot(y, line), np.arctan2(y, line + 0 * y), 0
            for number, order in enumerate(self.waves):
                ends = _closed(self.radii(order))
                inside = place < ends[-1]
                inner = np.searchsorted(ends, place[inside], side="right") - 1
                share = (place[inside] - ends[inner]) / np.diff(ends)[inner]
                wave = np.sin(order * angle[inside]) if number and number % 2 == 0 else np.cos(order * angle[inside])
                cell = cells[inside]
                sums = np.bincount(inner * side + cell, (1.0 - share) * wave, len(ends) * side)
                sums += np.bincount((inner + 1) * side + cell, share * wave, len(ends) * side)
                rings = sums.reshape(len(ends), side)[int(order > 0) : -1]
                out[begin : begin + len(rings), row] = rings / (split * per) ** 2
                begin += len(rings)
        return out

    def light(self, heights: Floats) -> Floats:
        """How bright it is about every knot, the brightest 1: root mean square of the rings' heights (count,)."""
        knots = np.array(self.knots)
        weights = np.exp(-0.5 * ((knots[:, None] - knots) / ALIKE) ** 2) * (knots + 0.2) * np.gradient(knots)
        light = np.sqrt(weights @ heights**2 / weights.sum(axis=1))
        return np.asarray(np.maximum(light / light.max(), FAINT))

    def bends(self, light: Floats) -> Floats:
        """Energy of the gradient in units of the `light` there, of every block as a form that is 0 elsewhere.

        (blocks, n, n), n being all functions.
        """
        out = np.zeros((len(self.waves), len(self.block), len(self.block)))
        for number, order in enumerate(self.waves):
            radii = self.radii(order)
            ends = _closed(radii)
            gap, middle = np.diff(ends), 0.5 * (ends[1:] + ends[:-1])
            steps = np.diff(np.vstack([np.eye(len(radii)), np.zeros(len(radii))]), axis=0)
            steps = steps * (np.sqrt(middle / gap) / np.interp(middle, self.knots, light))[:, None]
            around = order**2 * gap / np.maximum(radii, gap) / np.interp(radii, self.knots, light) ** 2
            own = np.flatnonzero(self.block == number)
            out[number][np.ix_(own, own)] = (steps.T @ steps + np.diag(around))[int(order > 0) :, int(order > 0) :]
        return out


def _closed(radii: Floats) -> Floats:
    """Knots, and where the last ring ends."""
    return np.append(radii, 2.0 * radii[-1] - radii[-2])
