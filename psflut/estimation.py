"""One verb, one interchangeable method, one result: `estimate(observation, table, estimator)`."""

import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from psflut import family
from psflut.card import card, strip
from psflut.density import Density, Mode
from psflut.errors import PsflutError
from psflut.imagers import Imager
from psflut.noise import Noise, estimate_noise
from psflut.spectrum import annular_power, annuli
from psflut.table import PSFTable
from psflut.units import format_length

Floats = NDArray[np.float64]

NEGATIVE_SIGMAS = 6.0
"""A plain image may fall below zero by so many noise sigma, and no further."""

TEXTURE_SIGMAS = 3.0
"""A patch is FLAT unless its power exceeds the noise's by so many of its standard deviations."""

SATURATED_SHARE = 0.005
"""Share of pixels at exactly full scale from which a patch is SATURATED."""

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
class Observation:
    """A patch and what is known of how it was taken.

    Parameters
    ----------
    image : (H, W) array
        Linear intensity, full scale 1; signed where the imager is.
    noise : Noise or None
        None: the table's, else an estimate from the image.
    imager : str or None
        As `family.parse` reads it; None: the table's.
    scene : (H, W) array or None
        The ideal image where it is known: what the imager would record without blur and noise.
    quantum : float
        Step between levels of the image, image units, 0 if unknown; bounds an estimated noise from below.
    second : (Observation, PSFTable) or None
        The same patch taken with another setting of the camera, and that setting's table.
    """

    image: NDArray[np.floating]
    noise: Noise | None = None
    imager: str | None = None
    scene: NDArray[np.floating] | None = None
    quantum: float = 0.0
    second: "tuple[Observation, PSFTable] | None" = None


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


@dataclass(frozen=True, eq=False)
class Problem:
    """An observation after the door: complete and checked. What an estimator solves.

    Parameters
    ----------
    image, scene : (H, W) float64 arrays
    table, imager, noise : PSFTable, Imager, Noise
    noise_source : "given", "table" or "image"
    level : float
        Of the interval.
    second : Problem or None
        The second image, of the same shape and imager.
    """

    image: NDArray[np.floating]
    table: PSFTable
    imager: Imager
    noise: Noise
    noise_source: str
    level: float
    scene: NDArray[np.floating] | None = None
    second: "Problem | None" = None

    @property
    def shape(self) -> tuple[int, int]:
        """Of the patch, in pixels."""
        return self.image.shape[0], self.image.shape[1]

    @cached_property
    def power(self) -> Floats:
        """(K,) mean power of the patch in each annulus, image units squared."""
        return annular_power(self.image)

    @property
    def mean_level(self) -> float:
        """Mean signal before the imager, on which photon noise depends; half of full scale where the imager
        hides it."""
        return 0.5 if self.imager.signed else float(self.image.mean())

    @property
    def is_flat(self) -> bool:
        """Whether the patch's power is what its noise alone would have.

        Noise of known power has, over all annuli, sum n_k (P_k / N_k - 1) of mean zero and variance sum n_k.
        """
        rings = annuli(self.shape)
        response = rings.mean(self.imager.transfer(self.shape) ** 2)
        excess = rings.effective * (self.power / self.noise.power(response, self.mean_level) - 1)
        return bool(excess.sum() < TEXTURE_SIGMAS * np.sqrt(rings.effective.sum()))

    @property
    def is_saturated(self) -> bool:
        """Whether too many pixels are at exactly full scale."""
        return bool(np.mean(self.image == 1.0) >= SATURATED_SHARE)


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
    problem = _door(observation, table, method, level)
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
    modes = density.modes()
    if len(modes) > 1 and modes[0].weight < LEAST_MODE:
        return Outcome.AMBIGUOUS, {}
    edge = density.edge()
    return (Outcome.AT_EDGE, {"edge": edge}) if edge else (Outcome.OK, {})


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


def _door(observation: Observation, table: PSFTable, estimator: AbstractEstimator, level: float) -> Problem:
    if not 0 < level < 1:
        raise PsflutError(f"level is a probability between 0 and 1, got {level}")
    image = _sound(observation.image, table.size)
    imager = family.parse("psflut.imagers", observation.imager or table.imager)
    source, noise = _noise(observation, table, image)
    if not imager.signed and image.min() < -NEGATIVE_SIGMAS * noise.read and not _is_normalised(table):
        raise PsflutError(
            f"the patch falls to {image.min():.3g}, but a plain image is not negative; "
            "check its offset, or name its imager"
        )
    known, second = _known(observation, estimator), _second(observation, imager, estimator, level)
    return Problem(image, table, imager, noise, source, level, known, second)


def _sound(image: NDArray[Any], least: int) -> Floats:
    """The patch in double precision, once it is seen to be real, finite and large enough."""
    image = np.asarray(image)
    if image.ndim != 2 or not (np.isrealobj(image) and np.issubdtype(image.dtype, np.number)):
        raise PsflutError(f"a patch is a real (H, W) array, got {image.dtype} of shape {image.shape}; give one channel")
    if min(image.shape) < least:
        raise PsflutError(
            f"the patch of {image.shape[0]} x {image.shape[1]} pixels is smaller than the table's PSF ({least}); "
            "take a larger patch"
        )
    if not np.all(np.isfinite(image)):
        raise PsflutError("the patch holds values that are not finite; mask or replace them")
    return image.astype(np.float64)


def _noise(observation: Observation, table: PSFTable, image: Floats) -> tuple[str, Noise]:
    """Where the noise comes from, and the noise: given, else the table's, else estimated from the image."""
    if observation.noise is not None:
        return "given", observation.noise
    if table.noise is not None:
        return "table", table.noise
    return "image", estimate_noise(image, observation.quantum)


def _is_normalised(table: PSFTable) -> bool:
    """Whether the set-up behind the table scales its captures, so that zero means nothing."""
    return bool(table.provenance.get("capture", {}).get("normalise", False))


def _known(observation: Observation, estimator: AbstractEstimator) -> Floats | None:
    if observation.scene is None:
        return None
    scene = np.asarray(observation.scene, dtype=np.float64)
    if not estimator.uses_scene:
        raise PsflutError(f"{family.describe(estimator)} does not use a known scene; leave the scene out")
    if scene.shape != np.shape(observation.image) or not np.all(np.isfinite(scene)):
        raise PsflutError(
            f"the known scene must be finite and of the patch's shape {np.shape(observation.image)}, got {scene.shape}"
        )
    return scene


def _second(observation: Observation, imager: Imager, estimator: AbstractEstimator, level: float) -> Problem | None:
    if observation.second is None:
        return None
    if not estimator.uses_second:
        raise PsflutError(f"{family.describe(estimator)} does not use a second image; leave it out or name two_image")
    second = _door(*observation.second, estimator, level)
    if second.shape != np.shape(observation.image) or second.imager != imager:
        raise PsflutError(
            "both images must show the same patch through one imager, got "
            f"{np.shape(observation.image)} through {family.describe(imager)} and {second.shape} through "
            f"{family.describe(second.imager)}; crop and filter them alike"
        )
    return second
