"""Square patches that overlap, side by side over an image: where they lie, and how they are cut without a copy."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from psflut.errors import PsflutError


@dataclass(frozen=True)
class Tiles:
    """Patches of `size` x `size` pixels, every `stride` pixels from the upper left corner, as far as whole ones fit.

    Parameters
    ----------
    shape : (H, W)
        Of the image.
    size, stride : int
        Pixels.

    Raises
    ------
    PsflutError
        If the stride is not positive, or the image smaller than a patch.
    """

    shape: tuple[int, int]
    size: int = 64
    stride: int = 32

    def __post_init__(self) -> None:
        if self.stride < 1 or self.size < 1:
            raise PsflutError(
                f"patches need a size and a stride of at least 1 pixel, got {self.size} and {self.stride}"
            )
        if min(self.shape) < self.size:
            raise PsflutError(
                f"an image of {self.shape[0]} x {self.shape[1]} pixels is smaller than a patch of {self.size}; give a "
                "larger image or a smaller --size"
            )

    @property
    def grid(self) -> tuple[int, int]:
        """Rows and columns of patches."""
        rows, columns = ((side - self.size) // self.stride + 1 for side in self.shape)
        return rows, columns

    @property
    def centres(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pixel coordinates (rows,), (columns,) of the patches' centres; 0 is the centre of the first pixel."""
        first = 0.5 * (self.size - 1)
        rows, columns = (first + self.stride * np.arange(count, dtype=np.float64) for count in self.grid)
        return rows, columns

    def lines(self, first: int, last: int) -> tuple[int, int]:
        """First pixel row, and the one after the last, that rows `first` to `last` (exclusive) of patches need."""
        return first * self.stride, (last - 1) * self.stride + self.size

    def cut(self, pixels: NDArray[np.floating]) -> NDArray[np.floating]:
        """Views (rows, columns, size, size) of the patches in an image, or in lines of it."""
        views = np.lib.stride_tricks.sliding_window_view(pixels, (self.size, self.size))
        return views[:: self.stride, :: self.stride]
