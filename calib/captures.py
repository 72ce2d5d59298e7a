"""Frames of real captures as linear intensity: read when asked for, one position at a time."""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.manifest import Manifest
from calib.manifest_row import Row
from calib.targets import Shot
from psflut.errors import PsflutError
from psflut.images import Picture, linearise, page_shapes, read_image

Floats = NDArray[np.float64]

SIXTEEN = 65535
"""Full scale of 16 bits."""

PILE = 4
"""Pixels at a level from which on it may be a ceiling."""


def read_dark(dark: str | Path, gamma: float = 1.0, srgb: bool = False) -> float | Floats:
    """The dark level, image units: a number, or the mean of all pages of an image taken without light."""
    try:
        level = float(str(dark))
    except ValueError:
        pages = range(len(page_shapes(Path(dark))))
        return np.asarray(np.mean([read_image(Path(dark), gamma, srgb, page).image for page in pages], axis=0))
    if not math.isfinite(level):
        raise PsflutError(f"a dark level must be finite, got {dark}; image units run from 0 to 1")
    return level


def shots(
    manifest: Manifest, position: float, gamma: float = 1.0, srgb: bool = False, dark: float | Floats = 0.0
) -> list[Shot]:
    """The frames at one position, read now.

    Parameters
    ----------
    position : float
        One of `Manifest.positions`, metres.
    gamma, srgb : float, bool
        The encoding that is undone (`psflut.images.linearise`).
    dark : float or (H, W) array
        Dark level that is subtracted after that, image units (`read_dark`).

    Returns
    -------
    list of Shot
        One a row; those of one frame share its image, which is read once. Linear intensity; where an integer file is
        at its full scale, or at that of fewer bits (`_ceiling`), NaN.

    Raises
    ------
    PsflutError
        If a frame cannot be read, does not fit the dark frame, or is not above it anywhere.
    """
    rows = [row for row in manifest.rows if row.position == position]
    images = {row.frame: _image(manifest, row, gamma, srgb, dark) for row in {row.frame: row for row in rows}.values()}
    return [Shot(images[row.frame], position, row.name, row.centre) for row in rows]


def _image(manifest: Manifest, row: Row, gamma: float, srgb: bool, dark: float | Floats) -> Floats:
    if np.ndim(dark) and np.shape(dark) != manifest.shape:
        raise PsflutError(
            f"the dark frame has {' x '.join(map(str, np.shape(dark)))} pixels, the frames of {manifest.path} have "
            f"{' x '.join(map(str, manifest.shape))}; take it with their settings"
        )
    picture = read_image(row.file, gamma, srgb, row.page)
    image = picture.image - dark
    if not image.max() > 0:
        raise PsflutError(f"{row.name} is nowhere above the dark level; give that in image units, full scale is 1")
    if picture.saturated is not None:
        image[picture.saturated | (picture.image >= _ceiling(picture, gamma, srgb))] = np.nan
    return image


def _ceiling(picture: Picture, gamma: float, srgb: bool) -> float:
    """The full scale of 9 to 15 bits in a grey 16-bit file, low or shifted up, where pixels pile up at it; or infinity.

    Such files hide saturation: their brightest level, 4095 or 65520 of 12 bits, is no full scale of the file. It is
    taken for a ceiling if it is exactly such a level, which chance hits once in 5,000, and `PILE` pixels share it.
    """
    levels = np.array([(2**bits - 1) << shift for bits in range(9, 16) for shift in (0, 16 - bits)])
    scales = linearise(levels / SIXTEEN, gamma, srgb)
    brightest = picture.image.max()
    piled = np.count_nonzero(picture.image == brightest) >= PILE
    fits = 0 < picture.quantum < 4.0 * gamma / SIXTEEN and np.isclose(scales, brightest, rtol=1e-9, atol=0).any()
    return float(brightest) if piled and fits else np.inf
