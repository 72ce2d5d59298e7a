"""Many patches of one shape at once: what a map of distances needs of each, and nothing else."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from psflut.errors import PsflutError
from psflut.estimation import Observation, Outcome, estimate
from psflut.noise import Noise
from psflut.table import PSFTable

Floats = NDArray[np.float64]

OUTCOMES = tuple(Outcome)
"""The outcomes that the numbers in `Batch.outcome` stand for."""


@dataclass(frozen=True, eq=False)
class Batch:
    """The estimates of N patches.

    Parameters
    ----------
    distance : (N,) array
        Metres; finite in every outcome.
    interval : (N, 2) array
        Near and far end, metres.
    outcome : (N,) array of int8
        Places in `OUTCOMES`; 0 is OK.
    weight : (N,) array
        Probability of the heaviest mode.
    misfit : (N,) array
        As `psflut.evidence.misfit`; NaN where the patch is FLAT.
    """

    distance: Floats
    interval: Floats
    outcome: NDArray[np.int8]
    weight: Floats
    misfit: Floats


def estimate_all(
    patches: NDArray[np.floating],
    table: PSFTable,
    noise: Noise,
    imager: str | None = None,
    level: float = 0.95,
    candidates: int = 200,
    threads: int = 1,
) -> Batch:
    """The estimates that ``estimate(Observation(patch, noise, imager), table, "wiener")`` makes of each patch.

    Parameters
    ----------
    patches : (N, H, W) array
        Linear intensity, full scale 1; a view (``numpy.lib.stride_tricks.sliding_window_view``) is not copied whole.
    table : PSFTable
    noise : Noise
    imager : str or None
        As `family.parse` reads it; None: the table's.
    level : float
        Probability of the intervals.
    candidates : int
        As the setting of `psflut.estimators.wiener`.
    threads : int
        Patches are shared out among so many; the result does not depend on it.

    Raises
    ------
    PsflutError
        As `estimate` for any of the patches.
    """
    if np.ndim(patches) != 3:
        raise PsflutError(f"patches are an (N, H, W) array, got shape {np.shape(patches)}; stack them")
    method = f"wiener:candidates={candidates}"
    found = [estimate(Observation(patch, noise, imager), table, method, level) for patch in patches]
    return Batch(
        distance=np.array([each.distance for each in found]),
        interval=np.array([each.interval for each in found]).reshape(-1, 2),
        outcome=np.array([OUTCOMES.index(each.outcome) for each in found], dtype=np.int8),
        weight=np.array([each.modes[0].weight for each in found]),
        misfit=np.array([each.stats.get("misfit", np.nan) for each in found]),
    )
