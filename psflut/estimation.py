"""One verb, one interchangeable method, one result: `estimate(observation, table, estimator)`."""

import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from psflut import family
from psflut.card import card, strip
from psflut.density import Density, Mode
from psflut.door import door
from psflut.problem import Observation as Observation
from psflut.problem import Problem as Problem
from psflut.table import PSFTable
from psflut.units import format_length

Floats = NDArray[np.float64]

LEAST_MODE = 0.95
"""Probability that one of several modes must have for the estimate not to be AMBIGUOUS."""


class Outcome(Enum):
    """How an estimate went; the value is the sentence that the user reads."""

    OK = ""
    AT_EDGE = "the distance lies at an end of the table; the object may be beyond it, so extend the table"
    FLAT = "the patch has no texture beyond its noise, so blur says nothing; the interval is the prior's"
    AMBIGUOUS = "several distances explain the patch and none has 95 % of the probability; read the modes"
    SATURATED = "part of the patch is at full scale, which passes for blur; expose less"
    NOT_CONVERGED = "the chain is shorter than 50 autocorrelation times; take more steps"


class Curve(NamedTuple):
    """What a method made of every candidate: positions (metres), values, and the values' name."""

    position: Floats
    value: Floats
    label: str


@dataclass(frozen=True, eq=False)
class Estimate:
    """A distance with its interval, and whether to believe it.

    Parameters
    ----------
    distance : float
        Metres; finite in every outcome.
    interval : (near, far)
        Metres, at probability `level`.
    level : float
    outcome : Outcome
    modes : tuple of Mode
        Peaks of the posterior, heaviest first.
    curve : Curve or None
    stats : mapping
        Numbers and words about the run, as JSON has them.
    detail : mapping
        Arrays: a restored patch, a chain.
    """

    distance: float
    interval: tuple[float, float]
    level: float
    outcome: Outcome = Outcome.OK
    modes: tuple[Mode, ...] = ()
    curve: Curve | None = None
    stats: Mapping[str, Any] = field(default_factory=dict)
    detail: Mapping[str, Any] = field(default_factory=dict)

    def _repr_html_(self) -> str:
        """A card, for a notebook."""
        rows = [(f"{self.level:.0%} interval", " to ".join(format_length(end) for end in self.interval))]
        if len(self.modes) > 1:
            rows.append(("modes", ", ".join(f"{format_length(z)} ({weight:.0%})" for z, weight in self.modes)))
        rows.append(("outcome", self.outcome.name.lower().replace("_", " ")))
        if "misfit" in self.stats:
            rows.append(("misfit", f"{self.stats['misfit']:.2f}"))
        if self.curve is None:
            return card(format_length(self.distance), rows, note=self.outcome.value)
        span = float(np.min(self.curve.position)), float(np.max(self.curve.position))
        return card(format_length(self.distance), rows, strip(span, self.interval, self.modes), self.outcome.value)


class AbstractEstimator(ABC):
    """A method of estimating distance: a frozen dataclass of its settings. Its repr is its recipe."""

    uses_scene: ClassVar[bool] = False
    """Whether it can use a known ideal image."""
    knows: ClassVar[str] = ""
    """What the scene is known to be, "a point" say; empty for a method that takes any texture."""
    uses_second: ClassVar[bool] = False
    """Whether it compares the patch with a second image of the same scene."""
    sees_flat: ClassVar[bool] = False
    """Whether it tells by itself that a patch shows nothing, by `nothing_to_see`."""

    @abstractmethod
    def solve(self, problem: Problem) -> Estimate:
        """The estimate for a checked problem."""


def estimate(
    observation: Observation, table: PSFTable, estimator: AbstractEstimator | str, level: float = 0.95
) -> Estimate:
    """Estimate the distance of a patch.

    Parameters
    ----------
    observation : Observation
    table : PSFTable
    estimator : AbstractEstimator or str
        Or its name and settings, such as ``"wiener"``.
    level : float
        Probability of the interval.

    Returns
    -------
    Estimate
        With ``noise``, ``noise_source`` and ``seconds`` in its stats.

    Raises
    ------
    PsflutError
        For a patch that is smaller than the table's PSF, not finite, or negative though the imager is not
        signed; for an unknown method, or a known scene or second image that the method does not use.
    """
    method = family.parse("psflut.estimators", estimator) if isinstance(estimator, str) else estimator
    problem = door(observation, table, method, level)
    start = time.perf_counter()
    flat = not method.sees_flat and problem.is_flat
    result = nothing_to_see(problem) if flat else method.solve(problem)
    saturated = any(each.is_saturated for each in (problem, problem.second) if each is not None)
    if result.outcome is not Outcome.FLAT and saturated:
        result = replace(result, outcome=Outcome.SATURATED)
    stats = {
        "noise": problem.noise.read,
        "noise_source": problem.noise_source,
        **result.stats,
        "seconds": time.perf_counter() - start,
    }
    return replace(result, stats=stats)


def for_any_scene() -> tuple[str, ...]:
    """Names of the methods that take one image of any texture."""
    parts = {name: family.load("psflut.estimators", name) for name in family.names("psflut.estimators")}
    return tuple(name for name, part in parts.items() if not (part.knows or part.uses_second))


def judge(density: Density) -> tuple[Outcome, dict[str, Any]]:
    """The outcome of a posterior density, and what the stats say of it."""
    modes, edge = density.modes(), density.edge()
    outcome = verdict(len(modes), modes[0].weight, edge is not None)
    return outcome, {"edge": edge} if outcome is Outcome.AT_EDGE else {}


def verdict(modes: int, weight: float, at_edge: bool) -> Outcome:
    """The outcome of a posterior density of so many modes, the heaviest of that probability."""
    if modes > 1 and weight < LEAST_MODE:
        return Outcome.AMBIGUOUS
    return Outcome.AT_EDGE if at_edge else Outcome.OK


def conclude(
    problem: Problem, density: Density, curve: Curve, stats: Mapping[str, Any], detail: Mapping[str, Any]
) -> Estimate:
    """The estimate that a posterior density makes: the median of its heaviest mode, its interval, its outcome."""
    outcome, told = judge(density)
    return Estimate(
        distance=density.modes()[0].distance,
        interval=density.interval(problem.level),
        level=problem.level,
        outcome=outcome,
        modes=density.modes(),
        curve=curve,
        stats={**told, **stats},
        detail=detail,
    )


def prior_density(table: PSFTable, span: tuple[float, float] | None = None) -> Density:
    """What is known before the patch is seen: flat in vergence (or stage) over the span, metres; else the table's."""
    low, high = np.sort(table.even(span or table.span))
    even = np.linspace(low, high, 8)
    return Density(even, np.zeros_like(even), table.position)


def nothing_to_see(problem: Problem, span: tuple[float, float] | None = None) -> Estimate:
    """The answer to a patch that says nothing of distance: FLAT, with what was known before."""
    density = prior_density(problem.table, span)
    modes = density.modes()
    return Estimate(modes[0].distance, density.interval(problem.level), problem.level, Outcome.FLAT, modes)
