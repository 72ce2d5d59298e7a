"""Reading images as linear intensity."""

import logging
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from psflut import rawfiles, tiffs, videos
from psflut.errors import PsflutError

LUMINANCE = np.array([0.2125, 0.7154, 0.0721])
"""Weights of linear red, green and blue (ITU-R BT.709, as in scikit-image's rgb2gray)."""

SRGB_SLOPE = 2.4 / 1.055
"""Slope of the sRGB curve at full scale."""

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
    saturated : (H, W) bool array or None
        Where any channel of an integer file is at its full scale; None for float files.
    """

    image: NDArray[np.float64]
    quantum: float = 0.0
    saturated: NDArray[np.bool_] | None = None


def read_image(path: Path, gamma: float = 1.0, srgb: bool = False, page: int | None = None) -> Picture:
    """Linear luminance of an image file.

    Integers are divided by their full scale, floats are taken as they are and never clipped; ``gamma`` undoes
    an encoding by ``value ** gamma``, ``srgb`` the sRGB curve; colour becomes luminance, alpha is dropped.
    Decoded are TIFF by tifffile, RAW by rawpy (the extra ``raw``), video by PyAV (the extra ``video``) and whatever
    Pillow knows.

    Parameters
    ----------
    page : int or None
        Of a TIFF, or frame of a video, from 0. Without it the file must hold a single picture.

    Raises
    ------
    PsflutError
        If the file is missing, empty, truncated or no image; if it lacks the page, or has several and none is
        named; if it is not real and numeric, or holds values that are not finite.
    """
    return decoded(path, _read(path, page), gamma, srgb)


def read_raw(path: Path, page: int | None = None) -> NDArray[Any]:
    """What an image file holds, for `decoded`, lines of it if need be; an uncompressed TIFF is not read but mapped."""
    return _read(path, page, mapped=True)


def decoded(path: Path, raw: NDArray[Any], gamma: float = 1.0, srgb: bool = False) -> Picture:
    """The picture that raw values make, those of `read_raw` or some lines of them; see `read_image`."""
    _check(path, raw)
    if raw.ndim == 3:
        raw = raw[..., :3] if raw.shape[-1] >= 3 else raw[..., 0]
    quantum, saturated = 0.0, None
    values = raw.astype(np.float64)
    if np.issubdtype(raw.dtype, np.integer):
        full_scale = float(np.iinfo(raw.dtype).max)
        values, quantum = values / full_scale, 1.0 / full_scale
        saturated = np.asarray(np.atleast_3d(values >= 1.0).any(axis=-1))
    values = linearise(values, gamma, srgb)
    if values.ndim == 3:
        values = values @ LUMINANCE
    return Picture(np.ascontiguousarray(values), quantum * (SRGB_SLOPE if srgb else gamma), saturated)


def page_shapes(path: Path) -> tuple[tuple[int, int], ...]:
    """Rows and columns of every page of an image file, or frame of a video, from its headers.

    Raises
    ------
    PsflutError
        If the file is missing, empty or no image.
    """
    with _one_sentence(path):
        if _is_tiff(path):
            return tiffs.page_shapes(path)
        if rawfiles.is_raw(path):
            return (rawfiles.shape(path),)
        if videos.is_video(path):
            return videos.shapes(path)
        from PIL import Image

        with Image.open(path) as picture:
            return ((picture.height, picture.width),)


def linearise(values: NDArray[np.float64], gamma: float = 1.0, srgb: bool = False) -> NDArray[np.float64]:
    """Undo an encoding: ``value ** gamma``, or the sRGB curve (IEC 61966-2-1). Negative values keep their sign."""
    if not (np.isfinite(gamma) and gamma > 0):
        raise PsflutError(f"gamma must be positive, got {gamma}; 1 leaves the image as it is")
    if srgb and gamma != 1.0:
        raise PsflutError(f"an image has one encoding, got both sRGB and gamma {gamma}; give one of them")
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
    if min(sides) == 0:
        raise PsflutError(f"the patch {patch} is empty; give it a side of some pixels")
    if any(a + n > total for a, n, total in zip(starts, sides, shape, strict=True)):
        raise PsflutError(
            f"the patch {patch} leaves the image of {shape[0]} x {shape[1]} pixels; move it inside or make it smaller"
        )
    return slice(starts[0], starts[0] + sides[0]), slice(starts[1], starts[1] + sides[1])


def _read(path: Path, page: int | None, mapped: bool = False) -> NDArray[Any]:
    with _one_sentence(path):
        if _is_tiff(path):
            return tiffs.read_page(path, page, mapped)
        if videos.is_video(path):
            return videos.read(path, page)
        if page:
            raise PsflutError(f"has one page, page 0, there is no page {page}; only a TIFF may have more")
        return rawfiles.read(path) if rawfiles.is_raw(path) else _read_picture(path.read_bytes())


@contextmanager
def _one_sentence(path: Path) -> Iterator[None]:
    """Whatever goes wrong with an image file, as one sentence that names it."""
    if path.is_dir():
        raise PsflutError(f"{path} is a folder; name an image in it")
    if not path.is_file():
        raise PsflutError(f"no image file at {path}; check the path")
    if path.stat().st_size == 0:
        raise PsflutError(f"{path} is empty; write or copy it again")
    logging.getLogger("tifffile").addHandler(logging.NullHandler())  # its complaints come as our one sentence
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # Pillow only warns of some damage
            warnings.filterwarnings("ignore", message="Image size")  # large is not damaged
            yield
    except PsflutError as error:
        raise PsflutError(f"{path} {error}") from error
    except Exception as error:  # the readers' exceptions share no base class
        reason = (str(error).splitlines() or [type(error).__name__])[0].strip()
        raise PsflutError(f"cannot read {path} as an image ({reason}); write it again as PNG or TIFF") from error


def _is_tiff(path: Path) -> bool:
    return tiffs.is_tiff(path) and not rawfiles.is_raw(path)


def _read_picture(data: bytes) -> NDArray[Any]:
    import imageio.v3 as iio

    try:
        opened = iio.imopen(data, "r", plugin="pillow")
    except OSError as error:  # whose words are about plugins
        raise PsflutError("is no picture, or only the beginning of one; write it again as PNG or TIFF") from error
    with opened as file:
        mode = file.metadata(index=0).get("mode", "")
        raw = np.asarray(file.read())
    if mode in ("CMYK", "YCbCr", "LAB", "HSV"):
        raise PsflutError(f"holds {mode} colours; write it as grey levels or RGB")
    return raw[0] if raw.ndim == 4 and len(raw) == 1 else raw


def _check(path: Path, raw: NDArray[Any]) -> None:
    if not (np.issubdtype(raw.dtype, np.integer) or np.issubdtype(raw.dtype, np.floating)):
        raise PsflutError(f"{path} holds {raw.dtype} values; write it with integers or floats, as intensity is")
    if raw.ndim not in (2, 3) or (raw.ndim == 3 and raw.shape[-1] > 4) or raw.size == 0:
        raise PsflutError(f"{path} has the shape {raw.shape}; give one grey or colour picture a file")
    bad = int(np.sum(~np.isfinite(raw)))
    if bad:
        raise PsflutError(f"{path} has pixels that are not finite ({bad} of them); mask or replace them")
