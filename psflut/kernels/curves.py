"""Compiled: densities from splines through their logarithms, and where one mode ends and the next begins.

Rows are densities of several patches; each is worked out alone.
"""

import numpy as np
from numpy.typing import NDArray

from psflut.kernels import compiled, inlined
from psflut.kernels.elementary import exponentials

Floats = NDArray[np.float64]
Places = NDArray[np.int64]

CUTOFF = 40.0
"""Nats below its highest value where a kernel counts as nothing."""


@compiled
def densities(places: Floats, values: Floats, counts: Places, out: Floats) -> None:
    """Fill `out` (B, n) with e to the not-a-knot splines through ``counts`` (B,) ascending places, at even ones from
    the first to the last; its largest value is 1. Places and values are (B, M), M >= 4."""
    bits = np.empty(out.shape[1], np.int64)
    number = bits.view(np.float64)
    for b in range(len(out)):
        row = out[b]
        spline(places[b, : counts[b]], values[b, : counts[b]], row)
        top = row[0]
        for n in range(len(row)):
            top = max(top, row[n])
        for n in range(len(row)):
            row[n] -= top
        exponentials(row, row, bits, number)


@inlined
def spline(places: Floats, values: Floats, out: Floats) -> None:
    """The not-a-knot spline through M >= 4 ascending places, at ``len(out)`` even ones from the first to the last."""
    count = len(places)
    last = count - 1
    step, rise = np.empty(last), np.empty(last)
    for i in range(last):
        step[i] = places[i + 1] - places[i]
        rise[i] = (values[i + 1] - values[i]) / step[i]
    diagonal, above, slope = np.empty(count), np.empty(count), np.empty(count)
    diagonal[0], above[0] = step[1], step[0] + step[1]
    slope[0] = ((step[0] + 2 * above[0]) * step[1] * rise[0] + step[0] ** 2 * rise[1]) / above[0]
    for i in range(1, count):
        if i < last:
            below, own, above[i] = step[i], 2 * (step[i - 1] + step[i]), step[i - 1]
            right = 3 * (step[i] * rise[i - 1] + step[i - 1] * rise[i])
        else:
            below, own = step[i - 1] + step[i - 2], step[i - 2]
            right = (step[i - 1] ** 2 * rise[i - 2] + (2 * below + step[i - 1]) * step[i - 2] * rise[i - 1]) / below
        part = below / diagonal[i - 1]
        diagonal[i] = own - part * above[i - 1]
        slope[i] = right - part * slope[i - 1]
    slope[last] /= diagonal[last]
    for i in range(last - 1, -1, -1):
        slope[i] = (slope[i] - above[i] * slope[i + 1]) / diagonal[i]
    fine, n = (places[last] - places[0]) / (len(out) - 1), 0
    for k in range(last):
        end = len(out) if k == last - 1 else min(int(np.ceil((places[k + 1] - places[0]) / fine)), len(out))
        bend = (slope[k] + slope[k + 1] - 2 * rise[k]) / step[k]
        square, cube = (rise[k] - slope[k]) / step[k] - bend, bend / step[k]
        for m in range(n, end):
            t = places[0] + m * fine - places[k]
            out[m] = values[k] + t * (slope[k] + t * (square + t * cube))
        n = max(n, end)


@compiled
def cumulate(values: Floats, out: Floats) -> None:
    """Fill `out` (B, n) with the probability below each node, by the trapezium rule."""
    for b in range(len(values)):
        total = 0.0
        out[b, 0] = 0.0
        for n in range(1, values.shape[1]):
            total += values[b, n - 1] + values[b, n]
            out[b, n] = total
        for n in range(values.shape[1]):
            out[b, n] /= total


@compiled
def modes(values: Floats, lowest: float, valley: float, first: Places) -> Places:
    """Nodes of densities (B, n) where modes end, row after row: of each the first node, the lowest between neighbouring
    modes, the last. Fills `first` (B + 1,) with where each row's begin.

    A peak is a mode if it is no lower than `lowest`, and the density falls below `valley` of it on both sides before a
    higher one, as beyond the ends. The largest value of each row is 1.
    """
    rows, count = values.shape
    cuts, total = np.empty(rows * (count + 2), np.int64), 0
    first[0] = 0
    for b in range(rows):
        row, last, n = values[b], -1, 0
        cuts[total] = 0
        total += 1
        while n < count:
            height, end = row[n], n
            if height < lowest or (n > 0 and row[n - 1] > height):
                n += 1
                continue
            while end + 1 < count and row[end + 1] == height:
                end += 1
            falls = end == count - 1 or row[end + 1] < height
            if falls and _stands_out(row, n, end, valley * height):
                peak = (n + end) // 2
                if last >= 0:
                    cut = last
                    for k in range(last, peak):
                        if row[k] < row[cut]:
                            cut = k
                    cuts[total] = cut
                    total += 1
                last = peak
            n = end + 1
        cuts[total] = count - 1
        total += 1
        first[b + 1] = total
    return cuts[:total].copy()


@inlined
def _stands_out(row: Floats, first: int, last: int, floor: float) -> bool:
    """Whether values fall to the floor on both sides of a peak's nodes before they rise above it."""
    height, k = row[first], first - 1
    while k >= 0 and row[k] > floor:
        if row[k] > height:
            return False
        k -= 1
    k = last + 1
    while k < len(row) and row[k] > floor:
        if row[k] > height:
            return False
        k += 1
    return True


@compiled
def quantiles(cumulative: Floats, rows: Places, probabilities: Floats, out: Floats) -> None:
    """Fill `out` (m,) with the nodes, and parts of them, below which these probabilities lie in those rows."""
    for m in range(len(rows)):
        own, low, high = cumulative[rows[m]], 0, cumulative.shape[1] - 1
        while high - low > 1:
            middle = (low + high) // 2
            if own[middle] <= probabilities[m]:
                low = middle
            else:
                high = middle
        rise = own[high] - own[low]
        out[m] = low + ((probabilities[m] - own[low]) / rise if rise > 0 else 0.0)


@compiled
def blur(waves: Floats, rows: Places, sds: Floats, out: Floats) -> None:
    """Add cosine transforms (m, n), each under a normal kernel of so many nodes, to the rows of `out` they are of."""
    count = waves.shape[1]
    for m in range(len(rows)):
        fall = 0.5 * (np.pi * sds[m] / count) ** 2
        end = count if fall * count**2 <= CUTOFF else int(np.sqrt(CUTOFF / fall)) + 1
        for k in range(end):
            out[rows[m], k] += waves[m, k] * np.exp(-fall * k * k)


@compiled
def blend(values: Floats, wide: Floats, share: float) -> None:
    """Densities (B, n) of which that share is replaced by as much of others, in the place of the latter; the largest
    value is 1."""
    for b in range(len(values)):
        total, others, top = 0.0, 0.0, 0.0
        for n in range(values.shape[1]):
            total += values[b, n]
            others += wide[b, n]
        one, two = (1.0 - share) / total, share / others
        for n in range(values.shape[1]):
            wide[b, n] = one * values[b, n] + two * wide[b, n]
            top = max(top, wide[b, n])
        for n in range(values.shape[1]):
            wide[b, n] /= top
