"""Photographs to compare with: those that ship with scikit-image, or a folder of one's own."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from psflut.errors import PsflutError
from psflut.images import read_image

Floats = NDArray[np.floating]

SHIPPED = (
    "astronaut", "brick", "camera", "chelsea", "coffee", "coins", "grass",
    "gravel", "hubble_deep_field", "moon", "retina", "rocket", "stereo_motorcycle",
)  # fmt: skip
"""Of scikit-image, in its own package; the texture prior was learnt from others."""

SUFFIXES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp")


def shipped(name: str) -> Floats:
    """A photograph of scikit-image in grey, full scale 1, shrunk two-fold so that its own blur is small."""
    from skimage import color, data, transform

    picture = getattr(data, name)()
    picture = (picture[0] if isinstance(picture, tuple) else picture) / 255.0
    grey = color.rgb2gray(picture) if picture.ndim == 3 else picture
    height, width = (n - n % 2 for n in grey.shape)
    return np.asarray(transform.downscale_local_mean(grey[:height, :width], (2, 2)))


def choose(images: str | None, size: int, gamma: float = 1.0, srgb: bool = False) -> list[tuple[str, Floats]]:
    """The photographs that `images` names, as (name, linear intensity).

    Parameters
    ----------
    images : str or None
        A folder, whose pictures are taken as they are; or names of `SHIPPED` with commas between; None takes those
        of them that are large enough.
    size : int
        Side of the patches that they are for, pixels.

    Raises
    ------
    PsflutError
        If there is no such folder or name, or no picture in it.
    """
    if images is None:
        every = [(name, shipped(name)) for name in SHIPPED]
        found = [(name, picture) for name, picture in every if min(picture.shape) >= size]
        if not found:
            raise PsflutError(f"no photograph that ships has {size} pixels a side; give larger ones with --images")
        return found
    folder, names = Path(images), [name.strip() for name in images.split(",")]
    if folder.is_dir():
        files = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
        if not files:
            raise PsflutError(f"{folder} holds no pictures ({', '.join(SUFFIXES)}); name another folder")
        return [(path.name, read_image(path, gamma, srgb).image) for path in files]
    if not set(names) <= set(SHIPPED):
        raise PsflutError(f"--images is a folder of pictures or names of {', '.join(SHIPPED)}; got {images!r}")
    return [(name, shipped(name)) for name in names]
