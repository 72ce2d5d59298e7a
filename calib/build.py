"""Measured PSFs at known positions become a smooth course along the axis: non-negative, sum 1, with errors."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter, gaussian_filter1d

from calib.radial import rings
from calib.targets import Measurement
from psflut.table import Kind, PSFTable

Floats = NDArray[np.float64]

LEAST_FOR_SPLINE = 6
"""Positions from which on a smoothing spline is fitted; fewer are left as they are."""

STRENGTHS = np.logspace(-12, 1, 27)
"""Of smoothing that are tried, for an axis of length 1."""

LEAST_ERROR = 0.1
"""Of a ring, in units of its plane's: targets that know their PSF to be zero far out state none there."""

ALIKE = 1.0
"""Rings, sigma of a Gaussian, over which the risk of a strength is averaged."""

DARK = 2.0
"""Standard errors of the local mean (Gaussian, 1 pixel) below which a pixel counts as dark."""


class Course(NamedTuple):
    """PSFs (N, K, K) along the axis, and their standard errors."""

    psf: Floats
    std: Floats


class Guess(NamedTuple):
    """A course (N, K, K) that PSFs are thought to follow, and its (P, N, K, K) independent errors, one sigma of each.

    The whole of an error is its variance's sum over them; what one of them does to all planes is one thing.
    """

    psf: Floats
    errors: Floats


def table_of(axis: Floats, kind: Kind, measurements: Sequence[Measurement], pixel_pitch: float) -> PSFTable:
    """The table of measurements at ascending positions (metres), before anything else is known of it."""
    even = axis if kind == "stage" else 1.0 / axis
    order = np.argsort(even)
    course, back = smooth(even[order], [measurements[k] for k in order]), np.argsort(order)
    return PSFTable(axis, course.psf[back], pixel_pitch, kind=kind, psf_std=course.std[back])


def smooth(even: Floats, measurements: Sequence[Measurement], guess: Guess | None = None) -> Course:
    """The course of measured PSFs along the axis, as smooth as their standard errors justify and no smoother.

    Every pixel follows a smoothing spline, which is linear, so that errors propagate exactly; one strength for all
    pixels at one distance from the centre, because the rim of a blur disc moves and its middle hardly changes,
    chosen by Mallows' criterion (`_strengths`). Pixels that are not above zero by `DARK` local standard errors are set
    to zero before the sum is made 1.

    Compared on 20 pupil PSFs with noise of 0.3 and 3 % of the peak, error of all pixels over that of the measured
    ones, and of lit pixels in standard errors: one strength for all pixels 0.19 and 0.10, 1.5 and 3.8; strengths by
    radius 0.10 and 0.05, 1.1 and 1.1; singular vectors, each with a spline of its own, 0.19 and 0.10, over 4. Merely
    clipping at zero adds up the noise of the dark pixels and dims the lit ones by many standard errors.

    Choices of the strength, on those PSFs with independent errors (0.3 %), with errors that a ring shares (2 %, 20
    positions from 1.2 to 1.6 m), on real edges (`test_focus_sweep`, distance read), and points and edges of 20
    synthetic distances (summed error, median error of fresh distances):

    | choice | independent | shared | real edges | points | edges |
    |---|---|---|---|---|---|
    | least risk, each ring by itself | 0.102 | 0.23 | 1.38 mm | 0.0263, 0.041 % | 0.0376, 0.144 % |
    | rings averaged, smoothest that may be best: taken | 0.117 | 0.20 | 0.76 mm | 0.0270, 0.036 % | 0.0369, 0.141 % |
    | smoothest that may be best, each ring by itself | 0.102 | 0.21 | 0.96 mm | 0.0264, 0.045 % | 0.0376, 0.161 % |
    | rings averaged, least risk | 0.117 | 0.21 | 1.12 mm | 0.0272, 0.035 % | 0.0369, 0.147 % |
    | positions left out once | 0.25 | 0.27 | 1.09 mm | 0.0268, 0.037 % | 0.0382, 0.178 % |
    | generalised cross-validation | 0.34 | 0.25 | 1.03 mm | 0.084, 0.071 % | 0.047, 0.156 % |

    The last two know no stated errors, and took rims that are known exactly for noise, by a third of the peak and more.
    The one taken costs up to a sixth more where all errors are independent, as dark pixels near bright ones are
    smoothed less, and saves a sixth where they are not; stated errors come nearer to the true ones in both.

    Errors are counted ring by ring: a shared centre makes those of lit pixels larger, and with one sigma a plane the
    finished table's were 5 to 7 times too small there; now they are 1.0 to 1.1 times the stated ones at 20 distances.

    What uncertain positions do to a plane, their error times the slope of the course, is not counted here and
    stands beside the table as `axis_std`: counted among the errors, at 3, 10 and 30 mm of 0.95 to 4.5 m, it changed the
    PSFs of points by +0, +2 and +35 % of their error, as rims that pass from pixel to pixel were taken for it.

    Parameters
    ----------
    even : (N,) array
        Ascending positions in the coordinate of interpolation: 1 / distance (1/m), or stage (m).
    measurements : sequence of Measurement
        One a position, K pixels a side.
    guess : Guess, optional
        What the measurements are smoothed about, a fitted lens, say: the spline follows what they show besides. Where
        it smooths, errors of the guess are errors of the course.

    Returns
    -------
    Course
    """
    mean, unsure = (0.0, None) if guess is None else guess
    measured = np.stack([each.psf for each in measurements]) - mean
    stated = np.stack([each.std for each in measurements])
    sigma = np.sqrt(np.mean(stated**2, axis=(1, 2)))
    ring = rings(measured.shape[1])
    matrices, masks = _smoothers(even, sigma), [ring == radius for radius in range(ring.max() + 1)]
    unseen = np.stack([np.zeros_like(each.std) if each.hidden is None else each.hidden for each in measurements])
    errors, shared = ([np.sqrt(np.mean(part[:, each] ** 2, axis=1)) for each in masks] for part in (stated, unseen))
    misfits = [
        np.mean(np.sum(((measured[:, each] - matrices @ measured[:, each]) / pull[:, None]) ** 2, axis=1), axis=1)
        for each, pull in zip(masks, np.maximum(errors, LEAST_ERROR * sigma), strict=True)
    ]
    psf, variance = np.empty_like(measured), np.empty_like(measured)
    chosen = matrices[_strengths(np.array(misfits), matrices, sigma)]
    for each, error, alike, best in zip(masks, errors, shared, chosen, strict=True):
        psf[:, each] = best @ measured[:, each]
        variance[:, each] = (best**2 @ np.maximum(error**2 - alike**2, 0.0) + (best @ alike) ** 2)[:, None]
        if unsure is not None:
            variance[:, each] += np.sum((unsure[:, :, each] - best @ unsure[:, :, each]) ** 2, axis=0)
    return _lit(psf + mean, np.sqrt(variance))


def _smoothers(even: Floats, sigma: Floats) -> Floats:
    """(S, N, N) matrices of smoothing splines, from hardly to wholly smooth.

    The values f of a natural spline that least sum w (y - f)^2 + s f' K f, f' K f the integral of its second
    derivative, squared: (W + s K)^-1 W, for all strengths s from one decomposition (Demmler and Reinsch 1975).
    """
    unit = np.eye(len(even))
    if len(even) < LEAST_FOR_SPLINE:
        return unit[None]
    scaled = (even - even[0]) / (even[-1] - even[0])
    bends, step = CubicSpline(scaled, unit, bc_type="natural")(scaled, 2), np.diff(scaled)
    mass = np.diag(np.append(step, 0) + np.append(0, step)) / 3 + (np.diag(step, 1) + np.diag(step, -1)) / 6
    root = sigma.min() / sigma
    rough, waves = np.linalg.eigh(bends.T @ mass @ bends / np.outer(root, root))
    rough[:2] = 0.0  # of a straight line
    left = 1.0 / (1.0 + np.multiply.outer(STRENGTHS, rough))
    return np.concatenate([unit[None], (waves * left[:, None]) @ waves.T * root / root[:, None]])


def _strengths(misfits: Floats, matrices: Floats, sigma: Floats) -> NDArray[np.int_]:
    """Of every ring the number of its smoother (S, N, N), the smoothest that may be the best, from misfits (rings, S).

    The risk of a smoother M is Mallows': the misfit of a pixel, squared and in standard errors, plus 2 tr M; averaged
    over neighbouring rings. The least risk alone often hardly smooths, by chance: the pixels of a ring, above all of a
    PSF from edges, err as one, so that N numbers decide. So the smoothest M is taken whose risk is above the least, of
    M0, by no more than the standard deviation of their difference where all pixels of a ring have the same error,

        sqrt(2) |(I - M)'(I - M) - (I - M0)'(I - M0)|, in standard errors of the planes.

    That is a matter of noise only: structure that is above the stated errors costs far more, and stays.
    """
    left = (np.eye(len(sigma)) - matrices) * sigma / sigma[:, None]
    powers = (left.transpose(0, 2, 1) @ left).reshape(len(left), -1)
    product = powers @ powers.T
    square = np.diag(product)
    chance = np.sqrt(2.0 * np.maximum(square[:, None] + square - 2.0 * product, 0.0))
    risks = gaussian_filter1d(misfits + 2.0 * np.trace(matrices, axis1=1, axis2=2), ALIKE, axis=0, mode="nearest")
    within = risks <= risks.min(axis=1, keepdims=True) + chance[np.argmin(risks, axis=1)]
    return np.asarray(len(matrices) - 1 - np.argmax(within[:, ::-1], axis=1))


def _lit(psf: Floats, std: Floats) -> Course:
    """Non-negative PSFs with sum 1: what is not above the noise of its neighbourhood is dark."""
    neighbourhood = np.stack([gaussian_filter(plane, 1.0) for plane in psf])
    noise = std * np.sqrt(1.0 / (4.0 * np.pi))  # of white noise after a Gaussian filter of 1 pixel
    light = np.where(neighbourhood > DARK * noise, np.maximum(psf, 0.0), 0.0)
    total = light.sum(axis=(1, 2), keepdims=True)
    return Course(light / total, std / total)
