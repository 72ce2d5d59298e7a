"""Compiled: Newton's method for the scene's spectrum, at many distances of many patches at once.

The log density of theta, ln p(P | z, theta) + ln p(theta) (`psflut.evidence`), is climbed with the exact curvature,
held to be positive, and the integral over theta is Laplace's. Climbs lie side by side, `lanes` of them: what sums over
annuli is a product of matrices for all, the equations are solved for all, and a lane whose climb has ended takes the
next. A step and the evidence at its end take 2 us a climb (43 annuli), 5 where each climb is on its own.
"""

import numpy as np
from numpy.typing import NDArray

from psflut.kernels import compiled, inlined
from psflut.kernels.algebra import solve
from psflut.kernels.elementary import exponentials, logarithms
from psflut.kernels.lanes import Model, Patches, Places, Room, Summits

Floats = NDArray[np.float64]

NEWTON_STEPS, TOLERANCE, SLACK = 100, 1e-2, 0.1
"""A climb ends where a step gains less than so many nats, which are counted, and this share of what it is below the
patch's best."""

LEAST_CURVATURE, LONGEST_STEP = 0.2, 3.0
"""Of a Newton step: share of Fisher's information, and nats of ln S at any annulus; the quadratic model reaches no
further."""


@compiled
def climb(which: Places, patches: Patches, summits: Summits, model: Model, room: Room) -> None:
    """Fill the log evidence of those climbs, numbered patch after patch, and go to the best theta, in place."""
    n, begun = 0, 0
    while n > 0 or begun < len(which):
        while n < len(room.climb) and begun < len(which):
            room.climb[n], room.left[n] = which[begun], NEWTON_STEPS
            n, begun = n + 1, begun + 1
        _step(n, patches, summits, model, room)
        n = _taken(n, summits, model, room)


@inlined
def _step(n: int, patches: Patches, summits: Summits, model: Model, room: Room) -> None:
    """A Newton step of n lanes, not yet taken, the log density where each is, and the curvature's log determinant."""
    terms, most = len(model.mean), summits.place.shape[1]
    theta, apart = _lanes(room.theta, terms, n), _lanes(room.apart, terms, n)
    pull, step = _lanes(room.pull, terms, n), _lanes(room.step, terms, n)
    for i in range(n):
        b, r = room.climb[i] // most, room.climb[i] % most
        for j in range(terms):
            theta[j, i] = summits.theta[b, r, j]
            apart[j, i] = theta[j, i] - model.mean[j]
    np.dot(theta.T, model.basis, room.log_scene[:n])
    np.dot(model.precision, apart, pull)
    for i in range(n):
        b, r = room.climb[i] // most, room.climb[i] % most
        patch = patches.power[b], patches.noise[b], patches.shape[b]
        room.value[i] = _derivatives(i, patch, model.attenuation[summits.place[b, r]], room)
    np.dot(model.basis, room.slope[:n].T, step)
    for j in range(terms):
        for i in range(n):
            room.value[i] -= 0.5 * apart[j, i] * pull[j, i]
            step[j, i] -= pull[j, i]
            pull[j, i] = step[j, i]  # from here on the gradient
    _solved(n, room.held, step, model, room)


@inlined
def _solved(n: int, weight: Floats, right: Floats, model: Model, room: Room) -> None:
    """Solve for `right` (J, n) with the curvature that these weights of annuli (n, K) make."""
    pairs = len(model.packed)
    packed = _lanes(room.packed, pairs, n)
    np.dot(model.products, weight[:n].T, packed)
    for m in range(pairs):
        for i in range(n):
            packed[m, i] += model.packed[m]
    solve(packed, right, room.log_determinant[:n], _lanes(room.over, 2, n))


@inlined
def _derivatives(i: int, patch: tuple[Floats, Floats, Floats], attenuation: Floats, room: Room) -> float:
    """The log likelihood of lane i. In the room: its slope by ln S of each annulus; minus the second derivative, as it
    is and held positive."""
    power, noise, shape = patch
    scene, mean, log_mean = room.scene[i], room.mean, room.row
    own_slope, own_weight, own_held = room.slope[i], room.weight[i], room.held[i]
    exponentials(room.log_scene[i], scene, room.bits, room.number)
    for k in range(len(scene)):
        scene[k] *= attenuation[k]
        mean[k] = scene[k] + noise[k]
    logarithms(room.mean_bits, log_mean, room.bits, room.number)
    value = 0.0
    for k in range(len(scene)):
        inverse = 1.0 / mean[k]
        part, ratio = scene[k] * inverse, power[k] * inverse
        information = shape[k] * part
        value -= shape[k] * (log_mean[k] + ratio)
        slope = information * (ratio - 1.0)
        weight = information * part * ratio - (1.0 - part) * slope
        own_slope[k], own_weight[k] = slope, weight
        own_held[k] = max(weight, LEAST_CURVATURE * information * part)
    return value


@inlined
def _taken(n: int, summits: Summits, model: Model, room: Room) -> int:
    """Take the step of n lanes; those that are at their summits leave. Returns how many go on."""
    terms, most = len(model.mean), summits.place.shape[1]
    gradient, step = _lanes(room.pull, terms, n), _lanes(room.step, terms, n)
    np.dot(step.T, model.basis, room.log_scene[:n])
    going, ended = 0, 0
    for i in range(n):
        b, r = room.climb[i] // most, room.climb[i] % most
        gain, longest = 0.0, LONGEST_STEP
        for j in range(terms):
            gain += gradient[j, i] * step[j, i]
        for k in range(room.log_scene.shape[1]):
            longest = max(longest, abs(room.log_scene[i, k]))
        for j in range(terms):
            summits.theta[b, r, j] += LONGEST_STEP / longest * step[j, i]
        here = room.value[i] - room.log_determinant[i] / 2
        summits.best[b] = max(summits.best[b], here)
        room.left[i] -= 1
        if room.left[i] == 0 or gain <= TOLERANCE + SLACK * max(summits.best[b] - here - gain, 0.0):
            summits.log_evidence[b, r] = here + gain / 2
            room.done[ended], room.value[ended] = room.climb[i], room.log_determinant[i]
            for k in range(room.held.shape[1]):
                room.held[ended, k] = room.weight[i, k]
            ended += 1
        else:
            room.climb[going], room.left[going] = room.climb[i], room.left[i]
            going += 1
    if ended > 0:
        _exact(ended, summits, model, room)
    return going


@inlined
def _exact(ended: int, summits: Summits, model: Model, room: Room) -> None:
    """Laplace's integral of the climbs that ended takes the curvature as it is, where that is positive."""
    most = summits.place.shape[1]
    _solved(ended, room.held, _lanes(room.step, len(model.mean), ended), model, room)
    for i in range(ended):
        exact = room.log_determinant[i]
        if exact == exact:  # NaN where it is not
            summits.log_evidence[room.done[i] // most, room.done[i] % most] += (room.value[i] - exact) / 2


@inlined
def _lanes(room: Floats, rows: int, n: int) -> Floats:
    """So many rows of n lanes in the array."""
    return room[: rows * n].reshape(rows, n)
