"""Pages of TIFF files, counted before tifffile sees them: it follows a chain of pages that bites its tail for ever."""

import struct
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from psflut.errors import PsflutError

STARTS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
AXES = ("YX", "YXS", "SYX")

MOST_PAGES = 100_000
LARGEST = 2**28
"""Most values of a page that is read and not mapped."""


def is_tiff(path: Path) -> bool:
    """By its first bytes."""
    with path.open("rb") as file:
        return file.read(4) in STARTS


def page_shapes(path: Path) -> tuple[tuple[int, int], ...]:
    """Rows and columns of every page.

    Raises
    ------
    PsflutError
        Without the file's name, as all here: if there are no pages, too many, or the same ones again and again.
    """
    import tifffile

    check_chain(path)
    with tifffile.TiffFile(path) as file:
        shapes = tuple((page.imagelength, page.imagewidth) for page in (page.aspage() for page in file.pages))
    if not shapes:
        raise PsflutError("is a TIFF without a page; write or copy it again")
    return shapes


def read_page(path: Path, page: int | None, mapped: bool = False) -> NDArray[Any]:
    """The values of a page as they are stored, (H, W) or (H, W, S); without a number there must be a single one.

    With `mapped` those of an uncompressed page stay on disk until they are looked at.

    Raises
    ------
    PsflutError
        If there is no such page, it is no picture in grey levels or colours, or it claims more than it can hold.
    """
    import tifffile

    check_chain(path)
    with tifffile.TiffFile(path) as file:
        count = len(file.pages)
        if page is None and (len(file.series) != 1 or file.series[0].axes not in AXES):
            raise PsflutError(f"has {count} pages or more; give one grey or colour picture a file")
        if page is not None and not 0 <= page < count:
            raise PsflutError(f"has {count} pages, counted from 0, and no page {page}; name one that it has")
        chosen = file.pages[page or 0].aspage()
        if chosen.axes not in AXES:
            raise PsflutError(f"has a page with the axes {chosen.axes}; write it as one grey or colour picture")
        kind = chosen.photometric
        if kind not in (tifffile.PHOTOMETRIC.MINISBLACK, tifffile.PHOTOMETRIC.RGB):
            raise PsflutError(f"is a TIFF of kind {getattr(kind, 'name', kind)}; write it as grey levels or RGB")
        whole = chosen.compression != tifffile.COMPRESSION.NONE or chosen.nbytes <= path.stat().st_size
        mapped = mapped and chosen.is_memmappable
        if (chosen.size > LARGEST and not mapped) or not whole:
            sides = " x ".join(map(str, chosen.shape))
            raise PsflutError(f"claims a page of {sides} values, more than it holds or {LARGEST}; write it again")
        raw = chosen.asarray(out="memmap" if mapped else None)
        return np.moveaxis(raw, 0, -1) if chosen.axes == "SYX" else raw


def check_chain(path: Path) -> None:
    """Refuse a file whose pages do not end."""
    with path.open("rb") as file:
        start = file.read(4)
        order, big = "<" if start[:2] == b"II" else ">", start in STARTS[2:]
        number, count, entry = (f"{order}Q", f"{order}Q", 20) if big else (f"{order}I", f"{order}H", 12)
        file.seek(8 if big else 4)
        seen, at = set[int](), _next(file, number)
        while at:
            if at in seen or len(seen) >= MOST_PAGES:
                raise PsflutError("has pages without end, each naming the next; write it again")
            seen.add(at)
            file.seek(at)
            file.seek(entry * _next(file, count), 1)
            at = _next(file, number)


def _next(file: BinaryIO, kind: str) -> int:
    """The number at the file's place, or 0 beyond its end."""
    data = file.read(struct.calcsize(kind))
    return int(struct.unpack(kind, data)[0]) if len(data) == struct.calcsize(kind) else 0
