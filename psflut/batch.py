"""Many patches of one shape at once: what a map of distances needs of each, and nothing else."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from psflut import family
from psflut.candidates import Search, search, solution
from psflut.density import tails
from psflut.door import door
from psflut.errors import PsflutError
from psflut.estimation import Outcome, prior_density, verdict
from psflut.evidence import Bank, noise_power
from psflut.grid import cached_bank
from psflut.gross import mixed
from psflut.laplace import fine_model
from psflut.noise import Noise
from psflut.problem import Observation, Problem, is_flat, is_saturated, mean_level
from psflut.spread import along, spread
from psflut.table import PSFTable
from psflut.tabulated import FINE, cumulated, modes, quantiles, tabulate, widened

Floats = NDArray[np.float64]

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
    chunks = np.array_split(patches, max(1, -(-len(patches) // CHUNK)))
    with ThreadPoolExecutor(threads) as pool:
        done = list(pool.map(shared.solved, chunks))
    return Batch(*(np.concatenate([getattr(each, part.name) for each in done]) for part in fields(Batch)))


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

    def solved(self, patches: NDArray[np.floating]) -> Batch:
        """The estimates of a few patches, all at once in every step."""
        one, count = self.problem, len(patches)
        images = np.asarray(patches, dtype=np.float64)
        rings = self.bank.rings
        power, level = rings.power(images), mean_level(images, one.imager)
        seen = ~is_flat(rings.whole(power), one.noise, level, one.imager, one.shape)
        saturated = is_saturated(images)

        blank = prior_density(one.table)
        mode = blank.modes()[0]
        distance, weight, misfit = np.full(count, mode.distance), np.full(count, mode.weight), np.full(count, np.nan)
        interval = np.tile(blank.interval(one.level), (count, 1))
        outcome = np.full(count, OUTCOMES.index(Outcome.FLAT), dtype=np.int8)
        if seen.any():
            noise = noise_power(self.bank, one.noise, level[seen])
            found = search(power[seen], noise, self.bank)
            even, weight[seen], verdicts = self._read(self._densities(found, noise))
            metres = np.sort(one.table.position(even), axis=1)
            distance[seen], interval[seen], misfit[seen] = metres[:, 1], metres[:, [0, 2]], found.misfit
            outcome[seen] = [OUTCOMES.index(each) for each in verdicts]
            outcome[seen & saturated] = OUTCOMES.index(Outcome.SATURATED)
        return Batch(distance, interval, outcome, weight, misfit)

    @cached_property
    def _nodes(self) -> Floats:
        """(FINE,) of the densities, in the even coordinate."""
        return np.linspace(self.bank.even.min(), self.bank.even.max(), FINE)

    @cached_property
    def _width(self) -> Floats:
        """(FINE,) standard deviation of the errors of a table whose pixels have none, in nodes."""
        return np.asarray(along(self.problem.table, self._nodes) / (self._nodes[1] - self._nodes[0]))

    def _densities(self, found: Search, noise: Floats) -> Floats:
        """(B, FINE) posteriors, as `psflut.grid` makes them."""
        table, nodes = self.problem.table, self._nodes
        sharp = mixed(tabulate(found.even, found.log_evidence, found.seen), self.bank.prior.gross)
        if table.psf_std is None:  # then the table's errors are the same for all
            return widened(sharp, self._width)
        sd = np.empty_like(sharp)
        for number, own in enumerate(noise):
            even, fit, bank, _ = solution(found, number, self.bank)
            sd[number] = spread(table, bank, own, even, fit.log_evidence, fit.theta)(nodes)
        return widened(sharp, sd / (nodes[1] - nodes[0]))

    def _read(self, densities: Floats) -> tuple[Floats, Floats, list[Outcome]]:
        """Even coordinates (B, 3) of the heaviest mode's median between the interval's ends; its weight; outcomes."""
        cumulative, nodes, rows = cumulated(densities), self._nodes, np.arange(len(densities))
        found = modes(densities, cumulative)
        best, count = found.heaviest, np.bincount(found.row)
        low, high = tails(self.problem.level)
        weight = found.weight[best]
        wanted = np.stack([np.full(len(rows), low), found.below[best] + weight / 2, np.full(len(rows), high)], axis=1)
        places = quantiles(cumulative, np.repeat(rows, 3), wanted.ravel()).reshape(-1, 3)
        peak = np.argmax(densities, axis=1)
        verdicts = map(verdict, count, weight, (peak == 0) | (peak == FINE - 1))
        return nodes[0] + places * (nodes[1] - nodes[0]), weight, list(verdicts)
