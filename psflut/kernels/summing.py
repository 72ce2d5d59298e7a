"""Compiled: sums over the neighbours of every pixel."""

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


@compiled
def laplacian(images: NDArray[np.floating], taper: NDArray[np.floating], out: NDArray[np.floating]) -> None:
    """Fill `out` (B, H - 2, W - 2) with 6 (g - s s g) of images (B, H, W) times a taper (H - 2, W - 2), s the means
    (1, 4, 1) / 6 down and across: the isotropic Laplacian."""
    for b in range(out.shape[0]):
        for y in range(out.shape[1]):
            above, here, under = images[b, y], images[b, y + 1], images[b, y + 2]
            for x in range(out.shape[2]):
                beside = above[x + 1] + here[x] + here[x + 2] + under[x + 1]
                corners = above[x] + above[x + 2] + under[x] + under[x + 2]
                out[b, y, x] = taper[y, x] * ((20 * here[x + 1] - 4 * beside - corners) / 6)
