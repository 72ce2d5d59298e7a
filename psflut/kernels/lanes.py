"""What the compiled search works on: the model, patches, what is climbed, and arrays to work in."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Places = NDArray[np.int64]

LANES, SMALL, LEAST = 64, 250_000, 24
"""Climbs side by side at most, the multiplications of a product of matrices up to which libraries of linear algebra
work in one thread, and the climbs side by side nevertheless: fewer fetch the products of functions too often."""


class Model(NamedTuple):
    """What all patches of one shape share.

    Parameters
    ----------
    attenuation : (M, K) array
    shape : (K,) array
    basis : (J, K) array
    functions : (K, J) array
        The same, annulus by annulus.
    products : (K, J (J + 1) / 2) array
        Of any two basis functions, packed as `psflut.kernels.algebra` says.
    mean, precision : (J,), (J, J) arrays
        Of the prior.
    packed : (J (J + 1) / 2,) array
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


class Patches(NamedTuple):
    """The power of B patches, their noise's and the gamma shapes, by annulus (B, K)."""

    power: Floats
    noise: Floats
    shape: Floats


class Summits(NamedTuple):
    """What is climbed, up to R distances of each patch: their rows in the model's attenuation, theta, where a climb
    starts and ends, and the log evidence (B, R); its best of each patch (B,) that is known before."""

    place: Places
    theta: Floats
    log_evidence: Floats
    best: Floats


class Room(NamedTuple):
    """Arrays to work in, for n lanes; few of them, as each costs time to compile.

    Parameters
    ----------
    lane : (3, n) array
        Number of what each climbs, the steps it has left, and what ended.
    value : (4, n) array
        The log density, the curvature's log determinant, and two rows for `psflut.kernels.algebra.solve`.
    annuli : (4, n, K) array
        ln S, the slope, and minus the second derivative, held positive and as it is.
    line : (2, K) array
        Scene and logarithm of the mean of one lane.
    bits, number : (2, K) arrays
        One memory: of exponentials, and of the mean.
    terms : (4, n, J) array
        Theta, how far it is from the prior's mean, the prior's pull or the gradient, and the step.
    pairs : (n, J (J + 1) / 2) array
        Curvatures.
    packed, right : (J (J + 1) / 2, n), (J, n) arrays
        The same, and the gradient, side by side.
    """

    lane: Places
    value: Floats
    annuli: Floats
    line: Floats
    bits: Places
    number: Floats
    terms: Floats
    pairs: Floats
    packed: Floats
    right: Floats


def room(model: Model) -> Room:
    """Arrays to work in."""
    (terms, annuli), pairs = model.basis.shape, model.products.shape[1]
    lanes = max(LEAST, min(LANES, SMALL // (annuli * pairs)))
    bits, lane = np.zeros((2, annuli), np.int64), np.zeros((3, lanes), np.int64)
    return Room(
        *(lane, np.zeros((4, lanes)), np.zeros((4, lanes, annuli)), np.zeros((2, annuli)), bits, bits.view(np.float64)),
        *(np.zeros((4, lanes, terms)), np.zeros((lanes, pairs)), np.zeros((pairs, lanes)), np.zeros((terms, lanes))),
    )
