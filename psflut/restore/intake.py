"""What restoration can take: arrays seen to be sound, and images that are not negative."""

import numpy as np
from numpy.typing import NDArray

from psflut.errors import PsflutError

Reals = NDArray[np.floating]

NOISE_SIGMAS = 6.0
"""Noise sigma below zero from which an image is signed rather than noisy."""


def nonnegative(image: Reals, sigma: float) -> tuple[Reals, float]:
    """An image as Richardson-Lucy can take it, and the factor by which its grey values were scaled.

    A signed image, below zero by more than `NOISE_SIGMAS` noise sigma, is mapped by its own minimum and maximum to
    [0, 1], as the thesis' set-up maps its Laplacian; blur commutes with that, because a PSF sums to 1. What
    noise alone took below zero is set to zero, as deconvblind does.
    """
    low, high = float(image.min()), float(image.max())
    if low < -NOISE_SIGMAS * sigma:
        return (image - low) / (high - low), 1.0 / (high - low)
    return np.maximum(image, 0.0), 1.0


def checked(image: Reals, psf: Reals, positive: bool = False) -> tuple[Reals, Reals]:
    """Image and PSF in the precision of the work, once they are seen to be sound."""
    kind = np.float32 if np.asarray(image).dtype == np.float32 else np.float64
    image, psf = np.asarray(image, dtype=kind), np.asarray(psf, dtype=kind)
    if image.ndim != 2 or psf.ndim < 2 or not (0 < psf.shape[-2] == psf.shape[-1] <= min(image.shape)):
        raise PsflutError(
            f"expected an image (H, W) and a PSF (K, K) no larger, got {image.shape} and {psf.shape}; crop it"
        )
    if psf.shape[-1] % 2 == 0:
        raise PsflutError(f"the side of a PSF must be odd, to have a middle, got {psf.shape}; pad or crop it")
    if not (np.all(np.isfinite(image)) and np.all(np.isfinite(psf))):
        raise PsflutError("image and PSF must be finite, got NaN or infinity; mask or mend those pixels")
    if np.any(np.abs(psf.sum(axis=(-2, -1)) - 1) > 1e-3):
        raise PsflutError(f"the PSF must sum to 1, got {psf.sum(axis=(-2, -1))}; divide it by its sum")
    if positive and (image.min() < 0 or psf.min() < 0 or image.max() == 0):
        raise PsflutError(
            f"Richardson-Lucy needs a PSF and an image that are not negative, nor all dark, got minima "
            f"{psf.min():.3g} and {image.min():.3g}; map a signed image by its minimum and maximum to [0, 1]"
        )
    return image, psf
