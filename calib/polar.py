"""PSFs as rings times waves around the centre: few numbers for what a lens does, finer than the pixels."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

FINE = 21
"""Places a pixel, each way, at which the basis is integrated."""


@dataclass(frozen=True)
class Polar:
    """Densities hat(r / width - j) {1, cos m theta, sin m theta}, j = 0 .. count - 1 (from 1 where m > 0), m <= order.

    theta runs from +x towards +y, y down.

    Parameters
    ----------
    count : int
        Rings.
    width : float
        Of a ring at half its height, and their spacing; pixels.
    order : int
        Of the finest wave: 1 is coma, 2 astigmatism, 3 trefoil; an iris of n blades makes waves of order n.
    """

    count: int
    width: float
    order: int

    @property
    def waves(self) -> tuple[int, ...]:
        """The order of every block of the basis: 0, 1, 1, 2, 2, .."""
        return (0, *(m for m in range(1, self.order + 1) for _ in "cs"))

    @property
    def block(self) -> NDArray[np.int_]:
        """Which block a function belongs to, (n,)."""
        return np.repeat(np.arange(len(self.waves)), [self.count - (m > 0) for m in self.waves])

    def planes(self, size: int, per: int) -> Floats:
        """Every function integrated over cells of 1 / per pixel, centred: (n, k, k), k odd, size * per or one less."""
        side, split = size * per - (size * per + 1) % 2, FINE // per
        out = np.zeros((len(self.block), side, side))
        line = (np.arange(side * split) + 0.5) / (split * per) - side / (2.0 * per)
        for row in range(side):  # a row of cells at a time, for the memory
            y = line[row * split : (row + 1) * split, None]
            place, angle = np.hypot(y, line) / self.width, np.arctan2(y, line + 0 * y)
            inside = place < self.count
            inner, share = np.divmod(place[inside], 1.0)
            cell = np.broadcast_to(np.arange(side * split) // split, place.shape)[inside]
            begin = 0
            for number, order in enumerate(self.waves):
                wave = np.sin(order * angle[inside]) if number and number % 2 == 0 else np.cos(order * angle[inside])
                sums = np.bincount(inner.astype(int) * side + cell, (1.0 - share) * wave, (self.count + 1) * side)
                sums += np.bincount((inner.astype(int) + 1) * side + cell, share * wave, (self.count + 1) * side)
                first = int(order > 0)
                rings = sums.reshape(self.count + 1, side)[first : self.count]
                out[begin : begin + len(rings), row] = rings / (split * per) ** 2
                begin += len(rings)
        return out

    @property
    def bends(self) -> Floats:
        """Energy of the gradient of every block, as quadratic forms that are 0 elsewhere: (blocks, n, n)."""
        steps = np.diff(np.vstack([np.eye(self.count), np.zeros(self.count)]), axis=0)
        steps = steps * np.sqrt(np.arange(self.count) + 0.5)[:, None]
        out = np.zeros((len(self.waves), len(self.block), len(self.block)))
        for number, order in enumerate(self.waves):
            own = np.flatnonzero(self.block == number)
            around = np.diag(order**2 / np.maximum(np.arange(self.count), 1.0))
            form = (steps.T @ steps + around)[int(order > 0) :, int(order > 0) :]
            out[number][np.ix_(own, own)] = form
        return out
