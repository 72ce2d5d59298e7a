"""RAW files of cameras, by rawpy (the extra ``raw``)."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from psflut.errors import PsflutError

SUFFIXES = (".arw", ".cr2", ".cr3", ".dng", ".nef", ".orf", ".raf", ".rw2")


def is_raw(path: Path) -> bool:
    """Whether a file is a RAW file, by its name: most are TIFF files too, whose first page is a thumbnail."""
    return path.suffix.lower() in SUFFIXES


def shape(path: Path) -> tuple[int, int]:
    """Rows and columns, from the headers."""
    with _rawpy().imread(str(path)) as raw:
        return raw.sizes.height, raw.sizes.width


def read(path: Path) -> NDArray[Any]:
    """Linear red, green and blue of 16 bits on the sensor's own pixels: no colour matrix, no brightening."""
    rawpy = _rawpy()
    settings = {
        "gamma": (1, 1),
        "output_bps": 16,
        "no_auto_bright": True,
        "output_color": rawpy.ColorSpace.raw,
        "user_wb": [1, 1, 1, 1],
        "user_flip": 0,
    }
    with rawpy.imread(str(path)) as raw:
        return np.asarray(raw.postprocess(**settings))


def _rawpy() -> Any:
    try:
        import rawpy
    except ImportError as error:
        raise PsflutError("is a RAW file, which needs rawpy; install it with: pip install psflut[raw]") from error
    return rawpy
