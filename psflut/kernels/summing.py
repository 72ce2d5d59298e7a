"""Compiled: a correlation with few weights, sum by sum."""

import numpy as np
from numpy.typing import NDArray

from psflut.kernels import compiled

AT_ONCE = 8
"""Weights that are summed in one pass over a line: their number is a multiple of it."""


@compiled
def correlate(
    flat: NDArray[np.floating],
    stride: int,
    weight: NDArray[np.floating],
    offset: NDArray[np.int64],
    out: NDArray[np.floating],
) -> None:
    """Fill `out` with the sums over an image, given line after line, at those offsets from each pixel."""
    for y in range(out.shape[0]):
        line = out[y]
        for x in range(len(line)):
            line[x] = 0
        for i in range(0, len(weight), AT_ONCE):
            a, b, c, d = weight[i], weight[i + 1], weight[i + 2], weight[i + 3]
            e, f, g, h = weight[i + 4], weight[i + 5], weight[i + 6], weight[i + 7]
            at = y * stride
            p, q, r, s = (
                flat[at + offset[i] :],
                flat[at + offset[i + 1] :],
                flat[at + offset[i + 2] :],
                flat[at + offset[i + 3] :],
            )
            t, u, v, w = (
                flat[at + offset[i + 4] :],
                flat[at + offset[i + 5] :],
                flat[at + offset[i + 6] :],
                flat[at + offset[i + 7] :],
            )
            for x in range(len(line)):
                first = a * p[x] + b * q[x] + c * r[x] + d * s[x]
                line[x] += first + (e * t[x] + f * u[x] + g * v[x] + h * w[x])
