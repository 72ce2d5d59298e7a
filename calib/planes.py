"""Finished planes of a build, kept beside the table until that is written: a build that was killed goes on from them.

Each is a file of its own in the hidden folder ``.NAME.planes``, named by the sha256 of everything that decides on it:
the code of this psflut among them, so that no plane of other code is ever taken.
"""

import hashlib
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.targets import Measurement, Shot, Target
from psflut.errors import PsflutError
from psflut.files import arrays_in, claimed
from psflut.imagers import Imager

Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class Planes:
    """Planes in a folder; without one nothing is kept."""

    folder: Path | None = None

    def get(self, about: Sequence[object], make: Callable[[], Arrays]) -> Arrays:
        """The arrays that `make` gives, read where they are kept already.

        Parameters
        ----------
        about : sequence
            What decides on them: arrays by their bytes, anything else by its repr.
        """
        if self.folder is None:
            return make()
        file = self.folder / f"{_sha256(about)}.npz"
        found = arrays_in(file)
        if found is not None:
            return found
        arrays = make()
        stage = file.with_suffix(".part")
        try:
            with stage.open("wb") as part:
                np.savez(part, **arrays)  # type: ignore[arg-type]
            os.replace(stage, file)
        except OSError as error:
            raise PsflutError(f"cannot write {file}: {error.strerror or error}; make room and go on") from error
        return arrays

    def measure(self, target: Target, shots: Sequence[Shot], size: int, imager: Imager) -> Measurement:
        """What `target` measures in shots."""
        seen = [part for shot in shots for part in (shot.image, shot.position, shot.name, shot.centre)]
        files = [file.read_bytes() for file in target.files]

        def make() -> Arrays:
            found = target.measure(shots, size, imager)
            rejected = np.array(found.rejected, dtype=str)
            hidden = np.empty((0, 0)) if found.hidden is None else found.hidden
            arrays = {"psf": found.psf, "std": found.std, "hidden": hidden}
            return {**arrays, "used": np.array(found.used), "rejected": rejected}

        kept = self.get([target, *files, size, imager, *seen], make)
        rejected = tuple(str(reason) for reason in kept["rejected"])
        hidden = kept["hidden"] if kept["hidden"].size else None
        return Measurement(kept["psf"], kept["std"], int(kept["used"]), rejected, hidden)


@contextmanager
def beside(table: Path) -> Iterator[Planes]:
    """Planes of the table that is to be written there, by this process alone.

    They are removed when the block ends well or is refused; they stay when it is interrupted, killed, or the system
    refuses to write, and the next build of that table goes on from them.

    Raises
    ------
    PsflutError
        If another process builds that table.
    """
    folder = table.with_name(f".{table.name}.planes")
    with claimed(folder):
        try:
            folder.mkdir(exist_ok=True)
            yield Planes(folder)
        except PsflutError as error:
            if not isinstance(error.__cause__, OSError):
                shutil.rmtree(folder, ignore_errors=True)
            raise
        except OSError as error:
            raise PsflutError(f"cannot write {table}: {error.strerror or error}; make room or go elsewhere") from error
        else:
            shutil.rmtree(folder, ignore_errors=True)
        finally:
            with suppress(OSError):
                folder.rmdir()  # where no plane was finished, nothing is left behind


def _sha256(about: Sequence[object]) -> str:
    digest = hashlib.sha256(_code())
    for part in about:
        if isinstance(part, np.ndarray):
            digest.update(f"{part.dtype}{part.shape}".encode() + np.ascontiguousarray(part).tobytes())
        else:
            digest.update(f"{part!r};".encode())
    return digest.hexdigest()


@cache
def _code() -> bytes:
    """Checksum of the code of psflut and calib, and of numpy's version."""
    digest = hashlib.sha256(np.__version__.encode())
    root = Path(__file__).parent.parent
    for file in sorted([*root.glob("psflut/**/*.py"), *root.glob("calib/**/*.py")]):
        digest.update(file.read_bytes())
    return digest.digest()
