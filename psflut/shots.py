"""Captures of known distance for a comparison: simulated from photographs, or patches of real frames."""

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from psflut import capture, layout
from psflut.errors import PsflutError
from psflut.estimation import Observation
from psflut.table import PSFTable

Floats = NDArray[np.floating]

MARGIN = 0.1
"""Share of the gap between two planes of a table that simulated captures keep from either."""


@dataclass(frozen=True, eq=False)
class Shot:
    """A patch, and the truth about it.

    Parameters
    ----------
    observation : Observation
        Of the patch, without its scene.
    truth : float
        Distance or stage coordinate, metres.
    source : str
        Name of the photograph or frame.
    corner : (int, int)
        Row and column of the patch's upper left pixel in it.
    ideal : (H, W) array or None
        What the imager would have recorded without blur and noise, where it is known.
    """

    observation: Observation
    truth: float
    source: str
    corner: tuple[int, int]
    ideal: Floats | None = None


@dataclass(frozen=True, eq=False)
class Simulated:
    """Captures of photographs through the set-up behind a table, in the PSFs of its model (`capture.psf_of`).

    Every capture is drawn from a random stream of its own, (seed, position, run), so that none depends on how many
    others there are or who draws them. Run after run takes the next photograph, at a place of its own.

    Parameters
    ----------
    table : PSFTable
    setup : capture.Setup
    photographs : sequence of (name, (H, W) array)
        Sharp scenes in linear intensity, full scale 1.
    positions : tuple of float
        Distances or stage coordinates, metres.
    runs : int
        Captures at every position.
    size : int
        Side of a patch, pixels.
    seed : int

    Raises
    ------
    PsflutError
        For a photograph that is smaller than the patch, or a patch that is smaller than the table's PSF.
    """

    table: PSFTable
    setup: capture.Setup
    photographs: Sequence[tuple[str, Floats]]
    positions: tuple[float, ...]
    runs: int
    size: int
    seed: int

    def __post_init__(self) -> None:
        if self.size < self.table.size:
            raise PsflutError(
                f"patches of {self.size} pixels are smaller than the table's PSF of {self.table.size}; "
                "give a larger --size"
            )
        for name, picture in self.photographs:
            if min(picture.shape) < self.size:
                height, width = picture.shape
                raise PsflutError(
                    f"{name} has {height} x {width} pixels, fewer than patches of {self.size}; give larger pictures "
                    "or a smaller --size"
                )

    def counts(self) -> list[int]:
        """Captures at every position."""
        return [self.runs] * len(self.positions)

    def settings(self) -> dict[str, Any]:
        """What decides on the captures; plain JSON."""
        pictures = {name: fingerprint(picture) for name, picture in self.photographs}
        own = {"positions": self.positions, "photographs": pictures, "size": self.size, "seed": self.seed}
        return {**asdict(self.setup), **own}

    def take(self, position: int, run: int) -> Shot:
        """The capture of that number at the position of that number."""
        rng = np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(position, run)))
        name, scene = self.photographs[run % len(self.photographs)]
        truth = self.positions[position]
        picture, noise = capture.simulate(scene, self.table, truth, self.setup, int(rng.integers(2**32)))
        y, x = (int(rng.integers(n - self.size + 1)) for n in picture.shape)
        window = slice(y, y + self.size), slice(x, x + self.size)
        ideal = capture.ideal_image(scene, self.setup)[window]
        return Shot(Observation(picture[window], noise, self.setup.imager), truth, name, (y, x), ideal)


@dataclass(frozen=True, eq=False)
class Measured:
    """Patches of real frames: position after position, as many runs as there are frames at it."""

    positions: tuple[float, ...]
    shots: tuple[tuple[Shot, ...], ...]

    def counts(self) -> list[int]:
        """Frames at every position."""
        return [len(shots) for shots in self.shots]

    def settings(self) -> dict[str, Any]:
        """What decides on the captures; plain JSON."""
        seen = [shot.observation for shots in self.shots for shot in shots]
        about = [(one.imager, repr(one.noise), one.quantum) for one in seen]
        return {"positions": self.positions, "frames": fingerprint(*(one.image for one in seen)), "of": about}

    def take(self, position: int, run: int) -> Shot:
        """The frame of that number at the position of that number."""
        return self.shots[position][run]


def between(table: PSFTable, count: int) -> tuple[float, ...]:
    """`count` positions (metres) over a table's span, nearly even, none of them near a plane of the table.

    Evenly spread ones, the first and last half a step from the ends, go to 0.1 + 0.8 f of the gap between the planes
    at whose share f they lie.
    """
    near, far = table.span
    even = near + (far - near) * (np.arange(count) + 0.5) / count
    gap = np.searchsorted(table.axis, even, side="right") - 1
    low, high = table.axis[gap], table.axis[gap + 1]
    return tuple(float(z) for z in low + MARGIN * (high - low) + (1 - 2 * MARGIN) * (even - low))


def table_print(table: PSFTable) -> str:
    """A short hash of all that estimates read of a table: its arrays, which are named, and the kind of its axis."""
    arrays = layout.arrays_of(table)
    return fingerprint(np.array([table.kind, *arrays]), *arrays.values())


def fingerprint(*arrays: Any) -> str:
    """A short hash of arrays, for settings: the same values, types and shapes have the same."""
    found = hashlib.sha256()
    for array in arrays:
        found.update(f"{array.dtype}{array.shape}".encode())
        found.update(array.tobytes())
    return found.hexdigest()[:16]
