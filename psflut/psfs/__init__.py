"""Models of the point spread function, one a file."""

from abc import ABC, abstractmethod
from typing import final

import numpy as np
from numpy.typing import NDArray

from psflut.errors import PsflutError
from psflut.optics import Camera, blur_radius


class PSFModel(ABC):
    """A model of the PSF; its fields are its settings."""

    @final
    def __call__(self, camera: Camera, distance: float, size: int) -> NDArray[np.float64]:
        """The PSF of an object at `distance` (metres), integrated over square pixels.

        Returns
        -------
        (size, size) array, indexed [y, x] with y down and x to the right, non-negative, sum 1, centred on
        pixel size // 2.

        Raises
        ------
        PsflutError
            For an even size, a distance of zero, or a window too small for the blur.
        """
        if size < 1 or size % 2 == 0:
            raise PsflutError(f"the size of a PSF must be odd, so that it has a middle pixel, got {size}")
        if not abs(distance) > 0:
            raise PsflutError(f"an object needs a distance from the lens, got {distance} m")
        return self.plane(camera, distance, size)

    @abstractmethod
    def plane(self, camera: Camera, distance: float, size: int) -> NDArray[np.float64]:
        """What `__call__` returns, for arguments that are checked."""


def disc_radius(camera: Camera, distance: float, size: int) -> float:
    """Radius in pixels of the geometric blur disc, refused where `size` pixels do not hold it."""
    radius = abs(float(blur_radius(camera, distance))) / camera.pixel_pitch
    if not 2.0 * radius <= size:
        raise PsflutError(
            f"the blur disc at {distance} m must fit in {size} pixels, got {2.0 * radius:.1f} across; "
            "take a larger size or a distance nearer the focus"
        )
    return radius
