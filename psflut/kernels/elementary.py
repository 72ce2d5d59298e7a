"""Compiled: exponentials and logarithms of many numbers at once, by polynomials that processors take four at a time.

A power of two is put together, or taken apart, in the bits of a number: ``bits`` is an array of integers and ``number``
the same memory read as numbers. Errors are below 1e-8, where 1e-6 would do.
"""

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from numpy.typing import NDArray

from psflut.kernels import compiled

Floats = NDArray[np.float64]
Bits = NDArray[np.int64]

LN2, FARTHEST = 0.6931471805599453, 700.0
MANTISSA, BIAS = 52, 1023
ROOT_HALF = 0x3FE6A09E667F3BCD
"""Bits of the root of one half: numbers are taken apart so that what is left lies within a root of two of 1."""

LOG = tuple(
    Chebyshev.interpolate(lambda x: np.log1p(x) / x, 9, (0.5**0.5 - 1, 2**0.5 - 1)).convert(kind=Polynomial).coef
)
"""Coefficients of ln(1 + x) / x there: a division takes as long as ten of them."""


@compiled
def exponentials(values: Floats, out: Floats, bits: Bits, number: Floats) -> None:
    """e to each value, values beyond `FARTHEST` counting as that."""
    for k in range(len(values)):
        x = min(max(values[k], -FARTHEST), FARTHEST)
        power = np.floor(x / LN2 + 0.5)
        r = x - power * LN2
        high = 1 / 24 + r * (1 / 120 + r * (1 / 720 + r / 5040))
        out[k] = 1 + r * (1 + r * (1 / 2 + r * (1 / 6 + r * high)))
        bits[k] = (np.int64(np.int32(power)) + BIAS) << MANTISSA
    for k in range(len(values)):
        out[k] *= number[k]


@compiled
def logarithms(values: Bits, out: Floats, bits: Bits, number: Floats) -> None:
    """The natural logarithm of positive numbers, given by their bits."""
    for k in range(len(values)):
        power = (values[k] - ROOT_HALF) >> MANTISSA
        bits[k] = values[k] - (power << MANTISSA)
        out[k] = np.float64(np.int32(power)) * LN2
    for k in range(len(values)):
        x = number[k] - 1.0
        high = LOG[5] + x * (LOG[6] + x * (LOG[7] + x * (LOG[8] + x * LOG[9])))
        out[k] += x * (LOG[0] + x * (LOG[1] + x * (LOG[2] + x * (LOG[3] + x * (LOG[4] + x * high)))))
