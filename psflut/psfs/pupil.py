"""Wave optics: a round pupil with defocus and aberrations."""

from dataclasses import dataclass
from math import factorial, isfinite

import numpy as np
from numpy.typing import NDArray
from scipy.fft import fft, irfft, next_fast_len

from psflut.errors import PsflutError
from psflut.optics import Camera, Floats, defocus_wavefront
from psflut.psfs import PSFModel, disc_radius

MOST_SAMPLES = 8192
"""Across the pupil: a gigabyte in double precision."""


@dataclass(frozen=True)
class Pupil(PSFModel):
    """The incoherent PSF of a round pupil (2.4.3, 2.5.1): defocus, aberrations, several wavelengths.

    The intensity is |Fourier transform of exp(+2 pi i W / lambda) over the pupil|^2, integrated over pixels.
    With rho = 1 at the rim, theta from +x towards +y (y down, as in the result), the wavefront in metres is

        W = W020 rho^2 + sum of waves * camera.wavelength * R_n^|m|(rho) {cos m theta, m >= 0; sin |m| theta}

    with W020 from `optics.defocus_wavefront` and the radial polynomials of Born and Wolf, 1 at the rim, so
    (4, 0, w) is w (6 rho^4 - 6 rho^2 + 1). Positive tilts (1, 1), (1, -1) move the PSF towards +x, +y; a
    positive (2, 0) adds to the defocus of an object nearer than the focus. Assumed: scalar diffraction, small
    angles, an evenly lit pupil, the same W at every wavelength. Energy outside the window is dropped and the
    sum made 1; rounding below zero is clipped. Errors are below 0.15 % of the peak at f/2, 16 mm, 6 um pixels
    (blur up to 12 pixels of 49) and on the thesis' camera, and reach 0.6 % where the disc fills the window.

    Parameters
    ----------
    zernikes : tuple of (int, int, float)
        Terms (n, m, waves), the coefficient in waves at camera.wavelength.
    wavelengths : tuple of float
        In metres, of equal energy; none means camera.wavelength.

    Raises
    ------
    PsflutError
        Unless n >= |m|, n - |m| is even and wavelengths are positive. When called, if the geometric blur
        disc is wider than `size` pixels, or they hold less than half of the energy.
    """

    zernikes: tuple[tuple[int, int, float], ...] = ()
    wavelengths: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for n, m, waves in self.zernikes:
            if n < abs(m) or (n - abs(m)) % 2 or not isfinite(waves):
                wanted = "(n, m, waves) with n >= |m|, n - |m| even and finite waves"
                raise PsflutError(f"a Zernike term is {wanted}, got {(n, m, waves)}; write (4, 0, 0.2), say")
        for wavelength in self.wavelengths:
            if not (isfinite(wavelength) and wavelength > 0):
                raise PsflutError(f"wavelengths must be positive, got {wavelength} m; write 550e-9, say")

    def plane(self, camera: Camera, distance: float, size: int) -> Floats:
        """See `PSFModel`."""
        radius = disc_radius(camera, distance, size)
        # One pixel as a path difference across the pupil, in metres.
        pitch = camera.pixel_pitch * camera.aperture_diameter / camera.detector_distance
        # How far rays go, in pixels: no term is steeper than n (n + 2) / 2 waves per unit of rho.
        steepness = sum(abs(waves) * n * (n + 2) for n, _, waves in self.zernikes)
        reach = radius + steepness * camera.wavelength / pitch
        # A sampled pupil repeats the PSF with a period, in pixels; the slack is what convergence asked for.
        period = max(0.7 * size, reach) + 1.5 * reach
        psf, wavelengths = np.zeros((size, size)), self.wavelengths or (camera.wavelength,)
        for wavelength in wavelengths:
            samples = max(128, int(period * pitch / wavelength) + 1)
            if samples > MOST_SAMPLES:
                raise PsflutError(
                    f"blur and aberrations at {distance} m want a pupil of {samples} samples a side, at most "
                    f"{MOST_SAMPLES} are made; take smaller aberrations, blur, or size"
                )
            x, y, amplitude = _disc(next_fast_len(samples))
            wavefront = defocus_wavefront(camera, distance) * (x**2 + y**2)
            for n, m, waves in self.zernikes:
                wavefront += waves * camera.wavelength * _zernike(n, m, x, y)
            pupil = amplitude * np.exp(2j * np.pi / wavelength * wavefront)
            psf += _pixels(pupil, pitch / wavelength, size) / len(wavelengths)
        if not psf.sum() >= 0.5:
            held = f"half of the energy at {distance} m, got {100 * psf.sum():.0f} %"
            raise PsflutError(f"{size} pixels must hold {held}; take a larger size or smaller aberrations")
        psf = np.maximum(psf, 0.0)
        return np.asarray(psf / psf.sum(), dtype=float)


def _disc(samples: int) -> tuple[Floats, Floats, Floats]:
    """x (1, samples), y (samples, 1) and the amplitude (samples, samples) of the unit disc."""
    line = (2.0 * np.arange(samples) + 1.0) / samples - 1.0
    x, y = line[np.newaxis, :], line[:, np.newaxis]
    # The rim is low-passed by a Lanczos kernel. A ramp one sample wide would dim the wave from the rim, and
    # the bright centre of a large disc by 1 % of the peak; this edge leaves 0.1 %.
    t = np.linspace(-3.0, 3.0, 601)
    kernel = np.sinc(t) * np.sinc(t / 3.0)
    edge = np.cumsum(kernel) - kernel / 2.0
    return x, y, np.interp(0.5 * samples * (1.0 - np.hypot(x, y)), t, edge / edge[-1])


def _zernike(n: int, m: int, x: Floats, y: Floats) -> Floats:
    """The Zernike polynomial (n, m), 1 at the rim, where the rim is at x^2 + y^2 = 1."""
    square, order = x**2 + y**2, abs(m)
    radial = np.zeros_like(square)
    for s in range((n - order) // 2 + 1):
        below = factorial(s) * factorial((n + order) // 2 - s) * factorial((n - order) // 2 - s)
        radial = radial * square + (-1) ** s * factorial(n - s) / below
    angular = (x + 1j * y) ** order  # rho^m (cos m theta + i sin m theta)
    return np.asarray(radial * (angular.real if m >= 0 else angular.imag), dtype=float)


def _pixels(pupil: NDArray[np.complex128], pitch: float, size: int) -> Floats:
    """Fraction of the energy in each of size x size pixels; `pitch` is theirs, in units of lambda zd / D."""
    samples = len(pupil)
    # Padded to twice, the intensity is sampled at Nyquist; rows first, as the empty ones need no transform.
    field = fft(fft(pupil, 2 * samples, axis=1), 2 * samples, axis=0)
    intensity = field.real**2 + field.imag**2
    # Exact, as the intensity is band-limited: weights that integrate its samples over the width of a pixel.
    cycles = pitch / samples * np.arange(samples + 1)
    position = np.arange(size) - size // 2
    box = irfft(np.sinc(cycles) * np.exp(-2j * np.pi * np.outer(position, cycles)), 2 * samples, axis=1)
    scale = (pitch / samples) ** 2 / np.sum(np.abs(pupil) ** 2)
    return np.asarray(box @ intensity @ box.T * scale, dtype=float)
