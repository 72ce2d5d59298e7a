"""The work behind a map of distances: cut in pieces that fit in memory, done in any order, kept as they are finished.

A piece is some rows of patches of one frame, read from the lines of pixels they need, overlap included: no piece
depends on another, so that all ways of cutting give the same. On one machine threads share out the patches of a piece,
which needs no Dask; on a cluster (`psflut.cluster`) its workers share out the pieces.
"""

import json
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from psflut import __version__
from psflut.batch import Batch, estimate_all
from psflut.errors import PsflutError
from psflut.files import claimed
from psflut.frames import Frames
from psflut.noise import Noise
from psflut.shots import fingerprint
from psflut.table import PSFTable
from psflut.tiles import Tiles

PATCHES = 1024
"""Of a piece, as far as whole rows have no more."""

SETTINGS = "settings.json"


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


def local(job: Job, pieces: Sequence[Piece], threads: int = 1) -> Iterator[Done]:
    """The estimates of every piece, one after the other in this process."""
    return (solve(job, piece, threads) for piece in pieces)


Work = Callable[[Job, Sequence[Piece]], Iterator[Done]]


def settings(job: Job, paths: Sequence[str]) -> dict[str, Any]:
    """What decides on the results of a job on files; plain JSON."""
    files = [Path(path) for path in paths]
    return {
        "psflut": __version__,
        "table": fingerprint(job.table.axis, job.table.psf),
        "files": [[str(path.resolve()), path.stat().st_mtime_ns, path.stat().st_size] for path in files],
        "frames": list(job.frames.names),
        "tiles": asdict(job.tiles),
        "noise": asdict(job.noise),
        "imager": job.imager,
        "level": job.level,
    }


@contextmanager
def resumed(
    job: Job, pieces: Sequence[Piece], work: Work, folder: Path | None, about: Mapping[str, Any]
) -> Iterator[Iterator[Done]]:
    """All pieces: those that a folder keeps, then what `work` makes of the others, kept as they come.

    The folder goes when the block ends well: then the map must have been written. Without a folder nothing is kept.

    Raises
    ------
    PsflutError
        If the folder keeps pieces of other settings, another process has it, or it cannot be written.
    """
    if folder is None:
        yield work(job, pieces)
        return
    with claimed(folder):
        kept = Kept(folder, about)
        yield _going_on(job, pieces, work, kept)
        shutil.rmtree(folder, ignore_errors=True)


def _going_on(job: Job, pieces: Sequence[Piece], work: Work, kept: "Kept") -> Iterator[Done]:
    left = []
    for piece in pieces:
        batch = kept.done(piece)
        if batch is None:
            left.append(piece)
        else:
            yield piece, batch
    for piece, batch in work(job, left):
        kept.keep(piece, batch)
        yield piece, batch


class Kept:
    """Finished pieces in a folder, a file each, so that a run that was stopped goes on where it was.

    Parameters
    ----------
    folder : Path
        Made with the first piece.
    settings : mapping
        What decides on the results, plain JSON; whoever goes on must have the same.

    Raises
    ------
    PsflutError
        If the folder holds pieces of other settings.
    """

    def __init__(self, folder: Path, settings: Mapping[str, Any]) -> None:
        self.folder, self.settings = folder, json.loads(json.dumps(settings))
        try:
            old = json.loads((folder / SETTINGS).read_text()) if (folder / SETTINGS).is_file() else self.settings
        except ValueError:
            old = None
        if old != self.settings:
            raise PsflutError(f"{folder} keeps an unfinished map of other settings; remove it, or choose another name")

    def done(self, piece: Piece) -> Batch | None:
        """A piece's estimates where they are kept."""
        path = self.path(piece)
        if not path.is_file():
            return None
        with np.load(path) as data:
            return Batch(**data)

    def keep(self, piece: Piece, batch: Batch) -> None:
        """Keep a piece, whole or not at all."""
        try:
            if not self.folder.is_dir():
                self.folder.mkdir()
                (self.folder / SETTINGS).write_text(json.dumps(self.settings))
            stage = self.folder / "part.npz"
            np.savez(stage, **vars(batch))
            stage.replace(self.path(piece))
        except OSError as error:
            raise PsflutError(f"cannot write {self.folder}: {error.strerror or error}; make room and go on") from error

    def path(self, piece: Piece) -> Path:
        """Of a piece's file."""
        return self.folder / f"{piece.frame}-{piece.first}-{piece.last}.npz"
