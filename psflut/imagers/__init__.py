"""What the detector does to the picture that falls on it, one imager a file."""

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from psflut.fourier import transfer


class Imager(ABC):
    """A linear, shift-invariant detector; its fields are its settings, its kernel is what it does."""

    @abstractmethod
    def kernel(self) -> NDArray[np.float64]:
        """(k, k) filter with k odd, symmetric about its centre."""

    @property
    def signed(self) -> bool:
        """Whether the output can be negative for a picture that is not."""
        return bool(self.kernel().min() < 0)

    def transfer(self, shape: tuple[int, int]) -> NDArray[np.float64]:
        """Real transfer function L on the grid of ``rfft2`` of an image of that shape."""
        return np.asarray(transfer(self.kernel(), shape).real)

    def response(self, picture: NDArray[np.floating]) -> NDArray[np.floating]:
        """The filtered picture, same shape; beyond its border the picture is mirrored (symmetric)."""
        return np.asarray(ndimage.convolve(picture, self.kernel(), mode="reflect"))
