"""Many patches of one shape at once: what a map of distances needs of each, and nothing else."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from psflut import family
from psflut.candidates import solve_all
from psflut.density import Density
from psflut.door import door
from psflut.errors import PsflutError
from psflut.estimation import Outcome, judge, prior_density
from psflut.evidence import Bank, noise_power
from psflut.grid import cached_bank
from psflut.gross import mixed
from psflut.laplace import fine_model
from psflut.noise import Noise
from psflut.problem import Observation, Problem
from psflut.spectrum import annular_power
from psflut.spread import spread
from psflut.table import PSFTable

Floats = NDArray[np.float64]
Row = tuple[float, tuple[float, float], Outcome, float, float]

CHUNK = 32
"""Patches worked on together: what they need stays in the cache."""

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
    problem = _worst(np.asarray(patches), table, noise, imager, level)
    shared = _Shared(problem, candidates)
    chunks = np.array_split(patches, -(-len(patches) // CHUNK)) if len(patches) else []
    with ThreadPoolExecutor(threads) as pool:
        rows = [row for some in pool.map(shared.rows, chunks) for row in some]
    distance, interval, outcome, weight, misfit = zip(*rows, strict=True) if rows else ([], [], [], [], [])
    return Batch(
        distance=np.array(distance),
        interval=np.array(interval).reshape(-1, 2),
        outcome=np.array([OUTCOMES.index(each) for each in outcome], dtype=np.int8),
        weight=np.array(weight),
        misfit=np.array(misfit),
    )


def _worst(patches: NDArray[Any], table: PSFTable, noise: Noise, imager: str | None, level: float) -> Problem:
    """The patch that is likeliest to be refused, behind the door; where it passes all do."""
    if not len(patches):
        patches = np.full((1, *np.maximum(patches.shape[1:], table.size)), 0.5)
    lows = patches.real.min(axis=(1, 2)) + 0 * patches.real.max(axis=(1, 2))
    unsound = ~np.isfinite(lows)
    worst = np.argmax(unsound) if unsound.any() else np.argmin(lows)
    return door(Observation(patches[worst], noise, imager), table, family.parse("psflut.estimators", "wiener"), level)


@dataclass(frozen=True, eq=False)
class _Shared:
    """What all patches have in common: that of one of them, and how finely the table is searched."""

    problem: Problem
    candidates: int

    def __post_init__(self) -> None:
        fine_model(self.bank)  # before threads ask for it

    @property
    def bank(self) -> Bank:
        """Kept for all patches of that shape."""
        return cached_bank(self.problem.table, self.problem.shape, self.problem.imager, self.candidates)

    def rows(self, patches: NDArray[np.floating]) -> list[Row]:
        """Of each of a few patches: distance, interval, outcome, weight and misfit."""
        problems = [replace(self.problem, image=patch) for patch in np.asarray(patches, dtype=np.float64)]
        powers = annular_power(np.stack([each.image for each in problems]))
        for each, power in zip(problems, powers, strict=True):
            vars(each)["power"] = power
        flat = [each.is_flat for each in problems]
        found = iter(self._densities([each for each, blank in zip(problems, flat, strict=True) if not blank]))
        return [self._row(each, None if blank else next(found)) for each, blank in zip(problems, flat, strict=True)]

    def _densities(self, problems: list[Problem]) -> list[tuple[Density, float]]:
        """The posterior of each problem and its misfit, as `psflut.grid` makes them."""
        if not problems:
            return []
        table, shape, bank = self.problem.table, self.problem.shape, self.bank
        noises = np.stack([noise_power(bank, each.noise, each.mean_level) for each in problems])
        solutions = solve_all(np.stack([each.power for each in problems]), noises, bank)
        exact = [Density(each.even, each.fit.log_evidence, table.position) for each in solutions]
        values = mixed(np.stack([each.values for each in exact]), bank.prior.gross)
        widths = [
            spread(table, shape, each.bank, noise, each.even, each.fit.log_evidence, each.fit.theta)
            for each, noise in zip(solutions, noises, strict=True)
        ]
        if table.psf_std is None:  # then the table's errors are the same for all
            common = widths[0](exact[0].nodes)
            widths = [lambda _: common] * len(widths)
        return [
            (Density.tabled(sharp.nodes, row, table.position).widened(width), each.misfit)
            for sharp, row, width, each in zip(exact, values, widths, solutions, strict=True)
        ]

    def _row(self, problem: Problem, found: tuple[Density, float] | None) -> Row:
        density, misfit = found or (prior_density(problem.table), np.nan)
        outcome = judge(density)[0] if found else Outcome.FLAT
        if found and problem.is_saturated:
            outcome = Outcome.SATURATED
        distance, weight = density.modes()[0]
        return distance, density.interval(problem.level), outcome, weight, misfit
