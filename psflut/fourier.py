"""From a centred kernel to its transfer function."""

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from psflut.errors import PsflutError


def transfer(kernel: NDArray[np.floating], shape: tuple[int, int]) -> NDArray[np.complexfloating]:
    """Transfer function (..., H, W // 2 + 1) on the grid of ``rfft2`` of an image (H, W).

    Parameters
    ----------
    kernel : (..., K, K) array
        Centred on K // 2, K odd and at most the shorter side.
    shape : (H, W)
        Of the image, in pixels.

    Raises
    ------
    PsflutError
        If the kernel is larger than the image.
    """
    size = kernel.shape[-1]
    if size > min(shape):
        raise PsflutError(
            f"an image of {shape[0]} x {shape[1]} pixels is smaller than its filter of {size}; enlarge it"
        )
    padded = np.zeros((*kernel.shape[:-2], *shape), kernel.dtype)
    padded[..., :size, :size] = kernel
    return np.asarray(fft.rfft2(np.roll(padded, (-(size // 2), -(size // 2)), axis=(-2, -1))))
