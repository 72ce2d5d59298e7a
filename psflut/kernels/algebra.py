"""Compiled: small systems of equations, many at once, whose matrices are packed by rows.

A symmetric matrix of order J is its upper triangle, row after row: J (J + 1) / 2 numbers. Systems lie side by side,
(J (J + 1) / 2, n), so that processors work on several of them at a time.
"""

import numpy as np
from numpy.typing import NDArray

from psflut.kernels import compiled

Floats = NDArray[np.float64]


@compiled
def solve(count: int, packed: Floats, right: Floats, log_determinant: Floats, room: Floats) -> None:
    """Fill `right` (J, n) with x of A x = right, A positive, and the logarithms (n,) of their determinants: NaN where
    an A is not positive. Only the first `count` systems count.

    Gauss' elimination without pivots. The matrices are lost; `room` is (2, n).
    """
    order, row = len(right), 0
    share, determinant = room[0], room[1]
    for n in range(count):
        determinant[n] = 1.0
    for j in range(order):
        pivot, own, below = packed[row], right[j], row + order - j
        for n in range(count):
            determinant[n] *= pivot[n] if pivot[n] > 0.0 else np.nan
            pivot[n] = 1.0 / pivot[n]
        for i in range(1, order - j):
            beside = packed[row + i]
            for n in range(count):
                share[n] = beside[n] * pivot[n]
            for m in range(i, order - j):
                one, other = packed[below + m - i], packed[row + m]
                for n in range(count):
                    one[n] -= share[n] * other[n]
            under = right[j + i]
            for n in range(count):
                under[n] -= share[n] * own[n]
            below += order - j - i
        row += order - j
    for j in range(order - 1, -1, -1):
        row -= order - j
        own = right[j]
        for i in range(1, order - j):
            beside, under = packed[row + i], right[j + i]
            for n in range(count):
                own[n] -= beside[n] * under[n]
        for n in range(count):
            own[n] *= packed[row, n]
    for n in range(count):
        log_determinant[n] = np.log(determinant[n])
