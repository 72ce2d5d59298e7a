"""A capture and what methods make of it: the smallest piece of a comparison, the same wherever it is computed."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from psflut import family
from psflut.door import check_level
from psflut.errors import PsflutError
from psflut.estimation import AbstractEstimator, estimate
from psflut.shots import Measured, Shot, Simulated
from psflut.table import PSFTable

KNOWN = "+scene"
"""Ending of the name of a method that is told the ideal image."""

DIGITS = 10
"""Significant digits that are kept of a length: a tenth of a nanometre in a metre."""


class Unit(NamedTuple):
    """A piece of work: a position and a run by their numbers, and the methods that are to see that capture."""

    position: int
    run: int
    methods: tuple[str, ...]


class Record(NamedTuple):
    """What a method made of a capture. Lengths in metres, `corner_y`, `corner_x` in pixels of the source."""

    method: str
    position: int
    run: int
    truth: float
    source: str
    corner_y: int
    corner_x: int
    estimate: float
    near: float
    far: float
    outcome: str
    seconds: float


@dataclass(frozen=True, eq=False)
class Bench:
    """All that a unit of work needs: sent once to whoever works.

    Parameters
    ----------
    table : PSFTable
        That judges.
    shots : Simulated or Measured
    methods : mapping
        Of the name that the user gave to the estimator.
    level : float
        Probability of the intervals.
    seed : int
        Of methods that draw random numbers themselves.
    """

    table: PSFTable
    shots: Simulated | Measured
    methods: Mapping[str, AbstractEstimator]
    level: float = 0.95
    seed: int = 0

    def __post_init__(self) -> None:
        check_level(self.level)


def method(name: str) -> AbstractEstimator:
    """The estimator of a name such as ``wiener:candidates=200`` or ``golden_section+scene``.

    Raises
    ------
    PsflutError
        For an unknown method, or one that cannot use what the comparison has for it: a second image, a known scene.
    """
    part: AbstractEstimator = family.parse("psflut.estimators", name.removesuffix(KNOWN))
    known = name.endswith(KNOWN)
    if known and not part.uses_scene:
        raise PsflutError(f"{name.removesuffix(KNOWN)} does not use a known scene; leave {KNOWN} away")
    if part.uses_second and not known:
        raise PsflutError(f"{name} needs a second image, which a comparison has not; give it the scene: {name}{KNOWN}")
    return part


def trial(bench: Bench, unit: Unit) -> list[Record]:
    """What the methods of a unit make of its capture, a record each.

    Raises
    ------
    PsflutError
        If a method refuses the capture; the sentence names both.
    """
    shot = bench.shots.take(unit.position, unit.run)
    return [_record(bench, shot, unit, name) for name in unit.methods]


def _record(bench: Bench, shot: Shot, unit: Unit, name: str) -> Record:
    part, observation = bench.methods[name], shot.observation
    if name.endswith(KNOWN):
        observation = replace(observation, scene=shot.ideal)
    try:
        found = estimate(observation, bench.table, _seeded(part, bench.seed, unit), bench.level)
    except PsflutError as error:
        raise PsflutError(f"{name}, {shot.source} at {shot.truth:g} m: {error}") from error
    distance, near, far = (float(f"{metres:.{DIGITS}g}") for metres in (found.distance, *found.interval))
    return Record(
        method=name,
        position=unit.position,
        run=unit.run,
        truth=shot.truth,
        source=shot.source,
        corner_y=shot.corner[0],
        corner_x=shot.corner[1],
        estimate=distance,
        near=near,
        far=far,
        outcome=found.outcome.name.lower(),
        seconds=round(found.stats["seconds"], 6),
    )


def _seeded(part: AbstractEstimator, seed: int, unit: Unit) -> AbstractEstimator:
    """A method that draws random numbers draws others for every capture, from a stream that captures do not use."""
    if not hasattr(part, "seed"):
        return part
    stream = np.random.SeedSequence((seed, part.seed), spawn_key=(unit.position, unit.run, 1))
    seeded: AbstractEstimator = replace(part, seed=int(stream.generate_state(1)[0]))  # type: ignore[type-var]
    return seeded
