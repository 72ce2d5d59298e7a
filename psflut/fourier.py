"""Transfer functions on the half plane of frequencies of ``rfft2``: of a centred kernel, of a shift."""

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


def padded_shape(shape: tuple[int, ...], margin: int) -> tuple[int, int]:
    """Grid for an image of that shape and `margin` or more pixels on each side, quick to transform."""
    down, across = (fft.next_fast_len(n + 2 * margin, real=True) for n in shape)
    return down, across


def continued(image: NDArray[np.floating], shape: tuple[int, int]) -> NDArray[np.floating]:
    """The image at the origin of a periodic grid, mirrored beyond both ends, each fading into the other."""
    for axis, total in enumerate(shape):
        side = image.shape[axis]
        gap = total - side
        fade = 0.5 - 0.5 * np.cos(np.pi * (np.arange(gap) + 0.5) / max(gap, 1)).astype(image.dtype)
        inside = np.arange(side)
        after = np.take(image, np.pad(inside, (0, gap), mode="symmetric")[side:], axis)
        before = np.take(image, np.pad(inside, (gap, 0), mode="symmetric")[:gap], axis)
        bridge = after + (before - after) * (fade[:, None] if axis == 0 else fade)
        image = np.concatenate([image, bridge], axis)
    return image


def autocorrelation(taper: NDArray[np.floating], grid: tuple[int, int]) -> NDArray[np.floating]:
    """Of a taper on a periodic grid that holds it, 1 at lag zero."""
    lags = fft.irfft2(np.abs(fft.rfft2(taper, s=grid)) ** 2, s=grid)
    return np.asarray(lags / lags[0, 0])


def frequency(grid: tuple[int, int]) -> NDArray[np.float64]:
    """(H, W // 2 + 1) distance of each frequency from zero, cycles a pixel."""
    return np.asarray(np.hypot(fft.fftfreq(grid[0])[:, None], fft.rfftfreq(grid[1])))


def direction(grid: tuple[int, int]) -> NDArray[np.float64]:
    """(H, W // 2 + 1) direction of each frequency from zero, radians from x (across) towards y (down)."""
    return np.asarray(np.arctan2(fft.fftfreq(grid[0])[:, None], fft.rfftfreq(grid[1])))


def slopes(grid: tuple[int, int]) -> NDArray[np.complexfloating]:
    """(2, H, W // 2 + 1) derivatives of a shifted image by its shift, down and across, at each frequency."""
    height, width = grid
    down = np.broadcast_to(fft.fftfreq(height)[:, None], (height, width // 2 + 1))
    across = np.broadcast_to(fft.rfftfreq(width), (height, width // 2 + 1))
    return np.asarray(-2j * np.pi * np.stack([down, across]))


def phase(grid: tuple[int, int], shift: tuple[float, float]) -> NDArray[np.complexfloating]:
    """What moves an image by a shift (pixels)."""
    return np.asarray(np.exp(np.tensordot(shift, slopes(grid), 1)))


def once(grid: tuple[int, int]) -> NDArray[np.float64]:
    """Weights of the half plane's columns that count every frequency of a real image once."""
    weight = np.ones(grid[1] // 2 + 1)
    weight[0] = 0.5
    weight[-1] = 0.5 if grid[1] % 2 == 0 else 1.0
    return weight
