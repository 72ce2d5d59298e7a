"""Images and sequences of them, line by line: files of any size, whose pixels are read when they are asked for.

A frame is an image file, a page of a TIFF, one of a video, or a plane of an array in a ``.npy`` or ``.zarr`` file. What
is mapped or chunked on disk (an uncompressed TIFF, .npy, .zarr) is never read whole; other files are.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
import zarr
from numpy.typing import NDArray

from psflut import videos
from psflut.errors import PsflutError
from psflut.images import Picture, decoded, page_shapes, read_raw
from psflut.photographs import SUFFIXES

ARRAYS = (".npy", ".zarr")


class Frames(Protocol):
    """Frames of one shape."""

    @property
    def names(self) -> tuple[str, ...]:
        """A name for every frame."""

    @property
    def shape(self) -> tuple[int, int]:
        """Of a frame, pixels."""

    def lines(self, frame: int, first: int, last: int) -> Picture:
        """Lines `first` to `last` (exclusive) of a frame, linear intensity."""


@dataclass(frozen=True, eq=False)
class Stack:
    """Frames in memory: (T, H, W) linear intensity."""

    images: NDArray[np.floating]

    @property
    def names(self) -> tuple[str, ...]:
        """Their numbers."""
        return tuple(map(str, range(len(self.images))))

    @property
    def shape(self) -> tuple[int, int]:
        """Of a frame, pixels."""
        return self.images.shape[1], self.images.shape[2]

    def lines(self, frame: int, first: int, last: int) -> Picture:
        """Lines of a frame."""
        return Picture(np.asarray(self.images[frame, first:last], dtype=np.float64))


class Page(NamedTuple):
    """A frame on disk: a file, and a page of it or a plane of its array; None where it holds one alone."""

    path: Path
    number: int | None


@dataclass(frozen=True, eq=False)
class Files:
    """Frames on disk, as `read_image` decodes them; the rate of a single video, frames a second.

    Whoever works on them must find them at the same paths.
    """

    names: tuple[str, ...]
    shape: tuple[int, int]
    pages: tuple[Page, ...]
    gamma: float = 1.0
    srgb: bool = False
    rate: float | None = None

    def lines(self, frame: int, first: int, last: int) -> Picture:
        """Lines of a frame."""
        page = self.pages[frame]
        return decoded(page.path, np.asarray(_opened(page)[first:last]), self.gamma, self.srgb)


def frames(paths: Sequence[str], gamma: float = 1.0, srgb: bool = False) -> Files:
    """The frames of images, stacks and folders (their pictures by name), in the order in which they are given.

    Raises
    ------
    PsflutError
        If a file is missing or no image, a folder holds none, or frames differ in shape.
    """
    _opened.cache_clear()  # a file may have changed
    named = [(name, file) for name in paths for file in _files(Path(name))]
    pages = [(name, page, shape) for name, file in named for page, shape in _pages(file)]
    shapes = {shape for *_, shape in pages}
    if len(shapes) != 1:
        first, other = sorted(shapes)[:2]
        raise PsflutError(
            f"frames must have one shape, got {first[0]} x {first[1]} and {other[0]} x {other[1]} pixels; map them "
            "one by one"
        )
    names = tuple(_name(name, page) for name, page, _ in pages)
    rate = videos.rate(named[0][1]) if len(named) == 1 and videos.is_video(named[0][1]) else None
    return Files(names, shapes.pop(), tuple(page for _, page, _ in pages), gamma, srgb, rate)


def _files(path: Path) -> list[Path]:
    if not path.is_dir() or path.suffix == ".zarr":
        return [path]
    files = sorted(file for file in path.iterdir() if file.suffix.lower() in SUFFIXES)
    if not files:
        raise PsflutError(f"{path} holds no pictures ({', '.join(SUFFIXES)}); name another folder")
    return files


def _pages(path: Path) -> list[tuple[Page, tuple[int, int]]]:
    if path.suffix in ARRAYS:
        array = _array(path)
        shape = array.shape[-2], array.shape[-1]
        numbers = [None] if array.ndim == 2 else range(array.shape[0])
        return [(Page(path, number), shape) for number in numbers]
    shapes = page_shapes(path)
    return [(Page(path, None if len(shapes) == 1 else k), shape) for k, shape in enumerate(shapes)]


def _name(given: str, page: Page) -> str:
    own = given if Path(given) == page.path else str(page.path)
    return own if page.number is None else f"{own}:{page.number}"


@lru_cache(maxsize=2)
def _opened(page: Page) -> Any:
    """What lines of a frame are cut from; the last two stay open."""
    if page.path.suffix not in ARRAYS:
        return read_raw(page.path, page.number)
    array = _array(page.path)
    return array if page.number is None else _Plane(array, page.number)


class _Plane(NamedTuple):
    array: Any
    number: int

    def __getitem__(self, lines: Any) -> Any:
        return self.array[self.number, lines]


def _array(path: Path) -> Any:
    """An array on disk of two dimensions, or three for a sequence."""
    try:
        if path.suffix == ".npy":
            array: Any = np.load(path, mmap_mode="r")
        else:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # zarr's note on numcodecs
                array = zarr.open_array(path, mode="r")
    except (OSError, ValueError, KeyError, TypeError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise PsflutError(f"cannot read {path} as an array ({reason}); write it again") from error
    if array.ndim not in (2, 3) or 0 in array.shape:
        raise PsflutError(f"{path} has the shape {array.shape}; give (y, x), or (time, y, x) for a sequence")
    return array
