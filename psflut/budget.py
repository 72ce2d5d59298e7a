"""The error budget of an estimate: how much of its uncertainty comes from where.

Fisher's information of distance, by the model of `psflut.evidence` at the estimate, with the coefficients of the
scene's spectrum as nuisance, gives a variance. Without noise it would be that of ``texture``: the spectrum is known
by its prior alone, and a patch holds few bins of it. ``photons`` is what noise adds to it, read noise included. The
table's errors add ``table`` (its PSFs' pixels and what is between its planes) and ``placement`` (its distances).
All four are standard deviations; their squares add up to the variance of a posterior that is nearly normal.
"""

import numpy as np
from numpy.typing import NDArray

from psflut import evidence
from psflut.evidence import Bank
from psflut.grid import Grid
from psflut.laplace import curvature
from psflut.spread import placement
from psflut.table import PSFTable

Floats = NDArray[np.float64]

FAINT = 1e-9
"""Share of the largest attenuation below which one counts as that: no capture shows it."""


def budget(found: Grid, table: PSFTable, distance: float) -> dict[str, float]:
    """Standard deviations (metres) at a distance (metres) of a patch, each at most the table's span.

    Returns
    -------
    dict
        ``photons``, ``texture``, ``table`` and ``placement``.
    """
    even = np.atleast_1d(table.even(distance))
    theta = found.scene_at(float(even[0]))
    texture = _sd(found.bank, even, theta, np.zeros_like(found.noise))
    both = _sd(found.bank, even, theta, found.noise)
    placed = float(placement(table, even)[0])
    own = float(found.spread(even)[0])
    parts = {
        "photons": np.sqrt(max(both**2 - texture**2, 0.0)),
        "texture": texture,
        "table": np.sqrt(max(own**2 - placed**2, 0.0)),
        "placement": placed,
    }
    slope = float(even[0] ** -2) if table.kind == "distance" else 1.0
    return {name: float(min(slope * sd, np.ptp(table.span))) for name, sd in parts.items()}


def _sd(bank: Bank, even: Floats, theta: Floats, noise: Floats) -> float:
    """Root of the Cramer-Rao bound in the even coordinate, the spectrum's coefficients projected out."""
    kept = bank.at(even)[0]
    kept = np.maximum(kept, FAINT * kept.max())
    scene = evidence.scene_power(kept, theta, bank)
    weight = bank.shape * (scene / (scene + noise)) ** 2
    slope = bank.slope(even)[0] / kept
    cross = (weight * slope) @ bank.basis
    told = np.sum(weight * slope**2) - cross @ np.linalg.solve(curvature(weight[None], bank)[0], cross)
    return float(1.0 / np.sqrt(max(told, 1.0 / np.ptp(bank.even) ** 2)))
