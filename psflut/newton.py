"""Compiled: Newton's method for the scene's spectrum at one distance, and the search over distances with it.

For each distance the log density of theta, ln p(P | z, theta) + ln p(theta) (`psflut.evidence`), is climbed by Newton's
method with the exact curvature, held to be positive, and the integral over theta is Laplace's. Distances are places on
an even grid of `PLACES` steps over the table, so fine that no patch asks for more; few are looked at. A gap between two
is halved as long as the last halving surprised: as long as what was found differed from the cubic through the four
nearest by more than matters so far below the best.

Alone of psflut's modules this one imports numba, and is itself imported where it is called: loading it takes 0.3 s. All
compiled code is in this one file because numba's cache looks at no other for changes. One step takes 2 to 4 us
(43 and 89 annuli), in numpy 12 to 15.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Function = TypeVar("Function", bound=Callable[..., Any])

PLACES = 4096
"""Steps of the grid of distances."""

NEWTON_STEPS, TOLERANCE, SLACK = 100, 1e-2, 0.05
"""A climb ends where a step gains less than so many nats, which are counted, and this share of what it is below the
patch's best."""

LEAST_CURVATURE, LONGEST_STEP = 0.2, 3.0
"""Of a Newton step: share of Fisher's information, and nats of ln S at any annulus; the quadratic model reaches no
further."""

COARSE = 16
"""Gaps in which the table is first, each of which is halved at least once."""

DEEP, LIKELY = 0.25, 10.0
"""The surprise that is allowed so many nats below the best, in those, beyond `LIKELY` nats; within, in proportion."""

FLANK = 0.3
"""Nats by which the neighbours of the best differ from it at most."""

GRADED = 4
"""How many times longer than the next a gap may be: else a cubic through them rings."""


class Model(NamedTuple):
    """What all patches of one shape share.

    Parameters
    ----------
    attenuation : (M, K) array
    shape : (K,) array
    basis : (J, K) array
    products : (J (J + 1) / 2, K) array
        Of any two basis functions, the lower triangle row by row.
    mean, precision : (J,), (J, J) arrays
        Of the prior.
    """

    attenuation: Floats
    shape: Floats
    basis: Floats
    products: Floats
    mean: Floats
    precision: Floats


class Found(NamedTuple):
    """Up to R distances of each of B patches, in the order in which they were looked at.

    Parameters
    ----------
    seen : (B,) array
        How many.
    place, after : (B, R) arrays
        On the grid; and number of the next higher, -1 after the last.
    log_evidence, surprise : (B, R) arrays
        Nats; of the gap that follows.
    theta : (B, R, J) array
    """

    seen: NDArray[np.int64]
    place: NDArray[np.int64]
    after: NDArray[np.int64]
    log_evidence: Floats
    surprise: Floats
    theta: Floats


class _Room(NamedTuple):
    """Arrays to work in: over annuli (K,), over coefficients (J,) and (J, J)."""

    scene: Floats
    mean: Floats
    slope: Floats
    weight: Floats
    held: Floats
    gradient: Floats
    step: Floats
    factor: Floats


def nothing(count: int, most: int, terms: int) -> Found:
    """Room for so many distances of each of `count` patches, and none found yet."""
    place, after = np.zeros((2, count, most), np.int64)
    log_evidence, surprise = np.zeros((2, count, most))
    return Found(np.zeros(count, np.int64), place, after, log_evidence, surprise, np.zeros((count, most, terms)))


def _compiled(function: Function) -> Function:
    """Compiled once and kept: beside this file, else in the user's cache, else for this process alone."""
    options = {"nogil": True, "fastmath": {"reassoc", "contract", "arcp", "nsz"}}
    try:
        return njit(cache=True, **options)(function)  # type: ignore[no-any-return]
    except RuntimeError:
        return njit(**options)(function)  # type: ignore[no-any-return]


@_compiled
def climb_all(power: Floats, noise: Floats, shape: Floats, model: Model, theta: Floats, log_evidence: Floats) -> None:
    """Fill the log evidence (M,) of every row of the model; theta (M, J) starts there; the rest is (M, K)."""
    room, best = _room(model), -np.inf
    for m in range(len(theta)):
        log_evidence[m] = _climb(power[m], noise[m], shape[m], model.attenuation[m], model, theta[m], best, room)
        best = max(best, log_evidence[m])


@_compiled
def explore(
    power: Floats, noise: Floats, share: Floats, start: Floats, model: Model, found: Found, surprise: float
) -> None:
    """Look at distances of every patch until none is left that would surprise by more nats than that.

    `found` is filled or, where it is not empty, worked out anew with shapes that count for a share (B,) below 1. Power
    and noise are (B, K), `start` the (B, J) coefficients at the nearest end of the grid.
    """
    room = _room(model)
    for b in range(len(power)):
        shape = share[b] * model.shape
        if found.seen[b] == 0:
            best = _begin(b, power[b], noise[b], shape, start[b], model, found, room)
        else:
            best = _again(b, power[b], noise[b], shape, share[b], model, found, room)
        while True:
            count = found.seen[b]
            best = _refine(b, best, power[b], noise[b], shape, model, found, surprise, room)
            if found.seen[b] == count:
                break


@_compiled
def _begin(
    b: int, power: Floats, noise: Floats, shape: Floats, start: Floats, model: Model, found: Found, room: _Room
) -> float:
    """The ends of `COARSE` equal gaps, each climb starting from its neighbour's; returns the best log evidence."""
    best, theta = -np.inf, found.theta[b]
    theta[0] = start
    for r in range(COARSE + 1):
        if r > 0:
            theta[r] = theta[r - 1]
        place = r * PLACES // COARSE
        log = _climb(power, noise, shape, model.attenuation[place], model, theta[r], best, room)
        found.place[b, r], found.after[b, r] = place, r + 1
        found.log_evidence[b, r], found.surprise[b, r] = log, np.inf
        best = max(best, log)
    found.after[b, COARSE], found.seen[b] = -1, COARSE + 1
    return best


@_compiled
def _again(
    b: int, power: Floats, noise: Floats, shape: Floats, share: float, model: Model, found: Found, room: _Room
) -> float:
    """Every distance once more where shapes count for less, the best first; returns the best log evidence."""
    log, theta, count = found.log_evidence[b], found.theta[b], found.seen[b]
    top = int(np.argmax(log[:count]))
    if share == 1.0:
        return float(log[top])
    best = -np.inf
    for r in range(-1, count):
        again = top if r < 0 else r
        if r != top:
            attenuation = model.attenuation[found.place[b, again]]
            log[again] = _climb(power, noise, shape, attenuation, model, theta[again], best, room)
            best = max(best, log[again])
    for r in range(count):
        found.surprise[b, r] *= share
    return best


@_compiled
def _refine(
    b: int,
    best: float,
    power: Floats,
    noise: Floats,
    shape: Floats,
    model: Model,
    found: Found,
    surprise: float,
    room: _Room,
) -> float:
    """Halve every gap that asks for it, once, in order; returns the best log evidence."""
    place, after, log, theta = found.place[b], found.after[b], found.log_evidence[b], found.theta[b]
    four, r, before = np.zeros(4, np.int64), 0, -1
    while after[r] >= 0 and found.seen[b] < len(place):
        q, new = after[r], found.seen[b]
        gap, below = place[q] - place[r], best - max(log[r], log[q])
        asks = found.surprise[b, r] > surprise + DEEP * below * min(1.0, below / LIKELY)
        asks |= below == 0.0 and abs(log[r] - log[q]) > FLANK
        asks |= before >= 0 and gap > GRADED * (place[r] - place[before])
        asks |= after[q] >= 0 and gap > GRADED * (place[after[q]] - place[q])
        if gap > 1 and asks:
            place[new] = place[r] + gap // 2
            part = (place[new] - place[r]) / gap
            for j in range(theta.shape[1]):
                theta[new, j] = (1 - part) * theta[r, j] + part * theta[q, j]
            log[new] = _climb(power, noise, shape, model.attenuation[place[new]], model, theta[new], best, room)
            near = four[: _nearest(before, r, after, four)]
            off = abs(log[new] - _cubic(place[new], place, log, near))
            after[r], after[new], found.seen[b] = new, q, new + 1
            found.surprise[b, r] = found.surprise[b, new] = off
            best = max(best, log[new])
            before = new
        else:
            before = r
        r = q
    return best


@_compiled
def _nearest(before: int, r: int, after: NDArray[np.int64], four: NDArray[np.int64]) -> int:
    """The points about the gap that follows r, one before it and two after where there are; returns how many."""
    point = r if before < 0 else before
    for i in range(4):
        four[i] = point
        point = after[point]
        if point < 0:
            break
    return i + 1


@_compiled
def _cubic(x: float, places: NDArray[np.int64], values: Floats, near: NDArray[np.int64]) -> float:
    """Lagrange's polynomial through these points."""
    total = 0.0
    for i in near:
        term = values[i]
        for j in near:
            if j != i:
                term *= (x - places[j]) / (places[i] - places[j])
        total += term
    return total


@_compiled
def _climb(
    power: Floats,
    noise: Floats,
    shape: Floats,
    attenuation: Floats,
    model: Model,
    theta: Floats,
    best: float,
    room: _Room,
) -> float:
    """The log evidence of one distance, by climbing to the best theta (J,), in place."""
    for _ in range(NEWTON_STEPS):
        value, exact = _derivatives(power, noise, shape, attenuation, model, theta, room)
        _curvature(room.held, model.products, model.precision, room.factor)
        log_determinant = _factorise(room.factor)
        _solve(room.factor, room.gradient, room.step)
        gain = np.sum(room.gradient * room.step)
        _spectrum(model.basis, room.step, room.slope)
        longest = LONGEST_STEP
        for k in range(len(power)):
            longest = max(longest, abs(room.slope[k]))
        for j in range(len(theta)):
            theta[j] += LONGEST_STEP / longest * room.step[j]
        if gain <= TOLERANCE + SLACK * max(best - value - gain, 0.0):
            break
    if not exact:
        _curvature(room.weight, model.products, model.precision, room.factor)
        own = _factorise(room.factor)
        log_determinant = log_determinant if np.isnan(own) else own
    return value + gain / 2 - log_determinant / 2


@_compiled
def _derivatives(
    power: Floats, noise: Floats, shape: Floats, attenuation: Floats, model: Model, theta: Floats, room: _Room
) -> tuple[float, bool]:
    """The log density and whether its curvature is positive at every annulus.

    In the room: the gradient by theta; minus the second derivative by ln S of each annulus, as it is and held positive.
    """
    scene, mean, slope, weight, held = room.scene, room.mean, room.slope, room.weight, room.held
    _spectrum(model.basis, theta, scene)
    for k in range(len(power)):
        scene[k] = attenuation[k] * np.exp(scene[k])
    value, exact = 0.0, True
    for k in range(len(power)):
        mean[k] = scene[k] + noise[k]
        value -= shape[k] * np.log(mean[k])
    for k in range(len(power)):
        part, ratio = scene[k] / mean[k], power[k] / mean[k]
        information = shape[k] * part
        value -= shape[k] * ratio
        slope[k] = information * (ratio - 1.0)
        weight[k] = information * part * ratio - (1.0 - part) * slope[k]
        held[k] = max(weight[k], LEAST_CURVATURE * information * part)
        exact &= weight[k] == held[k]
    for j in range(len(theta)):
        pull, push = 0.0, 0.0
        for i in range(len(theta)):
            pull += model.precision[j, i] * (theta[i] - model.mean[i])
        for k in range(len(power)):
            push += slope[k] * model.basis[j, k]
        value -= 0.5 * pull * (theta[j] - model.mean[j])
        room.gradient[j] = push - pull
    return value, exact


@_compiled
def _spectrum(basis: Floats, theta: Floats, out: Floats) -> None:
    """The sum of the basis functions, each times its coefficient."""
    out[:] = 0.0
    for j in range(len(theta)):
        for k in range(len(out)):
            out[k] += basis[j, k] * theta[j]


@_compiled
def _curvature(weight: Floats, products: Floats, precision: Floats, out: Floats) -> None:
    """The lower triangle of B diag(weight) B' + the prior's precision."""
    m = 0
    for i in range(len(out)):
        for j in range(i + 1):
            total = precision[i, j]
            for k in range(len(weight)):
                total += weight[k] * products[m, k]
            out[i, j] = total
            m += 1


@_compiled
def _factorise(matrix: Floats) -> float:
    """Cholesky's factor in the lower triangle, its diagonal inverted; the log determinant, NaN if not positive."""
    determinant = 1.0
    for j in range(len(matrix)):
        rest = matrix[j, j]
        for k in range(j):
            rest -= matrix[j, k] * matrix[j, k]
        if rest <= 0.0:
            return np.nan
        determinant *= rest
        matrix[j, j] = 1.0 / np.sqrt(rest)
        for i in range(j + 1, len(matrix)):
            other = matrix[i, j]
            for k in range(j):
                other -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = other * matrix[j, j]
    return float(np.log(determinant))


@_compiled
def _solve(factor: Floats, right: Floats, out: Floats) -> None:
    """The solution of (L L') x = right, L as `_factorise` leaves it."""
    count = len(right)
    for i in range(count):
        rest = right[i]
        for k in range(i):
            rest -= factor[i, k] * out[k]
        out[i] = rest * factor[i, i]
    for i in range(count - 1, -1, -1):
        rest = out[i]
        for k in range(i + 1, count):
            rest -= factor[k, i] * out[k]
        out[i] = rest * factor[i, i]


@_compiled
def _room(model: Model) -> _Room:
    """Arrays to work in."""
    terms, annuli = model.basis.shape
    a, b, c, d, e = np.zeros((5, annuli))
    return _Room(a, b, c, d, e, np.zeros(terms), np.zeros(terms), np.zeros((terms, terms)))
