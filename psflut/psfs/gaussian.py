"""The Gaussian blur spot."""

from dataclasses import dataclass

import numpy as np
from scipy.special import erf

from psflut.errors import PsflutError
from psflut.optics import Camera, Floats, blur_radius
from psflut.psfs import PSFModel


@dataclass(frozen=True)
class Gaussian(PSFModel):
    """A Gaussian spot as wide as the geometric blur disc (2.5.6), or the thesis' small filter for it.

    The density is exp(-(x^2 + y^2) / r^2) / (pi r^2), r the magnitude of `optics.blur_radius` in metres: its
    standard deviation is r / sqrt(2) and its OTF exp(-r^2 rho^2 / 4) (2.5.7), rho in radians a metre. It is
    integrated exactly over every pixel, and the window is renormalised to sum 1.

    With `fir` the result is the filter of section 5.1 instead, made by "sampling its OTF with a Gaussian
    windowing method" in the manner of MATLAB's fwind1. The OTF is sampled finely over one cycle a pixel and
    inverse transformed, which gives point samples of the PSF and not integrals over pixels. The central
    fir x fir taps are multiplied by the window exp(-0.5 (2.5 n / ((fir - 1) / 2))^2), n the radius in pixels
    (MATLAB's gausswin made rotationally symmetric), clipped where they ring below zero, renormalised to sum 1
    and padded with zeros to `size`. (fwind1 zeroes the corners beyond the window's radius; here they keep its
    value there, at most 0.002 in a 5 x 5 filter.)

    Merely cutting to 5 x 5 loses 31, 9 and 3 % of the sum of the point samples at 3.2, 4 and 4.5 m on the
    thesis' camera (F = 100 mm, zd = 101 mm, D = 6 mm) with pixels of 25 um: 31, 10 and 4 % of the energy. The
    window takes more: alone it is a Gaussian of r = 1.13 pixels, so the filter changes little with distance.

    Parameters
    ----------
    fir : int or None
        Side of the filter in pixels, odd; None for the Gaussian itself.

    Raises
    ------
    PsflutError
        If `fir` is even or not positive. When called, if `fir` exceeds `size`, or without `fir` if more than
        1 % of the energy falls outside the window.
    """

    fir: int | None = None

    def __post_init__(self) -> None:
        if self.fir is not None and not (self.fir > 0 and self.fir % 2 == 1):
            raise PsflutError(f"fir must be odd and positive, got {self.fir}; 5 is the thesis' filter")

    def plane(self, camera: Camera, distance: float, size: int) -> Floats:
        """See `PSFModel`."""
        pixels = abs(float(blur_radius(camera, distance))) / camera.pixel_pitch
        # Density, OTF and window are all separable: one profile says everything.
        profile = _integrals(pixels, distance, size) if self.fir is None else _filter(pixels, self.fir, size)
        psf = np.outer(profile, profile)
        return np.asarray(psf / psf.sum(), dtype=float)


def _integrals(radius: float, distance: float, size: int) -> Floats:
    """The Gaussian of `radius` pixels in one dimension, integrated over each of `size` pixels."""
    # Any spot far inside the central pixel is the same delta: the floor only keeps the division finite.
    edges = np.linspace(-size / 2.0, size / 2.0, size + 1) / max(radius, 1e-9)
    profile = np.diff(0.5 * erf(edges))
    lost = 1.0 - profile.sum() ** 2
    if not lost <= 0.01:
        raise PsflutError(
            f"the window of {size} pixels must hold 99 % of the blur at {distance} m, but cuts off "
            f"{100 * lost:.1f} %; take a larger size or a distance nearer the focus"
        )
    return np.asarray(profile, dtype=float)


def _filter(radius: float, taps: int, size: int) -> Floats:
    """The windowed filter for the OTF of `radius` pixels in one dimension, padded to `size` pixels."""
    if taps > size:
        raise PsflutError(f"size must be at least fir = {taps} pixels, got {size}; take a larger size")
    # The number of frequencies is the period in pixels at which the PSF repeats: far beyond the taps.
    frequency = np.fft.fftfreq(max(256, 8 * taps))
    otf = np.exp(-((np.pi * radius * frequency) ** 2))
    half = taps // 2
    n = np.arange(-half, half + 1)
    window = np.exp(-0.5 * (2.5 * n / max(half, 1)) ** 2)
    profile = np.maximum(np.fft.ifft(otf).real[n] * window, 0.0)
    return np.pad(profile, (size // 2 - half, size - 1 - size // 2 - half))
