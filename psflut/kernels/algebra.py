"""Compiled: sums of weighted rows, and Cholesky's factor of a small matrix packed by rows.

A symmetric matrix of order J is its upper triangle, row after row: J (J + 1) / 2 numbers, and what comes after them is
nothing.
"""

import numpy as np
from numpy.typing import NDArray

from psflut.kernels import compiled

Floats = NDArray[np.float64]

STRIDE = 16
"""Compiled loops run over so many numbers at a time and are slow over what is left: lengths are multiples of it."""


@compiled
def combined(start: Floats, weight: Floats, rows: Floats, out: Floats) -> None:
    """Fill `out` (n,) with `start` and the rows (K, n), each times its weight; K is a multiple of 4."""
    for m in range(len(out)):
        out[m] = start[m]
    for k in range(0, len(weight), 4):
        a, b, c, d = weight[k], weight[k + 1], weight[k + 2], weight[k + 3]
        for m in range(len(out)):
            out[m] += a * rows[k, m] + b * rows[k + 1, m] + c * rows[k + 2, m] + d * rows[k + 3, m]


@compiled
def factorise(packed: Floats, right: Floats, order: int) -> float:
    """Cholesky's factor R, packed = R' R, in its place, its diagonal inverted; and the first J of `right` solved by R'.

    Returns the logarithm of the determinant, NaN where the matrix is not positive.
    """
    determinant, row = 1.0, 0
    for j in range(order):
        if packed[row] <= 0.0:
            return np.nan
        determinant *= packed[row]
        scale, count, other = 1.0 / np.sqrt(packed[row]), order - j, row + order - j
        packed[row] = scale
        right[j] *= scale
        for k in range(1, count):
            packed[row + k] *= scale
        for i in range(1, count):
            share = packed[row + i]
            for k in range(i, count):
                packed[other + k - i] -= share * packed[row + k]
            right[j + i] -= share * right[j]
            other += count - i
        row += count
    return float(np.log(determinant))


@compiled
def back(packed: Floats, right: Floats, out: Floats) -> None:
    """The solution of R x = right, R as `factorise` leaves it."""
    order = len(out)
    row = order * (order + 1) // 2
    for j in range(order - 1, -1, -1):
        row -= order - j
        rest = right[j]
        for k in range(1, order - j):
            rest -= packed[row + k] * out[j + k]
        out[j] = rest * packed[row]
