"""Compiled: sums of weighted rows, and small systems of equations whose matrix is packed by rows.

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
def solve(packed: Floats, right: Floats, rows: Floats, out: Floats) -> float:
    """Fill `out` (J,) with x of A x = right, A positive; returns ln det A, NaN where A is not positive.

    Gauss and Jordan's elimination without pivots, J < `STRIDE`. Whole rows of that length are worked on, `right` the
    column after the last: loops of known length take a quarter of the time that Cholesky's, over what is left of
    a row, and substitution took. `rows` is (J, STRIDE) room; what is left of the diagonal there means nothing. `packed`
    has `STRIDE` numbers more than it needs.
    """
    order, row, determinant = len(out), 0, 1.0
    for j in range(order):
        for k in range(STRIDE):
            rows[j, k] = packed[row - j + k]
        rows[j, order] = right[j]
        row += order - j
    for j in range(order):
        pivot = rows[j, j]
        if pivot <= 0.0:
            return np.nan
        determinant *= pivot
        out[j] = 1.0 / pivot
        for i in range(order):
            share = out[j] * (rows[i, j] if i < j else rows[j, i])  # below the diagonal A is what it is above it
            if i != j:
                for k in range(STRIDE):
                    rows[i, k] -= share * rows[j, k]
    for j in range(order):
        out[j] *= rows[j, order]
    return float(np.log(determinant))
