"""A fitted lens as the course that measured PSFs are smoothed about, with its errors."""

from dataclasses import astuple

import numpy as np
from numpy.typing import NDArray

from calib.build import Guess
from calib.fit_errors import fit_errors
from calib.pupil_fit import Lens

Floats = NDArray[np.float64]


def guess_of(lens: Lens, even: Floats, psf: Floats, std: Floats) -> Guess:
    """The course that a fitted lens has at coordinates (N,), and its errors from those of the lens' five numbers.

    Planes err independently of each other, pixels of a plane do not: so the covariance of the numbers is the
    jackknife's, from what each plane, left out, would move them by, to first order. What the model itself gets wrong
    counts as well.

    Tables at 20 distances, 0.95 to 4.5 m, smoothed by the spline alone and about the lens, mean summed error: points
    0.0119 and 0.0058 (three draws), edges 0.0392 and 0.0310 (three draws), a pattern by a sharp frame 0.053 and 0.027
    (another draw 0.055 and 0.018). Errors over those stated, four draws together (every plane's error with a random
    sign), before the points' fits knew a round mean and smoothing knew what targets hide:

    | errors of the lens | points | edges | edges | sharp frame | sharp frame |
    |---|---|---|---|---|---|
    | jackknife: taken | 0.72 | 0.98 | 0.93 | 1.35 | 1.24 |
    | covariance of clusters (Liang and Zeger 1986) | 0.72 | 1.02 | 1.08 | 1.47 | 1.42 |
    | the same, residuals freed of leverage | 0.72 | 1.05 | 1.05 | 1.48 | 1.41 |

    Without them a draw of the sharp frame's and one of edges were 2.7 and 2.3.
    """
    sigma, size = fit_errors(psf, std), psf.shape[1]
    here = lens.at(even, size)
    numbers = np.array(astuple(lens)) ** [1, 1, 1, 1, 2]  # PSFs change with the softness' square, at 0 as well
    steps = 1e-3 * np.array([lens.slope, np.ptp(even), lens.sampling, 1.0, 1.0])
    moved = (numbers + np.diag(steps)) ** [1, 1, 1, 1, 0.5]
    ahead = [Lens(*(float(number) for number in each)).at(even, size) for each in moved]
    slopes = np.stack(ahead) - here  # a step each
    scaled = (slopes / sigma).reshape(len(steps), len(even), -1)
    misfit = ((psf - here) / sigma).reshape(len(even), -1)
    told = np.einsum("pni,qni->npq", scaled, scaled)
    others = np.linalg.pinv(told.sum(axis=0) - told, rcond=1e-9, hermitian=True)
    pulls = np.einsum("npq,qni,ni->pn", others, scaled, misfit, optimize=True)
    power, ways = np.linalg.eigh((1.0 - 1.0 / len(even)) * pulls @ pulls.T)
    return Guess(here, np.tensordot((ways * np.sqrt(np.maximum(power, 0.0))).T, slopes, 1))
