"""Pieces of a map that are finished, kept on disk until all are: a run that was stopped goes on where it was."""

import json
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from psflut import __version__
from psflut.batch import Batch
from psflut.errors import PsflutError
from psflut.files import arrays_in, claimed
from psflut.frames import Files
from psflut.mapping import Done, Job, Piece
from psflut.shots import table_print

SETTINGS = "settings.json"

Work = Callable[[Job, Sequence[Piece]], Iterator[Done]]


def settings(job: Job, frames: Files) -> dict[str, Any]:
    """What decides on the results of a job on files; plain JSON."""
    paths = dict.fromkeys(page.path for page in frames.pages)
    files = [file for path in paths for file in (sorted(path.rglob("*")) if path.is_dir() else [path])]
    return {
        "psflut": __version__,
        "table": table_print(job.table),
        "files": [[str(file.resolve()), file.stat().st_mtime_ns, file.stat().st_size] for file in files],
        "frames": list(frames.names),
        "encoding": [frames.gamma, frames.srgb],
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
        for each in (folder, beginning(folder)):
            shutil.rmtree(each, ignore_errors=True)


def beginning(folder: Path) -> Path:
    """Where the folder of pieces is made ready."""
    return folder.with_name(f"{folder.name}.begun")


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
            old = json.loads((folder / SETTINGS).read_text()) if folder.exists() else self.settings
        except (OSError, ValueError):
            old = None
        if old != self.settings:
            raise PsflutError(f"{folder} keeps an unfinished map of other settings; remove it, or choose another name")

    def done(self, piece: Piece) -> Batch | None:
        """A piece's estimates where they are kept whole; a damaged one is worked out again."""
        found = arrays_in(self.path(piece))
        return None if found is None else Batch(**found)

    def keep(self, piece: Piece, batch: Batch) -> None:
        """Keep a piece, whole or not at all."""
        try:
            if not self.folder.is_dir():
                self._begin()
            stage = self.folder / "part.npz"
            np.savez(stage, **vars(batch))
            stage.replace(self.path(piece))
        except OSError as error:
            raise PsflutError(f"cannot write {self.folder}: {error.strerror or error}; make room and go on") from error

    def _begin(self) -> None:
        """The folder, never without its settings: whoever is killed meanwhile leaves none."""
        stage = beginning(self.folder)
        shutil.rmtree(stage, ignore_errors=True)
        stage.mkdir()
        (stage / SETTINGS).write_text(json.dumps(self.settings))
        stage.rename(self.folder)

    def path(self, piece: Piece) -> Path:
        """Of a piece's file."""
        return self.folder / f"{piece.frame}-{piece.first}-{piece.last}.npz"
