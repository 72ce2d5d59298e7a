"""Video files, by PyAV (the extra ``video``), frame by frame.

Frames come as their codec leaves them. Compression takes away the faint detail that tells the blur and puts in some of
its own, of which no noise model knows: where there is a choice, give frames that were never compressed.
"""

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from psflut.errors import PsflutError

FORMATS = {".mp4": "mov", ".m4v": "mov", ".mov": "mov", ".mkv": "matroska", ".webm": "matroska", ".avi": "avi"}
"""By suffix. A file is not asked what it is, as playlists and other texts would name further files to open."""


def is_video(path: Path) -> bool:
    """Whether a file is a video, by its name."""
    return path.suffix.lower() in FORMATS


def shapes(path: Path) -> tuple[tuple[int, int], ...]:
    """Rows and columns of every frame."""
    with _opened(path) as container:
        stream = container.streams.video[0]
        count = stream.frames or sum(packet.size > 0 for packet in container.demux(stream))
        return ((int(stream.height), int(stream.width)),) * int(count)


def rate(path: Path) -> float | None:
    """Frames a second, where the file says so."""
    with _opened(path) as container:
        found = container.streams.video[0].average_rate
        return float(found) if found else None


def read(path: Path, number: int | None) -> NDArray[Any]:
    """A frame: grey levels, or red, green and blue; 8 bits, or 16 where the video has more."""
    if number is None and (count := len(shapes(path))) > 1:
        raise PsflutError(f"is a video of {count} frames; map it whole, or save the frame that is meant as PNG")
    return _reader(path, path.stat().st_mtime_ns).frame(number or 0)


class _Reader:
    """A video that is open: the next frame costs nothing but its decoding, an earlier one begins anew."""

    def __init__(self, path: Path) -> None:
        self.path, self.next, self.lock = path, 0, Lock()
        self.frames = self._decoded()

    def _decoded(self) -> Iterator[Any]:
        with _opened(self.path) as container:
            yield from container.decode(video=0)

    def frame(self, number: int) -> NDArray[Any]:
        """Its pixels; may be asked for by several threads."""
        with self.lock:
            if number < self.next:
                self.next, self.frames = 0, self._decoded()
            for found in self.frames:
                self.next += 1
                if self.next > number:
                    return _pixels(found)
        raise PsflutError(f"ends before frame {number}; copy it again")


@lru_cache(maxsize=1)
def _reader(path: Path, changed: int) -> _Reader:
    return _Reader(path)


def _pixels(frame: Any) -> NDArray[Any]:
    deep = max(component.bits for component in frame.format.components) > 8
    colours = len(frame.format.components) > 1
    return np.asarray(frame.to_ndarray(format=(("gray", "gray16le"), ("rgb24", "rgb48le"))[colours][deep]))


def _opened(path: Path) -> Any:
    try:
        import av
    except ImportError as error:
        raise PsflutError("is a video, which needs PyAV; install it with: pip install psflut[video]") from error
    container = av.open(str(path), format=FORMATS[path.suffix.lower()])
    if not container.streams.video:
        container.close()
        raise PsflutError("holds sound alone; give the file with the pictures")
    return container
