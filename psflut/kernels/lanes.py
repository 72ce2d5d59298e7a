"""What the compiled search works on: the model, patches, what is climbed, and arrays to work in."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Places = NDArray[np.int64]

LANES, SMALL, LEAST = 64, 250_000, 16
"""Climbs side by side at most, the multiplications of a product of matrices up to which libraries of linear algebra
work in one thread, and the climbs side by side nevertheless."""


class Model(NamedTuple):
    """What all patches of one shape share: S sectors of R annuli each, J coefficients of W waves around the circle.

    Sectors that no bin falls into have shape 0 and functions that are 0.

    Parameters
    ----------
    attenuation : (M, S, R) array
    shape : (S, R) array
    basis : (S, Q, R) array
        Chebyshev polynomials.
    functions : (S, R, Q) array
        The same, annulus by annulus.
    moments : (S, 2 Q - 1, R) array
        So many polynomials: of the product of two of the first Q, T_p T_q = (T_(p + q) + T_|p - q|) / 2.
    waves : (S, W) array
        What a wave is in each sector; the first is 1.
    first : (W + 1,) array
        Number of its first coefficient, of the lowest order; in the end J.
    mean, precision : (J,), (J, J) arrays
        Of the prior.
    packed : (J (J + 1) / 2,) array
        The precision, as `psflut.kernels.algebra` says.
    """

    attenuation: Floats
    shape: Floats
    basis: Floats
    functions: Floats
    moments: Floats
    waves: Floats
    first: Places
    mean: Floats
    precision: Floats
    packed: Floats


class Patches(NamedTuple):
    """The power of B patches, their noise's and the gamma shapes, by sector and annulus (B, S, R)."""

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
    annuli : (4, S, n, R) array
        ln S, the slope, and minus the second derivative, held positive and as it is.
    line : (2, R) array
        Scene and logarithm of the mean of a sector of one lane.
    bits, number : (2, R) arrays
        One memory: of exponentials, and of the mean.
    terms : (4, n, J) array
        Theta, how far it is from the prior's mean, the prior's pull or the gradient, and the step.
    turned : (S, n, Q) array
        Coefficients of each sector, or the slope by them.
    told : (S, (2 Q - 1) n) array
        Moments of the curvature in each sector, as many lanes side by side as are climbed.
    both : (2 Q - 1, n) array
        The same of two waves.
    packed, right : (J (J + 1) / 2, n), (J, n) arrays
        Curvature and gradient, side by side.
    """

    lane: Places
    value: Floats
    annuli: Floats
    line: Floats
    bits: Places
    number: Floats
    terms: Floats
    turned: Floats
    told: Floats
    both: Floats
    packed: Floats
    right: Floats


def room(model: Model) -> Room:
    """Arrays to work in."""
    (sectors, terms, annuli), moments = model.basis.shape, model.moments.shape[1]
    lanes = max(LEAST, min(LANES, SMALL // (annuli * moments)))
    bits, lane, count = np.zeros((2, annuli), np.int64), np.zeros((3, lanes), np.int64), len(model.mean)
    values, lines = np.zeros((4, lanes)), np.zeros((2, annuli))
    return Room(
        *(lane, values, np.zeros((4, sectors, lanes, annuli)), lines, bits, bits.view(np.float64)),
        *(np.zeros((4, lanes, count)), np.zeros((sectors, lanes, terms)), np.zeros((sectors, moments * lanes))),
        *(np.zeros((moments, lanes)), np.zeros((len(model.packed), lanes)), np.zeros((count, lanes))),
    )
