"""A file is either whole or not there: write beside it, then rename."""

import os
import shutil
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from psflut.errors import PsflutError


def refuse_overwrite(path: Path, overwrite: bool) -> None:
    """Refuse early, before the work, what `staged` would refuse at its end."""
    if not path.parent.is_dir():
        raise PsflutError(f"{path.parent} is not a folder; make it before {path.name} is written there")
    if path.is_dir() and not (path / "zarr.json").is_file():
        raise PsflutError(f"{path} is a folder, which is never replaced; choose another name")
    if path.exists() and not overwrite:
        raise PsflutError(f"{path} exists; choose another name or pass --overwrite")


@contextmanager
def staged(path: Path, overwrite: bool = False) -> Iterator[Path]:
    """A temporary neighbour of `path` to write (file or folder), renamed to `path` when the block ends well.

    Raises
    ------
    PsflutError
        If the folder is missing, the file exists and may not be replaced, or the system refuses to write.
    """
    refuse_overwrite(path, overwrite)
    stage = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield stage
        if path.is_dir():
            _swap_folders(stage, path)
        else:
            os.replace(stage, path)
    except OSError as error:
        raise PsflutError(f"cannot write {path}: {error.strerror or error}") from error
    finally:
        _remove(stage)


def _swap_folders(stage: Path, path: Path) -> None:
    old = path.with_name(f".{path.name}.{os.getpid()}.old")
    os.replace(path, old)
    try:
        os.replace(stage, path)
    except OSError:
        os.replace(old, path)
        raise
    shutil.rmtree(old)


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def pack(folder: Path, archive: Path) -> None:
    """All files of `folder` in an uncompressed zip, sorted and undated: the same bytes every time."""
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_STORED) as target:
        for file in sorted(p for p in folder.rglob("*") if p.is_file()):
            entry = zipfile.ZipInfo(file.relative_to(folder).as_posix())
            entry.external_attr = 0o644 << 16
            target.writestr(entry, file.read_bytes())
