"""Measured PSFs at known positions become a smooth course along the axis: non-negative, sum 1, with errors."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_smoothing_spline
from scipy.ndimage import gaussian_filter

from calib.targets import Measurement
from psflut.table import Kind, PSFTable

Floats = NDArray[np.float64]

LEAST_FOR_SPLINE = 6
"""Positions from which on a smoothing spline is fitted; fewer are left as they are."""

STRENGTHS = np.logspace(-12, 1, 27)
"""Of smoothing that are tried, for an axis of length 1."""

LEAST_ERROR = 0.1
"""Of a ring, in units of its plane's: targets that know their PSF to be zero far out state none there."""

DARK = 2.0
"""Standard errors of the local mean (Gaussian, 1 pixel) below which a pixel counts as dark."""


class Course(NamedTuple):
    """PSFs (N, K, K) along the axis, and their standard errors."""

    psf: Floats
    std: Floats


def table_of(axis: Floats, kind: Kind, measurements: Sequence[Measurement], pixel_pitch: float) -> PSFTable:
    """The table of measurements at ascending positions (metres), before anything else is known of it."""
    even = axis if kind == "stage" else 1.0 / axis
    order = np.argsort(even)
    course, back = smooth(even[order], [measurements[k] for k in order]), np.argsort(order)
    return PSFTable(axis, course.psf[back], pixel_pitch, kind=kind, psf_std=course.std[back])


def smooth(even: Floats, measurements: Sequence[Measurement]) -> Course:
    """The course of measured PSFs along the axis, as smooth as their standard errors justify and no smoother.

    Every pixel follows a smoothing spline, which is linear, so that errors propagate exactly; one strength for all
    pixels at one distance from the centre, because the rim of a blur disc moves and its middle hardly changes,
    chosen by Mallows' criterion: the squared misfit in standard errors plus twice the trace. Pixels that are not above
    zero by `DARK` local standard errors are set to zero before the sum is made 1.

    Compared on 20 pupil PSFs with noise of 0.3 and 3 % of the peak, error of all pixels over that of the measured
    ones, and of lit pixels in standard errors: one strength for all pixels 0.19 and 0.10, 1.5 and 3.8; strengths by
    radius 0.10 and 0.05, 1.1 and 1.1; singular vectors, each with a spline of its own, 0.19 and 0.10, over 4. Merely
    clipping at zero adds up the noise of the dark pixels and dims the lit ones by many standard errors.

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

    Returns
    -------
    Course
    """
    measured = np.stack([each.psf for each in measurements])
    stated = np.stack([each.std for each in measurements])
    size = measured.shape[1]
    sigma = np.sqrt(np.mean(stated**2, axis=(1, 2)))
    across = np.arange(size) - size // 2
    ring = np.hypot(across[:, None], across).round().astype(int)
    matrices = _smoothers(even, sigma)
    psf, std = np.empty_like(measured), np.empty_like(measured)
    for radius in range(ring.max() + 1):
        values = measured[:, ring == radius]
        error = np.sqrt(np.mean(stated[:, ring == radius] ** 2, axis=1))
        pull = np.maximum(error, LEAST_ERROR * sigma)[:, None]
        risks = [np.sum(((values - m @ values) / pull) ** 2) + 2 * np.trace(m) * len(values.T) for m in matrices]
        best = matrices[int(np.argmin(risks))]
        psf[:, ring == radius] = best @ values
        std[:, ring == radius] = np.sqrt(best**2 @ error**2)[:, None]
    return _lit(psf, std)


def _smoothers(even: Floats, sigma: Floats) -> list[Floats]:
    """(N, N) matrices of smoothing splines, from hardly to wholly smooth."""
    unit = np.eye(len(even))
    if len(even) < LEAST_FOR_SPLINE:
        return [unit]
    scaled = (even - even[0]) / (even[-1] - even[0])
    weights = (sigma.min() / sigma) ** 2
    return [unit, *(np.asarray(make_smoothing_spline(scaled, unit, weights, lam=each)(scaled)) for each in STRENGTHS)]


def _lit(psf: Floats, std: Floats) -> Course:
    """Non-negative PSFs with sum 1: what is not above the noise of its neighbourhood is dark."""
    neighbourhood = np.stack([gaussian_filter(plane, 1.0) for plane in psf])
    noise = std * np.sqrt(1.0 / (4.0 * np.pi))  # of white noise after a Gaussian filter of 1 pixel
    light = np.where(neighbourhood > DARK * noise, np.maximum(psf, 0.0), 0.0)
    total = light.sum(axis=(1, 2), keepdims=True)
    return Course(light / total, std / total)
