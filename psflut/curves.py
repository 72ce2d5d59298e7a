"""Compiled: a cubic spline on a fine grid, and where one mode of a density ends and the next begins."""

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Function = TypeVar("Function", bound=Callable[..., Any])


def _compiled(function: Function) -> Function:
    """Compiled once and kept: beside this file, else in the user's cache, else for this process alone."""
    try:
        return njit(cache=True, nogil=True)(function)  # type: ignore[no-any-return]
    except RuntimeError:
        return njit(nogil=True)(function)  # type: ignore[no-any-return]


@_compiled
def spline(places: Floats, values: Floats, out: Floats) -> None:
    """The not-a-knot spline through M >= 4 ascending places, at ``len(out)`` even ones from the first to the last."""
    count = len(places)
    step = np.diff(places)
    rise = np.diff(values) / step
    diagonal, above, slope = np.empty(count), np.empty(count), np.empty(count)
    diagonal[0], above[0] = step[1], step[0] + step[1]
    slope[0] = ((step[0] + 2 * above[0]) * step[1] * rise[0] + step[0] ** 2 * rise[1]) / above[0]
    for i in range(1, count):
        if i < count - 1:
            below, own, above[i] = step[i], 2 * (step[i - 1] + step[i]), step[i - 1]
            right = 3 * (step[i] * rise[i - 1] + step[i - 1] * rise[i])
        else:
            below, own = step[-1] + step[-2], step[-2]
            right = (step[-1] ** 2 * rise[-2] + (2 * below + step[-1]) * step[-2] * rise[-1]) / below
        part = below / diagonal[i - 1]
        diagonal[i] = own - part * above[i - 1]
        slope[i] = right - part * slope[i - 1]
    slope[-1] /= diagonal[-1]
    for i in range(count - 2, -1, -1):
        slope[i] = (slope[i] - above[i] * slope[i + 1]) / diagonal[i]
    k, fine = 0, (places[-1] - places[0]) / (len(out) - 1)
    for n in range(len(out)):
        x = places[0] + n * fine
        while k < count - 2 and x >= places[k + 1]:
            k += 1
        t = x - places[k]
        bend = (slope[k] + slope[k + 1] - 2 * rise[k]) / step[k]
        out[n] = values[k] + t * (slope[k] + t * ((rise[k] - slope[k]) / step[k] - bend + t * bend / step[k]))


@_compiled
def borders(values: Floats, lowest: float, valley: float) -> NDArray[np.int64]:
    """Nodes of a density where modes end: the first, the lowest between neighbouring modes, the last.

    A peak is a mode if it is no lower than `lowest`, and the density falls below `valley` of it on both sides before a
    higher one, as beyond the ends.
    """
    count = len(values)
    peaks, modes = np.empty(count, np.int64), 0
    n = 0
    while n < count:
        end = n
        while end + 1 < count and values[end + 1] == values[n]:
            end += 1
        height = values[n]
        rises = n == 0 or values[n - 1] < height
        falls = end == count - 1 or values[end + 1] < height
        if rises and falls and height >= lowest:
            floors = np.array([height, height])
            for side in range(2):
                k = end if side else n
                while True:
                    k += 1 if side else -1
                    if k < 0 or k == count:
                        floors[side] = 0.0
                        break
                    if values[k] > height:
                        break
                    floors[side] = min(floors[side], values[k])
            if max(floors[0], floors[1]) <= valley * height:
                peaks[modes] = (n + end) // 2
                modes += 1
        n = end + 1
    cuts = np.zeros(max(modes, 1) + 1, np.int64)
    cuts[-1] = count - 1
    for m in range(1, modes):
        cuts[m] = peaks[m - 1] + np.argmin(values[peaks[m - 1] : peaks[m]])
    return cuts
