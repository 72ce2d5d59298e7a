"""Writing images: float32 TIFF with its description, and grey PNG."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from psflut.errors import PsflutError
from psflut.files import refuse_overwrite, staged


def check_tiff(path: Path, overwrite: bool) -> None:
    """Refuse, before the work, a path that `write_tiff` would refuse after it."""
    if path.suffix.lower() not in (".tif", ".tiff"):
        raise PsflutError(f"a capture is a TIFF, whose name ends in .tif or .tiff, got {str(path)!r}")
    refuse_overwrite(path, overwrite)


def write_tiff(path: Path, image: NDArray[np.floating], about: Mapping[str, Any], overwrite: bool = False) -> None:
    """A float32 TIFF whose description is `about` as JSON; no date, so the same image gives the same bytes."""
    import tifffile

    check_tiff(path, overwrite)
    with staged(path, overwrite) as stage:
        tifffile.imwrite(stage, image.astype(np.float32), description=json.dumps(about, sort_keys=True), metadata=None)


def write_png(path: Path, image: NDArray[np.floating], overwrite: bool = False) -> None:
    """An 8-bit grey PNG of values from 0 to 1."""
    import imageio.v3 as iio

    with staged(path, overwrite) as stage:
        iio.imwrite(stage, np.rint(255.0 * np.clip(image, 0.0, 1.0)).astype(np.uint8), extension=".png")
