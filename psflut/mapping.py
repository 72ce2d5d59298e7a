"""The work behind a map of distances: cut in pieces that fit in memory, done in any order.

A piece is some rows of patches of one frame, read from the lines of pixels they need, overlap included: no piece
depends on another, so that all ways of cutting give the same. One process does them, or one on every core
(`psflut.workers`, which needs no Dask), or a cluster (`psflut.cluster`).
"""

from dataclasses import dataclass
from typing import NamedTuple

from psflut.batch import Batch, estimate_all
from psflut.errors import PsflutError
from psflut.frames import Frames
from psflut.noise import Noise, estimate_noise
from psflut.table import PSFTable
from psflut.tiles import Tiles

PATCHES = 1024
"""Of a piece, as far as whole rows have no more."""

MIDDLE = 1024
"""Side of the middle of an image that noise is estimated from, pixels."""


class Piece(NamedTuple):
    """Rows `first` to `last` (exclusive) of patches of a frame."""

    frame: int
    first: int
    last: int


@dataclass(frozen=True, eq=False)
class Job:
    """All that a piece of work needs: sent once to whoever works.

    Parameters
    ----------
    frames : Frames
    tiles : Tiles
    table : PSFTable
    noise : Noise
    imager : str
    level : float
        Probability of the intervals.
    """

    frames: Frames
    tiles: Tiles
    table: PSFTable
    noise: Noise
    imager: str
    level: float

    def pieces(self) -> list[Piece]:
        """All of it, frame after frame."""
        rows, columns = self.tiles.grid
        step = max(1, PATCHES // columns)
        starts = range(0, rows, step)
        return [Piece(k, row, min(row + step, rows)) for k in range(len(self.frames.names)) for row in starts]


def plan(
    frames: Frames, table: PSFTable, size: int, stride: int, noise: Noise | None, imager: str | None, level: float
) -> Job:
    """The work of a map, checked at the door."""
    if size < table.size:
        raise PsflutError(
            f"patches of {size} pixels are smaller than the table's PSF of {table.size}; give a larger --size"
        )
    tiles = Tiles(frames.shape, size, stride)
    return Job(frames, tiles, table, noise or table.noise or _estimated(frames), imager or table.imager, level)


def _estimated(frames: Frames) -> Noise:
    """Noise of the middle of the first frame."""
    height, width = frames.shape
    top, left = (max(side - MIDDLE, 0) // 2 for side in (height, width))
    lines = frames.lines(0, top, min(top + MIDDLE, height))
    return estimate_noise(lines.image[:, left : left + MIDDLE], lines.quantum)


Done = tuple[Piece, Batch]


def solve(job: Job, piece: Piece, threads: int = 1) -> Done:
    """The estimates of a piece.

    Raises
    ------
    PsflutError
        As `estimate` and `read_image` do; the sentence names the frame.
    """
    try:
        pixels = job.frames.lines(piece.frame, *job.tiles.lines(piece.first, piece.last)).image
        patches = job.tiles.cut(pixels).reshape(-1, job.tiles.size, job.tiles.size)
        return piece, estimate_all(patches, job.table, job.noise, job.imager, job.level, threads=threads)
    except PsflutError as error:
        name = job.frames.names[piece.frame]
        raise PsflutError(str(error) if name in str(error) else f"frame {name}: {error}") from error
