"""A file is either whole or not there: write beside it, then rename. One process at a time writes it.

What is being written lies in a hidden folder beside its place, which nobody else may use: of two processes that write
the same file one does, the other is told. A killed one leaves that folder, and the next that writes there clears it.
"""

import ctypes
import os
import shutil
import zipfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from psflut.errors import PsflutError

try:
    import fcntl
except ImportError:  # Windows: renaming is still whole, but nobody keeps two writers apart
    fcntl = None  # type: ignore[assignment]

HERE, SWAP = -100, 2
"""Of Linux' renameat2: paths are as they are given (AT_FDCWD), and exchanged (RENAME_EXCHANGE)."""


def refuse_overwrite(path: Path, overwrite: bool) -> None:
    """Refuse early, before the work, what `staged` would refuse at its end."""
    try:
        if not path.parent.is_dir():
            raise PsflutError(f"{path.parent} is not a folder; make it before {path.name} is written there")
        if not os.access(path.parent, os.W_OK):
            raise PsflutError(f"{path.parent} cannot be written; choose another folder for {path.name}")
        if path.is_dir() and not (path / "zarr.json").is_file():
            raise PsflutError(f"{path} is a folder, which is never replaced; choose another name")
        if path.exists() and not overwrite:
            raise PsflutError(f"{path} exists; choose another name or pass --overwrite")
    except OSError as error:  # a name that is too long, say
        raise PsflutError(f"cannot write {path}: {error.strerror or error}; choose another name") from error


def refuse_inputs(path: Path, inputs: Iterable[Path]) -> None:
    """Refuse to write over what is read: not even --overwrite means that."""
    if any(path.exists() and each.exists() and path.samefile(each) for each in inputs):
        raise PsflutError(f"{path} is read, so it cannot be the output too; choose another name")


@contextmanager
def staged(path: Path, overwrite: bool = False) -> Iterator[Path]:
    """A temporary neighbour of `path` to write (file or folder), renamed to `path` when the block ends well.

    Raises
    ------
    PsflutError
        If the folder is missing, the file exists and may not be replaced, another process is writing it, or the
        system refuses to write.
    """
    refuse_overwrite(path, overwrite)
    try:
        with claimed(path.with_name(f".{path.name}.part")) as folder:
            try:
                shutil.rmtree(folder, ignore_errors=True)  # of a process that was killed
                folder.mkdir()
                stage = folder / path.name
                yield stage
                refuse_overwrite(path, overwrite)
                _put(stage, path)
            finally:
                shutil.rmtree(folder, ignore_errors=True)
    except OSError as error:
        raise PsflutError(f"cannot write {path}: {error.strerror or error}; make room or go elsewhere") from error


@contextmanager
def claimed(folder: Path) -> Iterator[Path]:
    """Keep every other process from `folder`, ``.NAME.something``, until the block ends; one that dies gives it free.

    Raises
    ------
    PsflutError
        If another process has it, or the system refuses to write.
    """
    lock = folder.with_name(f"{folder.name}.lock")
    path = lock.with_name(folder.name.removeprefix(".").rpartition(".")[0])
    try:
        handle = _lock(lock)
    except BlockingIOError as error:
        raise PsflutError(f"another process is writing {path}; wait until it is done") from error
    except OSError as error:
        raise PsflutError(f"cannot write {path}: {error.strerror or error}; make room or go elsewhere") from error
    try:
        yield folder
    finally:
        lock.unlink(missing_ok=True)
        os.close(handle)


def _lock(lock: Path) -> int:
    """An open file that no other process has locked; it is gone with its process."""
    while True:
        handle = os.open(lock, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            if fcntl is not None:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.fstat(handle).st_ino == lock.stat().st_ino:
                return handle
        except FileNotFoundError:
            pass  # its last owner has removed it in between: take a new one
        except OSError:
            os.close(handle)
            raise
        os.close(handle)


def _put(stage: Path, path: Path) -> None:
    """Give a finished stage its name. A folder takes the place of another in one step where the system can do that."""
    if not path.is_dir():
        if stage.is_file():
            with stage.open("rb") as file:
                os.fsync(file.fileno())  # a power cut must not leave the name without the bytes
        os.replace(stage, path)
    elif not _swapped(stage, path):
        old = stage.with_name("old")
        os.replace(path, old)
        try:
            os.replace(stage, path)
        except OSError:
            os.replace(old, path)
            raise


def _swapped(one: Path, other: Path) -> bool:
    try:
        rename = ctypes.CDLL(None, use_errno=True).renameat2
    except (AttributeError, OSError, TypeError):  # not Linux
        return False
    return bool(rename(HERE, os.fsencode(one), HERE, os.fsencode(other), SWAP) == 0)


def arrays_in(file: Path) -> dict[str, Any] | None:
    """The arrays of an .npz file, none of which is run; None where it is missing or damaged, as its checksums tell."""
    import numpy as np

    try:
        with file.open("rb") as data, np.load(data, allow_pickle=False) as found:
            return dict(found)
    except (OSError, ValueError, KeyError, EOFError, RuntimeError, zipfile.BadZipFile):
        return None


def pack(folder: Path, archive: Path) -> None:
    """All files of `folder` in an uncompressed zip, sorted and undated: the same bytes every time."""
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_STORED) as target:
        for file in sorted(p for p in folder.rglob("*") if p.is_file()):
            entry = zipfile.ZipInfo(file.relative_to(folder).as_posix())
            entry.external_attr = 0o644 << 16
            target.writestr(entry, file.read_bytes())
