"""How much neighbouring patches differ in distance beyond their errors: for patches that hold several surfaces.

An interval of `estimate` takes a patch for one surface at one distance. Where a patch straddles two, or lies on a
slant, that is not so, and the interval is too narrow; but then its neighbours read other distances. With u the distance
of a patch (in the even coordinate), u_j those of the patches around it and s their standard errors, the surfaces around
it are taken to differ from its own by a mean square of

    w_j = 1 / (s^2 + s_j^2),  t^2 = max(0, sum w_j (u_j - u)^2 / sum w_j - `OWN` n / sum w_j)

over the n of them. As eight neighbours tell it roughly, t is taken to be no less than its median over the patches up to
two away; the interval's halves are widened by t in squares. Compared on two captures of the motorcycle
(`psflut.scenes`), 308 patches of 64 pixels read by whole annuli, the 70 % of them with the narrowest intervals: share
of 95 % intervals that cover the distance that takes up the middle of a patch, and median error:

==========================================================  ========  ===========
intervals of the patches alone                              71, 72 %  3.0, 2.8 %
random effects (DerSimonian & Laird, 1986), OWN = 1         85, 87 %  3.0, 2.9 %
the same with OWN = 0.44                                    87, 88 %  3.0, 2.9 %
variance among the 3 x 3 without weights                    88, 86 %  3.6, 3.4 %
t alone, OWN = 1                                            88, 90 %  3.2, 3.0 %
t alone                                                     91, 91 %  3.0, 2.9 %
==========================================================  ========  ===========

Read by sectors, with narrower intervals, t alone covers 87 % (mean of three captures; intervals of the patches alone
67), no less than its median over the neighbours 88 %, as here 90 %; its mean over them 95 %, and t from patches up to
two away 96 %, with twice the widths. Most of what is left are patches whose texture is all on the smaller of their
two surfaces, next to others like them.
"""

from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from psflut.table import PSFTable

Floats = NDArray[np.float64]

OWN = 0.44
"""Variance in which two neighbours of one surface differ, in those that their intervals state: they overlap, and what
misleads about a scene (its own softness, its contrast by frequency) misleads both. The median over 24 captures of eight
photographs of scikit-image, each at one distance (1.1, 1.9 or 3 m), is 0.47, and was 0.44 of whole annuli; the
motorcycle is none of them."""


def relief(even: Floats, sd: Floats) -> Floats:
    """t of each patch: even coordinates and standard errors (ny, nx) -> (ny, nx)."""
    weight = np.nan_to_num(1 / (around(sd) ** 2 + sd**2))
    weight[len(weight) // 2] = 0.0  # the patch itself
    apart = np.sum(weight * np.nan_to_num(around(even) - even) ** 2, axis=0)
    beyond = np.maximum(apart - OWN * np.sum(weight > 0, axis=0), 0.0)
    total = weight.sum(axis=0)
    t = np.sqrt(beyond / np.where(total > 0, total, np.inf))
    return np.asarray(np.maximum(t, np.nanmedian(around(t, 2), axis=0)))


def widened(distance: Floats, interval: Floats, table: PSFTable, level: float) -> Floats:
    """Intervals that count the relief round each patch: (ny, nx) and (ny, nx, 2) metres -> (ny, nx, 2), in the table.

    Parameters
    ----------
    level : float
        Probability of the intervals.
    """
    even, ends = table.even(distance), np.sort(table.even(interval), axis=-1)
    more = norm.ppf(0.5 + level / 2) * relief(even, errors(interval, table, level))
    below, above = (np.hypot(np.maximum(side, 0.0), more) for side in (even - ends[..., 0], ends[..., 1] - even))
    low, high = np.sort(table.even(table.span))
    grown = np.stack([np.clip(even - below, low, high), np.clip(even + above, low, high)], axis=-1)
    return np.sort(table.position(grown), axis=-1)


def errors(interval: Floats, table: PSFTable, level: float) -> Floats:
    """Standard errors, in the even coordinate, of normal posteriors with those intervals (..., 2) -> (...)."""
    return np.asarray(np.ptp(table.even(interval), axis=-1) / (2 * norm.ppf(0.5 + level / 2)))


def around(values: Floats, reach: int = 1) -> Floats:
    """(9, ny, nx), or more: every patch's neighbours up to so many away and itself, NaN beyond the map."""
    padded, (height, width) = np.pad(values, reach, constant_values=np.nan), values.shape
    return np.stack([padded[i : i + height, j : j + width] for i, j in product(range(2 * reach + 1), repeat=2)])
