"""Models of the point spread function, one a file."""

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from psflut.optics import Camera


class PSFModel(ABC):
    """A model of the PSF; its fields are its settings."""

    @abstractmethod
    def __call__(self, camera: Camera, distance: float, size: int) -> NDArray[np.float64]:
        """The PSF of an object at `distance` (metres), integrated over square pixels.

        Returns
        -------
        (size, size) array, indexed [y, x] with y down and x to the right, non-negative, sum 1, centred on
        pixel size // 2 (size is odd).
        """
