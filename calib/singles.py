"""Points of a calibration, each by itself: tables of single points, of which `calib.modes` learns how they differ."""

import contextlib
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.build import table_of
from calib.manifest import Manifest
from calib.modes import check_count
from calib.targets import Measurement, Shot, Target
from calib.targets.point import Point
from psflut import family
from psflut.errors import PsflutError
from psflut.imagers import Imager
from psflut.table import Kind, PSFTable

Floats = NDArray[np.float64]

NEAR = 2.0
"""Pixels from its first row within which a row names the same point."""

MEASURED = 0.9
"""Of the positions, rounded down, at which a point must be measured: what it lacks at an end would pass for a mode."""


@dataclass(frozen=True, eq=False)
class Singles:
    """Points that stand at the same place of the frame at every position.

    A point alone is averaged over the frames of its position, by Fourier shifts: beyond the pixels' sampling one point
    tells nothing (`calib.targets.point`).

    Parameters
    ----------
    places : (P, 2) array
        Of the points, (y, x), pixels.
    target : Point
        How each is measured.
    modes : int
        That are asked for.
    """

    places: Floats
    target: Point
    modes: int

    @classmethod
    def named(cls, manifest: Manifest, target: Target, modes: int) -> "Singles":
        """The points that a manifest's rows name by their x and y.

        Raises
        ------
        PsflutError
            If the target is no point, a row names none, or they are too few for so many modes.
        """
        if not isinstance(target, Point):
            raise PsflutError(
                f"modes are how points differ, so they want --target point, got {family.describe(target)}"
            )
        places: list[tuple[float, float]] = []
        for row in manifest.rows:
            if row.centre is None:
                raise PsflutError(f"modes want points that are named: give x and y in every row, {row.name} has none")
            if not places or np.hypot(*(np.array(places) - row.centre).T).min() > NEAR:
                places.append(row.centre)
        check_count(modes, len(places))
        return cls(np.array(places), replace(target, oversampling=1, rounds=3), modes)

    def measure(self, shots: Sequence[Shot], size: int, imager: Imager) -> list[Measurement | None]:
        """What each point alone shows at one position, None where it cannot be measured."""
        own: defaultdict[int, list[Shot]] = defaultdict(list)
        for shot in shots:
            away = self.places - np.array(shot.centre)
            own[int(np.argmin(np.hypot(*away.T)))].append(shot)
        found: list[Measurement | None] = [None] * len(self.places)
        for point, its in own.items():
            with contextlib.suppress(PsflutError):
                found[point] = self.target.measure(its, size, imager)
        return found

    def tables(
        self, axis: Floats, kind: Kind, measured: Sequence[Sequence[Measurement | None]], pixel_pitch: float
    ) -> tuple[list[PSFTable], list[str]]:
        """The table of every point that was measured at nearly all positions, and why others have none.

        Parameters
        ----------
        axis : (N,) array
            Positions, metres.
        measured : N sequences of P
            From `measure`.

        Raises
        ------
        PsflutError
            If too few are left for so many modes.
        """
        tables, rejected = [], []
        for (y, x), course in zip(self.places, zip(*measured, strict=True), strict=True):
            there = {z: each for z, each in zip(axis, course, strict=True) if each is not None}
            if len(there) >= max(3, int(MEASURED * len(axis))):
                tables.append(table_of(np.array(list(there)), kind, list(there.values()), pixel_pitch))
            else:
                rejected.append(f"modes: the point at y {y:.0f}, x {x:.0f} is measured at {len(there)} positions only")
        check_count(self.modes, len(tables))
        return tables, rejected
