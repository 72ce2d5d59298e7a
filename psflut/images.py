"""Reading images as linear intensity, writing them as float32 TIFF."""

import json
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from psflut.errors import PsflutError
from psflut.files import staged

LUMINANCE = np.array([0.2125, 0.7154, 0.0721])
"""Weights of linear red, green and blue (ITU-R BT.709, as in scikit-image's rgb2gray)."""


DEFAULT_SIDE = 256
"""Side of the patch that is taken where none is named, pixels."""


@dataclass(frozen=True, eq=False)
class Picture:
    """An image in linear intensity, full scale 1.

    Parameters
    ----------
    image : (H, W) float64 array
    quantum : float
        Step between neighbouring levels near full scale, image units; 0 for float files.
    """

    image: NDArray[np.float64]
    quantum: float = 0.0


def read_image(path: Path, gamma: float = 1.0, srgb: bool = False) -> Picture:
    """Linear luminance of an image file.

    Integers are divided by their full scale, floats are taken as they are and never clipped; ``gamma`` undoes
    an encoding by ``value ** gamma``, ``srgb`` the sRGB curve; colour becomes luminance, alpha is dropped.

    Raises
    ------
    PsflutError
        If the file is missing, empty, truncated or no image; if it has more than one page, is not real and
        numeric, or holds values that are not finite.
    """
    raw = _read(path)
    _check(path, raw)
    quantum = 0.0
    values = raw.astype(np.float64)
    if np.issubdtype(raw.dtype, np.integer):
        full_scale = float(np.iinfo(raw.dtype).max)
        values, quantum = values / full_scale, 1.0 / full_scale
    values = linearise(values, gamma, srgb)
    if values.ndim == 3:
        values = values[..., :3] @ LUMINANCE if values.shape[-1] >= 3 else values[..., 0]
    return Picture(np.ascontiguousarray(values), quantum * gamma)


def linearise(values: NDArray[np.float64], gamma: float = 1.0, srgb: bool = False) -> NDArray[np.float64]:
    """Undo an encoding: ``value ** gamma``, or the sRGB curve (IEC 61966-2-1). Negative values keep their sign."""
    if not (np.isfinite(gamma) and gamma > 0):
        raise PsflutError(f"gamma must be positive, got {gamma}; 1 leaves the image as it is")
    if srgb:
        size = np.abs(values)
        curve = np.where(size <= 0.04045, size / 12.92, ((size + 0.055) / 1.055) ** 2.4)
        return np.asarray(np.sign(values) * curve)
    return values if gamma == 1.0 else np.asarray(np.sign(values) * np.abs(values) ** gamma)


def crop(shape: tuple[int, ...], patch: str | None) -> tuple[slice, slice]:
    """The window that ``"Y,X,SIZE"`` or ``"Y,X,HxW"`` names: top left corner and sides, in pixels.

    Without a patch it is the whole image, or on a side of more than 256 pixels its central 256.
    """
    if patch is None:
        starts = [max(n - DEFAULT_SIDE, 0) // 2 for n in shape]
        sides = [min(n, DEFAULT_SIDE) for n in shape]
    else:
        numbers = re.fullmatch(r"(\d+),(\d+),(\d+)(?:x(\d+))?", patch.replace(" ", ""))
        if numbers is None:
            raise PsflutError(f"a patch is Y,X,SIZE in pixels such as 64,0,128, got {patch!r}")
        starts = [int(numbers[1]), int(numbers[2])]
        sides = [int(numbers[3]), int(numbers[4] or numbers[3])]
    if any(a + n > total or n == 0 for a, n, total in zip(starts, sides, shape, strict=True)):
        raise PsflutError(f"the patch {patch} leaves the image of {shape[0]} x {shape[1]} pixels; move it inside")
    return slice(starts[0], starts[0] + sides[0]), slice(starts[1], starts[1] + sides[1])


def _read(path: Path) -> NDArray[Any]:
    import imageio.v3 as iio

    if not path.is_file():
        raise PsflutError(f"no image file at {path}; check the path")
    if path.stat().st_size == 0:
        raise PsflutError(f"{path} is empty; write or copy it again")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # Pillow only warns of truncated or oversized files
            return np.asarray(iio.imread(path))
    except Exception as error:  # the readers' exceptions share no base class
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise PsflutError(f"cannot read {path} as an image ({reason}); the file may be damaged") from error


def _check(path: Path, raw: NDArray[Any]) -> None:
    if not (np.issubdtype(raw.dtype, np.integer) or np.issubdtype(raw.dtype, np.floating)):
        raise PsflutError(f"{path} holds {raw.dtype} values; intensity must be integers or floats")
    if raw.ndim not in (2, 3) or (raw.ndim == 3 and raw.shape[-1] > 4) or raw.size == 0:
        raise PsflutError(f"{path} has the shape {raw.shape}; give one grey or colour picture a file")
    bad = int(np.sum(~np.isfinite(raw)))
    if bad:
        raise PsflutError(f"{path} holds {bad} values that are not finite; mask or replace them before reading")


def write_tiff(path: Path, image: NDArray[np.floating], about: Mapping[str, Any], overwrite: bool = False) -> None:
    """A float32 TIFF whose description is `about` as JSON; no date, so the same image gives the same bytes."""
    import tifffile

    with staged(path, overwrite) as stage:
        tifffile.imwrite(stage, image.astype(np.float32), description=json.dumps(about, sort_keys=True), metadata=None)
