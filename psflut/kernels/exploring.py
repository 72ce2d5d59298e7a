"""Compiled: the search over distances, of which few are looked at.

Distances are places on an even grid of `PLACES` steps over the table, so fine that no patch asks for more. A gap is
halved as long as the last halving surprised: as long as what was found differed from the cubic through the four nearest
by more than matters so far below the best. The same cubic through their spectra is where each climb starts. All that
the gaps of all patches ask for is climbed together.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from psflut.kernels import compiled, inlined
from psflut.kernels.climbing import climb
from psflut.kernels.lanes import Model, Patches, Room, Summits, room

Floats = NDArray[np.float64]
Places = NDArray[np.int64]

PLACES = 4096
"""Steps of the grid of distances."""

COARSE, WIDEST = 2, PLACES // 16
"""Gaps in which the table is first; steps of the widest gap that is left."""

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
    place, before, after : (B, R) arrays
        On the grid; number of the lower end of the gap that each halved; of the next higher, -1 after the last.
    log_evidence, surprise : (B, R) arrays
        Nats; of the gap that follows.
    theta : (B, R, J) array
    """

    seen: Places
    order: Places
    place: Places
    before: Places
    after: Places
    log_evidence: Floats
    surprise: Floats
    theta: Floats


def begun(start: Floats, most: int) -> Found:
    """The ends of `COARSE` equal gaps, not yet looked at, and theta (B, COARSE + 1, J) where their climbs start, in
    room for so many distances of each of B patches."""
    count, ends, terms = start.shape
    order, place, before, after = np.empty((4, count, most), np.int64)
    log_evidence, surprise = np.full((2, count, most), np.inf)
    theta = np.empty((count, most, terms))
    theta[:, :ends] = start
    place[:, :ends], after[:, :ends] = np.linspace(0, PLACES, ends), np.r_[1:ends, -1]
    return Found(np.full(count, ends), order, place, before, after, log_evidence, surprise, theta)


def explore(power: Floats, noise: Floats, share: Floats, model: Model, found: Found, surprise: float) -> None:
    """Look at distances of every patch until none is left that would surprise by more nats than that.

    What is found already is worked out anew where shapes count for a share (B,) below 1, or where it never was. Power
    and noise are (B, S, R), by sector and annulus.
    """
    patches = Patches(power, noise, share[:, None, None] * model.shape)
    _explore(patches, share, model, found, surprise, np.empty(found.place.size, np.int64), room(model))


@compiled
def _explore(
    patches: Patches, share: Floats, model: Model, found: Found, surprise: float, which: Places, room: Room
) -> None:
    count, most = found.place.shape
    summits = Summits(found.place, found.theta, found.log_evidence, np.empty(count))
    asking, first, four, part = np.ones(count, np.bool_), found.seen.copy(), np.zeros(4, np.int64), np.zeros(4)
    tops, asked = _again(share, found, summits.best, which)
    going = True
    while going:
        for begin, end in ((0, tops), (tops, asked)):
            climb(which[begin:end], patches, summits, model, room)
            _note(which[begin:end], summits)
        for n in range(asked):
            b, r = which[n] // most, which[n] % most
            if r >= first[b]:
                _link(b, r, found)
        tops, asked = 0, 0
        for b in range(count):
            if asking[b]:
                first[b] = found.seen[b]
                _ask(b, found, summits.best[b], surprise, four, part)
                asking[b] = found.seen[b] > first[b]
                for r in range(first[b], found.seen[b]):
                    which[asked] = b * most + r
                    asked += 1
        going = asked > 0
    for b in range(count):
        point = 0
        for r in range(found.seen[b]):
            found.order[b, r] = point
            point = found.after[b, point]


@inlined
def _note(which: Places, summits: Summits) -> None:
    """Note what is best of each patch, of these too."""
    for n in range(len(which)):
        b, r = which[n] // summits.place.shape[1], which[n] % summits.place.shape[1]
        summits.best[b] = max(summits.best[b], summits.log_evidence[b, r])


@inlined
def _again(share: Floats, found: Found, best: Floats, which: Places) -> tuple[int, int]:
    """List every distance that is to be looked at anew, the best of each patch first; returns how many these are, and
    all."""
    count, most = found.place.shape
    asked = 0
    for b in range(count):
        top = 0
        for r in range(1, found.seen[b]):
            if found.log_evidence[b, r] > found.log_evidence[b, top]:
                top = r
        best[b] = found.log_evidence[b, top]
        if share[b] < 1.0 or best[b] == np.inf:
            best[b] = -np.inf
            which[asked] = b * most + top
            asked += 1
    tops = asked
    for n in range(tops):
        b, top = which[n] // most, which[n] % most
        for r in range(found.seen[b]):
            found.surprise[b, r] *= share[b]
            if r != top:
                which[asked] = b * most + r
                asked += 1
    return tops, asked


@inlined
def _ask(b: int, found: Found, best: float, surprise: float, four: Places, part: Floats) -> None:
    """Halve every gap of a patch that asks for it: what is expected there stands in for the surprise."""
    place, after, log, theta = found.place[b], found.after[b], found.log_evidence[b], found.theta[b]
    r, before, count = 0, -1, found.seen[b]
    while after[r] >= 0 and count < len(place):
        q = after[r]
        gap, below = place[q] - place[r], best - max(log[r], log[q])
        asks = found.surprise[b, r] > surprise + DEEP * below * min(1.0, below / LIKELY)
        asks |= gap > WIDEST or (below <= 0.0 and abs(log[r] - log[q]) > FLANK)
        asks |= before >= 0 and gap > GRADED * (place[r] - place[before])
        asks |= after[q] >= 0 and gap > GRADED * (place[after[q]] - place[q])
        if gap > 1 and asks:
            place[count], found.before[b, count] = place[r] + gap // 2, r
            _cubic(place[count], r if before < 0 else before, place, after, four, part)
            expected = 0.0
            for j in range(theta.shape[1]):
                theta[count, j] = 0.0
            for i in range(4):
                expected += part[i] * log[four[i]]
                for j in range(theta.shape[1]):
                    theta[count, j] += part[i] * theta[four[i], j]
            found.surprise[b, count] = expected
            count += 1
        before, r = r, q
    found.seen[b] = count


@inlined
def _link(b: int, r: int, found: Found) -> None:
    """Put a distance that was looked at between its neighbours."""
    before = found.before[b, r]
    found.after[b, r], found.after[b, before] = found.after[b, before], r
    surprise = abs(found.log_evidence[b, r] - found.surprise[b, r])
    found.surprise[b, r] = found.surprise[b, before] = surprise


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
