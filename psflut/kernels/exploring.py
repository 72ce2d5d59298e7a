"""Compiled: the search over distances, of which few are looked at.

Distances are places on an even grid of `PLACES` steps over the table, so fine that no patch asks for more. A gap is
halved as long as the last halving surprised: as long as what was found differed from the cubic through the four nearest
by more than matters so far below the best. The same cubic through their spectra is where each climb starts.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from psflut.kernels import climbing, compiled, inlined
from psflut.kernels.climbing import Model, Patch, Room, climb

Floats = NDArray[np.float64]
Places = NDArray[np.int64]

PLACES = 4096
"""Steps of the grid of distances."""

COARSE = 8
"""Gaps in which the table is first, each of which is halved at least once."""

DEEP, LIKELY = 0.25, 10.0
"""The surprise that is allowed so many nats below the best, in those, beyond `LIKELY` nats; within, in proportion."""

FLANK = 0.3
"""Nats by which the neighbours of the best differ from it at most."""

GRADED = 4
"""How many times longer than the next a gap may be: else a cubic through them rings."""


class Found(NamedTuple):
    """Up to R distances of each of B patches, in the order in which they were looked at.

    Parameters
    ----------
    seen : (B,) array
        How many.
    order : (B, R) array
        Their numbers, the lowest distance first.
    place, after : (B, R) arrays
        On the grid; and number of the next higher, -1 after the last.
    log_evidence, surprise : (B, R) arrays
        Nats; of the gap that follows.
    theta : (B, R, J) array
    """

    seen: Places
    order: Places
    place: Places
    after: Places
    log_evidence: Floats
    surprise: Floats
    theta: Floats


class Looked(NamedTuple):
    """One patch's rows of `Found`."""

    place: Places
    after: Places
    log_evidence: Floats
    surprise: Floats
    theta: Floats


def nothing(count: int, most: int, terms: int) -> Found:
    """Room for so many distances of each of `count` patches, and none found yet."""
    order, place, after = np.empty((3, count, most), np.int64)
    log_evidence, surprise = np.empty((2, count, most))
    return Found(np.zeros(count, np.int64), order, place, after, log_evidence, surprise, np.empty((count, most, terms)))


def explore(
    power: Floats, noise: Floats, share: Floats, start: Floats, model: Model, found: Found, surprise: float
) -> None:
    """Look at distances of every patch until none is left that would surprise by more nats than that.

    `found` is filled or, where it is not empty, worked out anew with shapes that count for a share (B,) below 1. Power
    and noise are (B, K), `start` the (B, J) coefficients at the nearest end of the grid.
    """
    shape, four, part = share[:, None] * model.shape, np.zeros(4, np.int64), np.zeros(4)
    _explore(power, noise, shape, share, start, model, found, surprise, climbing.room(model), four, part)


@compiled
def _explore(
    power: Floats,
    noise: Floats,
    shape: Floats,
    share: Floats,
    start: Floats,
    model: Model,
    found: Found,
    surprise: float,
    room: Room,
    four: Places,
    part: Floats,
) -> None:
    for b in range(len(power)):
        patch = Patch(power[b], noise[b], shape[b])
        own = Looked(found.place[b], found.after[b], found.log_evidence[b], found.surprise[b], found.theta[b])
        count = found.seen[b]
        if count == 0:
            count, best = COARSE + 1, _begin(patch, start[b], own, model, room)
        else:
            best = _again(patch, share[b], own, count, model, room)
        while True:
            before = count
            count, best = _refine(patch, own, count, best, model, surprise, room, four, part)
            if count == before:
                break
        found.seen[b], point = count, 0
        for r in range(count):
            found.order[b, r] = point
            point = own.after[point]


@inlined
def _begin(patch: Patch, start: Floats, own: Looked, model: Model, room: Room) -> float:
    """The ends of `COARSE` equal gaps, each climb starting from its neighbour's; returns the best log evidence."""
    best = -np.inf
    for r in range(COARSE + 1):
        for j in range(len(start)):
            own.theta[r, j] = start[j] if r == 0 else own.theta[r - 1, j]
        own.place[r], own.after[r], own.surprise[r] = r * PLACES // COARSE, r + 1, np.inf
        own.log_evidence[r] = climb(patch, model.attenuation[own.place[r]], model, own.theta[r], best, room)
        best = max(best, own.log_evidence[r])
    own.after[COARSE] = -1
    return best


@inlined
def _again(patch: Patch, share: float, own: Looked, count: int, model: Model, room: Room) -> float:
    """Every distance once more where shapes count for less, the best first; returns the best log evidence."""
    top = 0
    for r in range(1, count):
        if own.log_evidence[r] > own.log_evidence[top]:
            top = r
    if share == 1.0:
        return float(own.log_evidence[top])
    best = -np.inf
    for n in range(count):
        r = top if n == 0 else n - 1 if n <= top else n
        own.surprise[r] *= share
        own.log_evidence[r] = climb(patch, model.attenuation[own.place[r]], model, own.theta[r], best, room)
        best = max(best, own.log_evidence[r])
    return best


@inlined
def _refine(
    patch: Patch,
    own: Looked,
    count: int,
    best: float,
    model: Model,
    surprise: float,
    room: Room,
    four: Places,
    part: Floats,
) -> tuple[int, float]:
    """Halve every gap that asks for it, once, in order; returns how many there are then, and the best log evidence."""
    place, after, log, theta = own.place, own.after, own.log_evidence, own.theta
    r, before = 0, -1
    while after[r] >= 0 and count < len(place):
        q = after[r]
        gap, below = place[q] - place[r], best - max(log[r], log[q])
        asks = own.surprise[r] > surprise + DEEP * below * min(1.0, below / LIKELY)
        asks |= below == 0.0 and abs(log[r] - log[q]) > FLANK
        asks |= before >= 0 and gap > GRADED * (place[r] - place[before])
        asks |= after[q] >= 0 and gap > GRADED * (place[after[q]] - place[q])
        last = r
        if gap > 1 and asks:
            new, count = count, count + 1
            place[new] = place[r] + gap // 2
            _cubic(place[new], r if before < 0 else before, place, after, four, part)
            expected = 0.0
            for j in range(theta.shape[1]):
                theta[new, j] = 0.0
            for i in range(4):
                expected += part[i] * log[four[i]]
                for j in range(theta.shape[1]):
                    theta[new, j] += part[i] * theta[four[i], j]
            log[new] = climb(patch, model.attenuation[place[new]], model, theta[new], best, room)
            own.surprise[r] = own.surprise[new] = abs(log[new] - expected)
            best = max(best, log[new])
            after[r], after[new] = new, q
            last = new
        before, r = last, q
    return count, best


@inlined
def _cubic(x: int, first: int, place: Places, after: Places, four: Places, part: Floats) -> None:
    """The points about a gap, four from the `first` on or as many as there are, and their shares in the polynomial
    through them at x (Lagrange's)."""
    count, point = 0, first
    for i in range(4):
        part[i], four[i] = 0.0, first
        if point >= 0:
            four[i], count = point, count + 1
            point = after[point]
    for i in range(count):
        part[i] = 1.0
        for j in range(count):
            if j != i:
                part[i] *= (x - place[four[j]]) / (place[four[i]] - place[four[j]])
