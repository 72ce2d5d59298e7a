"""Densities on a grid, many rows at once: (B, n) values at n even nodes; places are counted in nodes from the first.

`psflut.density` is one of them with its axis; `psflut.batch` works on the densities of many patches together.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

Floats = NDArray[np.float64]
Places = NDArray[np.int64]

FINE = 4096
"""Nodes of the grid that integrals are taken on."""

WIDTHS, FAINT = 9, 1e-15
"""Normal kernels between whose widths those of a convolution are mixed; what counts as no density at all."""

VALLEY, LOWEST_PEAK = 0.5, 1e-3
"""A peak is a mode of its own if the density falls below half of it before a higher peak, and if it is not
lower than a thousandth of the highest."""


@dataclass(frozen=True, eq=False)
class Modes:
    """The modes of B densities, row after row in ascending order: m in all.

    Parameters
    ----------
    row : (m,) array
        That each belongs to.
    first : (B,) array
        Number of each row's first.
    start, end : (m,) arrays
        Nodes.
    below, weight : (m,) arrays
        Probability below the start, and of the mode.
    """

    row: Places
    first: Places
    start: Places
    end: Places
    below: Floats
    weight: Floats

    @property
    def heaviest(self) -> Places:
        """(B,) number of each row's heaviest."""
        return np.lexsort((-self.weight, self.row))[self.first]


def tabulate(even: Floats, log_density: Floats, counts: Places) -> Floats:
    """(B, FINE) values, the largest 1, of splines through log densities at ``counts`` (B,) ascending places (B, M)."""
    from psflut.kernels import curves

    values = np.empty((len(even), FINE))
    curves.densities(even, log_density, counts, values)
    return values


def cumulated(values: Floats) -> Floats:
    """(B, n) probability below each node, by the trapezium rule."""
    from psflut.kernels import curves

    out = np.empty_like(values)
    curves.cumulate(values, out)
    return out


def modes(values: Floats, cumulative: Floats) -> Modes:
    """The modes of densities (B, n) whose largest values are 1."""
    from psflut.kernels import curves

    begin = np.empty(len(values) + 1, np.int64)
    cuts = curves.modes(values, LOWEST_PEAK, VALLEY, begin)
    count = np.diff(begin) - 1
    row, start = np.repeat(np.arange(len(values)), count), np.ones(len(cuts), dtype=bool)
    start[begin[1:] - 1] = False
    start, end = cuts[start], cuts[np.roll(start, 1)]
    below = cumulative[row, start]
    return Modes(row, np.cumsum(count) - count, start, end, below, cumulative[row, end] - below)


def quantiles(cumulative: Floats, row: Places, probability: Floats) -> Floats:
    """Nodes, and parts of them, below which a probability (m,) lies in the row (m,) of each."""
    from psflut.kernels import curves

    out = np.empty(len(row))
    curves.quantiles(cumulative, row, probability, out)
    return out


def blurred(parts: Floats, row: Places, sd: Floats, count: int) -> Floats:
    """(`count`, n) sums by row of parts (m, n) of densities, each convolved with a normal kernel of standard deviation
    `sd` (m,), in nodes, and mirrored at both ends."""
    from psflut.kernels import curves

    waves = np.zeros((count, parts.shape[1]))
    curves.blur(fft.dct(parts), row, sd, waves)
    return np.asarray(np.maximum(fft.idct(waves, overwrite_x=True), 0.0))


def widened(values: Floats, sd: Floats) -> Floats:
    """Densities (B, n) of places that are those of `values` plus a normal error of standard deviation `sd`, in nodes.

    The error (n,), or (B, n), may vary along the grid: each part of a density is convolved with the two nearest of
    `WIDTHS` kernels, mixed so that its variance is exact. An error below one node changes nothing.
    """
    sd = np.minimum(sd, values.shape[1] - 1)
    if sd.max() < 1.0:
        return values
    kernels = np.linspace(0.0, sd.max(), WIDTHS)
    shares = [np.interp(sd**2, kernels**2, unit) for unit in np.eye(WIDTHS)]
    parts, rows, widths = [], [], []
    for kernel, share in zip(kernels, shares, strict=True):
        part = share * values
        there = np.flatnonzero(part.max(axis=1) > FAINT)
        parts.append(part[there])
        rows.append(there)
        widths.append(np.full(len(there), kernel))
    wide = blurred(np.concatenate(parts), np.concatenate(rows), np.concatenate(widths), len(values))
    return np.asarray(wide / wide.max(axis=1, keepdims=True))
