"""How well the positions of a calibration are known, from the errors of positions left out once."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from psflut.table import PSFTable

Floats = NDArray[np.float64]

LEAST = 6
"""Left-out positions from which on their scatter says something."""

FACTOR = 1.64
"""Variance of a left-out position's error over that of one: a cubic's weights -1/16, 9/16, 9/16, -1/16 add theirs."""

GAIN = 2.0
"""Nats that a placement sigma above zero must be likelier by: chance gives so much once in twenty times."""

SPREADS = np.geomspace(1e-6, 0.3, 150)
"""Placement sigmas that are tried, of the axis' span."""

TIMES = np.geomspace(1.0, 30.0, 60)
"""How many times larger than the pixels' standard errors let expect the errors of readings may be."""


UNSURE = 0.7
"""Of the logarithm of those times, before they are seen: they are rarely above 4."""


class Placement(NamedTuple):
    """`sigma` (metres): of setting up a position. `times`: errors of readings, over what pixels' errors let expect."""

    sigma: float
    times: float

    def axis_std(self, reading: Floats) -> Floats:
        """Standard errors (metres) of positions where pixels' errors let `reading` (metres) expect."""
        return np.asarray(np.sqrt(self.sigma**2 + (self.times**2 - 1.0) * reading**2))


def reading_error(table: PSFTable, std: Floats) -> Floats:
    """Standard errors (metres) of `calib.nearest` at the table's positions, from independent pixels' ones (N, K, K)."""
    slope = table.derivative(table.axis)
    return np.asarray(np.sqrt(np.sum((slope * std) ** 2, axis=(1, 2))) / np.sum(slope**2, axis=(1, 2)))


def placement(error: Floats, reading: Floats, span: float) -> Placement:
    """The likeliest placement sigma from errors of left-out positions (M,), and `reading_error` of each (M,); metres.

    Modelled as Student's t with four degrees of freedom (some frames are just bad) and the variance
    FACTOR (sigma^2 + times^2 reading^2). Errors of a PSF's pixels are alike, shared centre and all, so that they
    shift readings further than independent ones: `times` holds that, and what does not grow with it is placement.
    Where both would run alike along the axis they cannot be told apart, but their sum, `Placement.axis_std`, is known.
    """
    variance = FACTOR * ((np.r_[0.0, SPREADS] * span)[:, None, None] ** 2 + (TIMES[:, None] * reading) ** 2)
    log = -0.5 * np.log(variance) - 2.5 * np.log1p(error**2 / (4.0 * variance))
    likely = log.sum(axis=-1) - 0.5 * (np.log(TIMES) / UNSURE) ** 2
    spread = int(np.argmax(likely.max(axis=1)))
    if likely[spread].max() < likely[0].max() + GAIN:
        spread = 0
    return Placement(float(np.r_[0.0, SPREADS][spread] * span), float(TIMES[np.argmax(likely[spread])]))
