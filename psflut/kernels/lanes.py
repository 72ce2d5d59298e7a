"""What the compiled search works on: the model, patches, what is climbed, and arrays to work in."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Places = NDArray[np.int64]

LANES, SMALL = 64, 250_000
"""Climbs side by side at most, and the multiplications of a product of matrices up to which libraries of linear
algebra work in one thread."""


class Model(NamedTuple):
    """What all patches of one shape share.

    Parameters
    ----------
    attenuation : (M, K) array
    shape : (K,) array
    basis : (J, K) array
    products : (J (J + 1) / 2, K) array
        Of any two basis functions, packed as `psflut.kernels.algebra` says.
    mean, precision : (J,), (J, J) arrays
        Of the prior.
    packed : (J (J + 1) / 2,) array
        The precision.
    """

    attenuation: Floats
    shape: Floats
    basis: Floats
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
    starts and ends, and the log evidence (B, R); its best of each patch (B,), as far as it is known."""

    place: Places
    theta: Floats
    log_evidence: Floats
    best: Floats


class Room(NamedTuple):
    """Arrays to work in, for n lanes: what each climbs, the steps it has left and the like (n,); by annulus (n, K), or
    of one lane (K,); by coefficient (J n,), of which as many lanes are used as climb; by pair of them."""

    climb: Places
    left: Places
    done: Places
    value: Floats
    log_determinant: Floats
    over: Floats
    scene: Floats
    log_scene: Floats
    slope: Floats
    held: Floats
    weight: Floats
    row: Floats
    bits: Places
    number: Floats
    mean_bits: Places
    mean: Floats
    theta: Floats
    apart: Floats
    pull: Floats
    step: Floats
    packed: Floats


def room(model: Model) -> Room:
    """Arrays to work in."""
    (terms, annuli), pairs = model.basis.shape, len(model.products)
    lanes = max(1, min(LANES, SMALL // (annuli * pairs)))
    climb, left, done = np.zeros((3, lanes), np.int64)
    value, log_determinant = np.zeros((2, lanes))
    scene, log_scene, slope, held, weight = np.zeros((5, lanes, annuli))
    bits, mean_bits = np.zeros((2, annuli), np.int64)
    theta, apart, pull, step = np.zeros((4, terms * lanes))
    return Room(
        *(climb, left, done, value, log_determinant, np.zeros(2 * lanes)),
        *(scene, log_scene, slope, held, weight, np.zeros(annuli)),
        *(bits, bits.view(np.float64), mean_bits, mean_bits.view(np.float64)),
        *(theta, apart, pull, step, np.zeros(pairs * lanes)),
    )
