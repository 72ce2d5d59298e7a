"""What a table lies in, a folder or a zip, looked over before anything in it is opened: names, kinds and sizes.

Files that were made to harm are refused here: links and names that lead out of the table, pipes that never end,
archives that unpack to more than they hold.
"""

import os
import re
import stat
import zipfile
from collections.abc import Iterator
from pathlib import Path

from psflut.errors import PsflutError

LARGEST = 2**28
"""Most values of an array that is read or written: a gigabyte in single precision."""

MOST_BYTES = 8 * LARGEST
"""Of all files of a table together."""

NAME = re.compile(r"[\w-][\w.-]*(/[\w-][\w.-]*)*/?", re.ASCII)
"""Of what Zarr keeps in a group: no drive, no root, nothing that climbs."""


def look_over(path: Path) -> None:
    """Refuse a path that cannot hold a table.

    Raises
    ------
    PsflutError
        If it is neither a folder nor a file; if it holds links, devices or pipes, or more than `MOST_BYTES`; if an
        archive has names that lead out of it, one of them twice, or entries that are compressed or encrypted.
    """
    if path.is_dir():
        size = sum(_sizes(path, path))
    elif path.is_file():
        size = _archive_size(path)
    else:
        raise PsflutError(f"{path} is neither a folder nor a file; give the path of a table")
    if size > MOST_BYTES:
        raise PsflutError(f"{path} holds {size} bytes, a table at most {MOST_BYTES}; build it again with fewer planes")


def _sizes(folder: Path, table: Path) -> Iterator[int]:
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_symlink():
                raise PsflutError(f"{table} holds the link {entry.name}; put the file itself there")
            if entry.is_dir():
                yield from _sizes(Path(entry.path), table)
            elif entry.is_file():
                yield entry.stat().st_size
            else:
                raise PsflutError(f"{table} holds {entry.name}, which is no file; build the table again")


def _archive_size(path: Path) -> int:
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
    except (OSError, ValueError, NotImplementedError, zipfile.BadZipFile) as error:
        raise PsflutError(f"{path} is not a readable table ({error}); build it again") from error
    names = {entry.filename for entry in entries}
    if len(names) < len(entries):
        raise PsflutError(f"{path} holds a name twice; pack the table again")
    for entry in entries:
        if not NAME.fullmatch(entry.filename) or stat.S_ISLNK(entry.external_attr >> 16):
            raise PsflutError(f"{path} holds {entry.filename!r}, which leads out of a table; build it again")
        if entry.compress_type != zipfile.ZIP_STORED or entry.flag_bits & 1:
            raise PsflutError(f"{path} is a compressed or encrypted archive; pack the table without (ZIP_STORED)")
    return sum(entry.file_size for entry in entries)
