"""Compiled: Newton's method for the scene's spectrum, at many distances of many patches at once.

The log density of theta, ln p(P | z, theta) + ln p(theta) (`psflut.evidence`), is climbed with the exact curvature,
held to be positive, and the integral over theta is Laplace's. Climbs lie side by side, `lanes` of them: what sums over
annuli is a product of matrices for all, the equations are solved for all, and a lane whose climb has ended takes the
next. A step and the evidence at its end take 0.6 us a climb of 43 annuli, 2 of four sectors of them.
"""

import numpy as np
from numpy.typing import NDArray

from psflut.kernels import compiled, inlined
from psflut.kernels.elementary import exponentials, logarithms
from psflut.kernels.equations import gathered, solved, spread
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
    """Fill the log evidence of those climbs, numbered patch after patch, and go to the best theta, in place.

    No climb depends on what else is climbed: what is best of its patch is what was known before.
    """
    number, left = room.lane[0], room.lane[1]
    n, begun = 0, 0
    while n > 0 or begun < len(which):
        while n < len(number) and begun < len(which):
            number[n], left[n] = which[begun], NEWTON_STEPS
            n, begun = n + 1, begun + 1
        _step(n, patches, summits, model, room)
        n = _taken(n, summits, model, room)


@inlined
def _step(n: int, patches: Patches, summits: Summits, model: Model, room: Room) -> None:
    """A Newton step of n lanes, not yet taken, the log density where each is, and the curvature's log determinant."""
    most, number, value = summits.place.shape[1], room.lane[0], room.value[0]
    theta, apart, pull, step = room.terms[0], room.terms[1], room.terms[2], room.terms[3]
    for i in range(n):
        b, r = number[i] // most, number[i] % most
        for j in range(len(model.mean)):
            theta[i, j] = summits.theta[b, r, j]
            apart[i, j] = theta[i, j] - model.mean[j]
    spread(n, theta, model, room)
    np.dot(apart[:n], model.precision, pull[:n])
    for i in range(n):
        value[i] = 0.0
        b, r = number[i] // most, number[i] % most
        for s in range(len(model.shape)):
            patch = patches.power[b, s], patches.noise[b, s], patches.shape[b, s]
            value[i] += _derivatives(i, s, patch, model.attenuation[summits.place[b, r], s], room)
    gathered(n, model, room)
    for i in range(n):
        for j in range(len(model.mean)):
            value[i] -= 0.5 * apart[i, j] * pull[i, j]
            room.right[j, i] -= pull[i, j]
            pull[i, j] = room.right[j, i]  # from here on the gradient
    solved(n, model, room)
    for i in range(n):
        for j in range(len(model.mean)):
            step[i, j] = room.right[j, i]


@inlined
def _derivatives(i: int, s: int, patch: tuple[Floats, Floats, Floats], attenuation: Floats, room: Room) -> float:
    """The log likelihood of lane i in a sector. In the room: its slope by ln S of each annulus; minus the second
    derivative, as it is and held positive."""
    power, noise, shape = patch
    scene, log_mean, mean = room.line[0], room.line[1], room.number[1]
    log_scene, slope = room.annuli[0, s, i], room.annuli[1, s, i]
    held, weight = room.annuli[2, s, i], room.annuli[3, s, i]
    exponentials(log_scene, scene, room.bits[0], room.number[0])
    for k in range(len(scene)):
        scene[k] *= attenuation[k]
        mean[k] = scene[k] + noise[k]
    logarithms(room.bits[1], log_mean, room.bits[0], room.number[0])
    value = 0.0
    for k in range(len(scene)):
        inverse = 1.0 / mean[k]
        part, ratio = scene[k] * inverse, power[k] * inverse
        information = shape[k] * part
        value -= shape[k] * (log_mean[k] + ratio)
        rise = information * (ratio - 1.0)
        exact = information * part * ratio - (1.0 - part) * rise
        slope[k], weight[k] = rise, exact
        held[k] = max(exact, LEAST_CURVATURE * information * part)
    return value


@inlined
def _taken(n: int, summits: Summits, model: Model, room: Room) -> int:
    """Take the step of n lanes; those that are at their summits leave. Returns how many go on."""
    number, left, done = room.lane[0], room.lane[1], room.lane[2]
    value, log_determinant = room.value[0], room.value[1]
    gradient, step, most = room.terms[2], room.terms[3], summits.place.shape[1]
    reach, far = room.value[2], False  # no annulus changes by more than all coefficients together
    for i in range(n):
        reach[i] = 0.0
        for j in range(len(model.mean)):
            reach[i] += abs(step[i, j])
        far |= reach[i] > LONGEST_STEP
    if far:
        spread(n, step, model, room)
    going, ended = 0, 0
    for i in range(n):
        b, r = number[i] // most, number[i] % most
        gain, longest = 0.0, LONGEST_STEP
        for j in range(len(model.mean)):
            gain += gradient[i, j] * step[i, j]
        if reach[i] > LONGEST_STEP:
            for s in range(len(model.shape)):
                change = room.annuli[0, s, i]
                for k in range(len(change)):
                    longest = max(longest, abs(change[k]))
        for j in range(len(model.mean)):
            summits.theta[b, r, j] += LONGEST_STEP / longest * step[i, j]
        here = value[i] - log_determinant[i] / 2
        left[i] -= 1
        if left[i] == 0 or gain <= TOLERANCE + SLACK * max(summits.best[b] - here - gain, 0.0):
            summits.log_evidence[b, r] = here + gain / 2
            done[ended], value[ended] = number[i], log_determinant[i]
            for s in range(len(model.shape)):
                exact = room.annuli[3, s, i]
                for k in range(len(exact)):
                    room.annuli[2, s, ended, k] = exact[k]
            ended += 1
        else:
            number[going], left[going] = number[i], left[i]
            going += 1
    if ended > 0:
        solved(ended, model, room)  # Laplace's integral takes it as it is,
    for i in range(ended):
        if log_determinant[i] == log_determinant[i]:  # where that is positive, else it is NaN
            summits.log_evidence[done[i] // most, done[i] % most] += (value[i] - log_determinant[i]) / 2
    return going
