"""A blur and its adjoint for Richardson-Lucy: sum by sum where a PSF has few pixels, else by Fourier transforms.

The scene reaches half a PSF beyond the image on every side. Arithmetic is that of the PSF's type.
"""

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray
from scipy import fft, signal

from psflut.fourier import continued, padded_shape, transfer

Reals = NDArray[np.floating]

FEW = 180
"""Pixels of a PSF that are not zero up to which sums are quicker: 149 took 0.6 of the transforms' time, 289 1.5 times
it (256 x 256 pixels)."""


class Blur(ABC):
    """h * f of a scene, where there is an image (H, W), and its adjoint."""

    @abstractmethod
    def laid(self, image: Reals) -> Reals:
        """A scene that is this image, and goes on beyond it."""

    @abstractmethod
    def cut(self, scene: Reals) -> Reals:
        """The part (H, W) of a scene that lies in the image."""

    @abstractmethod
    def seen(self, scene: Reals) -> Reals:
        """h * f (H, W), which may be overwritten, as the next one's may overwrite it."""

    @abstractmethod
    def pulled(self, ratio: Reals) -> Reals:
        """corr(h, ratio) >= 0 over the scene, which may be overwritten; a ratio (H, W) is nothing beyond its border."""


def blur(psf: Reals, shape: tuple[int, int]) -> Blur:
    """The quicker of the two for a PSF (K, K), K odd, and images of that shape."""
    return Sums(psf, shape) if np.count_nonzero(psf) <= FEW else Transforms(psf, shape)


class Transforms(Blur):
    """By transforms of a periodic grid, the image at its origin."""

    def __init__(self, psf: Reals, shape: tuple[int, int]) -> None:
        self.shape, self.grid = shape, padded_shape(shape, len(psf) // 2)
        self.forward = transfer(psf, self.grid)
        self.backward = np.conj(self.forward)

    def laid(self, image: Reals) -> Reals:
        """See `Blur`."""
        return continued(image, self.grid)

    def cut(self, scene: Reals) -> Reals:
        """See `Blur`."""
        return scene[: self.shape[0], : self.shape[1]]

    def seen(self, scene: Reals) -> Reals:
        """See `Blur`."""
        return self.cut(self._filtered(scene, self.forward))

    def pulled(self, ratio: Reals) -> Reals:
        """See `Blur`."""
        pulled = self._filtered(ratio, self.backward)
        return np.asarray(np.maximum(pulled, 0, out=pulled))  # less what rounding leaves below zero

    def _filtered(self, image: Reals, otf: NDArray[np.complexfloating]) -> Reals:
        spectrum = fft.rfft2(image, self.grid)
        spectrum *= otf  # a new array would cost half a transform
        return np.asarray(fft.irfft2(spectrum, self.grid, overwrite_x=True))


class Sums(Blur):
    """By a sum over the PSF's pixels that are not zero; the scene has half a PSF on every side of the image."""

    def __init__(self, psf: Reals, shape: tuple[int, int]) -> None:
        self.half, self.shape = len(psf) // 2, shape
        self.scene = shape[0] + 2 * self.half, shape[1] + 2 * self.half
        self.dark = np.zeros((shape[0] + 4 * self.half, shape[1] + 4 * self.half), psf.dtype)
        self.blurred = np.empty(shape, psf.dtype)
        self.forward = _weights(psf[::-1, ::-1], self.scene[1])
        self.backward = _weights(psf, self.dark.shape[1])

    def laid(self, image: Reals) -> Reals:
        """See `Blur`."""
        return np.roll(continued(image, self.scene), (self.half, self.half), axis=(0, 1))

    def cut(self, scene: Reals) -> Reals:
        """See `Blur`."""
        return scene[self.half : self.half + self.shape[0], self.half : self.half + self.shape[1]]

    def seen(self, scene: Reals) -> Reals:
        """See `Blur`."""
        from psflut.kernels.summing import correlate

        correlate(scene.ravel(), scene.shape[1], *self.forward, self.blurred)
        return self.blurred

    def pulled(self, ratio: Reals) -> Reals:
        """See `Blur`."""
        from psflut.kernels.summing import correlate

        margin = 2 * self.half
        self.dark[margin : margin + self.shape[0], margin : margin + self.shape[1]] = ratio
        out = np.empty(self.scene, ratio.dtype)
        correlate(self.dark.ravel(), self.dark.shape[1], *self.backward, out)
        return out


def _weights(psf: Reals, stride: int) -> tuple[Reals, NDArray[np.int64]]:
    """The pixels that are not zero and their offsets in an image of lines of that length, some zeros after them."""
    from psflut.kernels.summing import AT_ONCE

    y, x = np.nonzero(psf)
    more = (0, -len(y) % AT_ONCE)
    return np.pad(psf[y, x], more), np.pad(y * stride + x, more)


def blurred(image: Reals, psf: Reals) -> Reals:
    """h * f for an image (H, W) and a PSF (K, K), mirrored beyond its border as captures are."""
    mirrored = np.pad(image, len(psf) // 2, mode="symmetric")
    return np.asarray(signal.oaconvolve(mirrored, psf.astype(image.dtype, copy=False), mode="valid"))
