"""Compiled: Newton's method for the scene's spectrum at one distance.

The log density of theta, ln p(P | z, theta) + ln p(theta) (`psflut.evidence`), is climbed with the exact curvature,
held to be positive, and the integral over theta is Laplace's. A step takes 1 to 2 us (43 and 89 annuli); in numpy 12
to 15.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from psflut.kernels import compiled, inlined
from psflut.kernels.algebra import STRIDE, combined, solve
from psflut.kernels.elementary import Bits, exponentials, logarithms

Floats = NDArray[np.float64]

NEWTON_STEPS, TOLERANCE, SLACK = 100, 1e-2, 0.2
"""A climb ends where a step gains less than so many nats, which are counted, and this share of what it is below the
patch's best."""

LEAST_CURVATURE, LONGEST_STEP = 0.2, 3.0
"""Of a Newton step: share of Fisher's information, and nats of ln S at any annulus; the quadratic model reaches no
further."""


class Model(NamedTuple):
    """What all patches of one shape share. All that is summed over is filled up to a multiple of `algebra.STRIDE`.

    Parameters
    ----------
    attenuation : (M, K) array
    shape : (K,) array
    basis : (J, K) array
    functions : (K, 16) array
        The same, annulus by annulus.
    products : (K, 64) array
        Of any two basis functions, packed as `psflut.kernels.algebra` says.
    mean, precision : (J,), (J, J) arrays
        Of the prior.
    packed : (64,) array
        The precision.
    """

    attenuation: Floats
    shape: Floats
    basis: Floats
    functions: Floats
    products: Floats
    mean: Floats
    precision: Floats
    packed: Floats


class Patch(NamedTuple):
    """A patch's power, its noise's, and the gamma shapes, by annulus (K,)."""

    power: Floats
    noise: Floats
    shape: Floats


class Room(NamedTuple):
    """Arrays to work in: over annuli (K,), over coefficients (J,), and what `psflut.kernels.algebra.solve` asks for."""

    log_scene: Floats
    scene: Floats
    mean: Floats
    log_mean: Floats
    slope: Floats
    weight: Floats
    held: Floats
    bits: Bits
    number: Floats
    mean_bits: Bits
    pull: Floats
    gradient: Floats
    step: Floats
    packed: Floats
    rows: Floats


def room(model: Model) -> Room:
    """Arrays to work in."""
    terms, annuli = model.basis.shape
    bits, mean_bits = np.zeros((2, annuli), np.int64)
    log_scene, scene, log_mean, slope, weight, held = np.zeros((6, annuli))
    number, mean = bits.view(np.float64), mean_bits.view(np.float64)
    over = log_scene, scene, mean, log_mean, slope, weight, held, bits, number, mean_bits
    pull, gradient = np.zeros((2, model.functions.shape[1]))
    return Room(*over, pull, gradient, np.zeros(terms), np.zeros(len(model.packed) + STRIDE), np.zeros((terms, STRIDE)))


def climb_all(patches: Patch, model: Model, theta: Floats, log_evidence: Floats) -> None:
    """Fill the log evidence (M,) of every row of the model; theta (M, J) starts there; a patch for each row (M, K)."""
    _climb_all(patches, model, theta, log_evidence, room(model))


@compiled
def _climb_all(patches: Patch, model: Model, theta: Floats, log_evidence: Floats, room: Room) -> None:
    best = -np.inf
    for m in range(len(theta)):
        patch = Patch(patches.power[m], patches.noise[m], patches.shape[m])
        log_evidence[m] = climb(patch, model.attenuation[m], model, theta[m], best, room)
        best = max(best, log_evidence[m])


@compiled
def climb(patch: Patch, attenuation: Floats, model: Model, theta: Floats, best: float, room: Room) -> float:
    """The log evidence of one distance, by climbing to the best theta (J,), in place."""
    packed = room.packed[: len(model.packed)]
    spectrum(model.basis, theta, room.log_scene)
    for _ in range(NEWTON_STEPS):
        value, exact = derivatives(patch, attenuation, model, theta, room)
        combined(model.packed, room.held, model.products, packed)
        log_determinant = solve(room.packed, room.gradient, room.rows, room.step)
        gain = 0.0
        for j in range(len(theta)):
            gain += room.gradient[j] * room.step[j]
        spectrum(model.basis, room.step, room.slope)
        longest = LONGEST_STEP
        for k in range(len(room.slope)):
            longest = max(longest, abs(room.slope[k]))
        pace = LONGEST_STEP / longest
        for j in range(len(theta)):
            theta[j] += pace * room.step[j]
        if gain <= TOLERANCE + SLACK * max(best - value - gain, 0.0):
            break
        for k in range(len(room.slope)):
            room.log_scene[k] += pace * room.slope[k]
    if not exact:
        combined(model.packed, room.weight, model.products, packed)
        own = solve(room.packed, room.gradient, room.rows, room.step)
        log_determinant = own if own == own else log_determinant  # NaN where it is not positive
    return value + gain / 2 - log_determinant / 2


@inlined
def derivatives(patch: Patch, attenuation: Floats, model: Model, theta: Floats, room: Room) -> tuple[float, bool]:
    """The log density and whether its curvature is positive at every annulus.

    In the room: the gradient by theta; minus the second derivative by ln S of each annulus, as it is and held positive.
    """
    scene, mean = room.scene, room.mean
    exponentials(room.log_scene, scene, room.bits, room.number)
    for k in range(len(scene)):
        scene[k] *= attenuation[k]
        mean[k] = scene[k] + patch.noise[k]
    logarithms(room.mean_bits, room.log_mean, room.bits, room.number)
    value, negative = 0.0, 0.0
    for k in range(len(scene)):
        inverse = 1.0 / mean[k]
        part, ratio = scene[k] * inverse, patch.power[k] * inverse
        information = patch.shape[k] * part
        value -= patch.shape[k] * (room.log_mean[k] + ratio)
        slope = information * (ratio - 1.0)
        weight = information * part * ratio - (1.0 - part) * slope
        held = max(weight, LEAST_CURVATURE * information * part)
        negative += held - weight
        room.slope[k], room.weight[k], room.held[k] = slope, weight, held
    for j in range(len(theta)):
        pull = 0.0
        for i in range(len(theta)):
            pull += model.precision[j, i] * (theta[i] - model.mean[i])
        value -= 0.5 * pull * (theta[j] - model.mean[j])
        room.pull[j] = -pull
    combined(room.pull, room.slope, model.functions, room.gradient)
    return value, negative == 0.0


@compiled
def spectrum(basis: Floats, theta: Floats, out: Floats) -> None:
    """The sum of the basis functions, each times its coefficient."""
    for k in range(len(out)):
        out[k] = 0.0
    for j in range(len(theta)):
        for k in range(len(out)):
            out[k] += basis[j, k] * theta[j]
