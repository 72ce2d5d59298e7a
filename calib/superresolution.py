"""One PSF from many under-sampled points: its spectrum beyond the pixels' Nyquist frequency, and their places."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage, optimize

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Fit:
    """What is shown, p, of energy 1 in its samples, and how well it is known.

    Parameters
    ----------
    psf : (W, W) array
        Samples at whole pixels, centred.
    power : (W, W) array
        Posterior variance of their discrete Fourier transform, zero frequency in the middle.
    shift, flux : (N, 2) and (N,) arrays
        Of every window: its centre less the middle pixel, (y, x), and its root of energy.
    residual : (N, W, W) array
    """

    psf: Floats
    power: Floats
    shift: Floats
    flux: Floats
    residual: Floats

    @cached_property
    def spread(self) -> Floats:
        """How the noise is spread over a window (W, W), mean 1: read noise, photons, and points that differ."""
        signed = self.psf.min() < -0.1 * self.psf.max()
        light = ndimage.uniform_filter(np.abs(self.psf), 3) if signed else np.abs(self.psf)
        columns = np.stack([np.ones(light.size), light.ravel(), self.psf.ravel() ** 2], 1)
        squares = np.mean(self.residual**2, axis=0).ravel()
        spread = np.full(light.size, squares.mean() + 1e-300)
        for _ in range(4):
            factors, _ = optimize.nnls(columns / spread[:, None], squares / spread)
            spread = np.maximum(columns @ factors, 1e-3 * spread.mean() + 1e-300)
        return np.asarray((spread / spread.mean()).reshape(light.shape))

    def draws(self, rng: np.random.Generator, count: int) -> Floats:
        """(count, W, W) the samples with noise as large, and coloured, as what the fit leaves open."""
        shape = self.psf.shape
        white = np.sqrt(self.spread) * rng.standard_normal((count, *shape))
        gain = np.sqrt(fft.ifftshift(self.power))[:, : shape[1] // 2 + 1] / shape[0]
        return np.asarray(self.psf + fft.irfft2(fft.rfft2(white) * gain, shape))

    @property
    def variance(self) -> Floats:
        """Of a sample (W, W), as the noise of coarse structures has it: below a quarter cycle a pixel."""
        line = (np.arange(len(self.psf)) - len(self.psf) // 2) / len(self.psf)
        return np.asarray(self.spread * self.power[np.hypot(line[:, None], line) < 0.25].mean() / self.psf.size)


def superresolve(images: Floats, shift: Floats, noise: Floats, oversampling: int, rounds: int) -> Fit:
    """Fit g_i(x) = a_i p(x - c_i) to all windows at once.

    Parameters
    ----------
    images : (N, W, W) array
        Background subtracted; W odd.
    shift : (N, 2) array
        First guess of c_i; for a finer fit that of a coarse one, which is not led astray by aliases.
    noise : (N,) array
        Variance of a pixel where there is no light.
    oversampling : int
        Odd; 1 is averaging by Fourier shift.
    rounds : int
        Of fitting p and the places in turn.
    """
    width = images.shape[-1]
    flux = np.sqrt(np.maximum(np.sum(images**2, axis=(1, 2)) - noise * width**2, noise))
    spectrum, covariance, shift, flux, residual = _alternate(images, shift, flux, noise, oversampling, rounds)
    power = covariance.sum(axis=(1, 2)).real.reshape(width, width)
    psf = _samples(spectrum, width)
    scale = np.sqrt(np.sum(psf**2))
    return Fit(psf / scale, power / scale**2, shift, flux * scale, residual)


def _alternate(
    images: Floats, shift: Floats, flux: Floats, noise: Floats, s: int, rounds: int
) -> tuple[Complexes, Complexes, Floats, Floats, Floats]:
    """Spectrum (s W, s W), covariance of its aliases, shifts, fluxes and residuals, fitted in turn."""
    count, width = images.shape[:2]
    line = (np.arange(s * width) - s * width // 2) / width  # cycles a pixel
    ring = np.rint(16 * np.hypot(line[:, None], line)).astype(int).ravel()
    power = np.outer(np.sinc(line), np.sinc(line)) ** 2 * width + 1e-6
    spectra, excess = _spectra(images), 1.0
    for _ in range(rounds):
        weight = 1 / (excess * noise * width**2)
        spectrum, covariance, used = _solve(spectra, shift, flux, weight, power, line)
        variance = np.einsum("kmm->km", covariance).real
        aliases = variance.reshape(width, width, s, s).transpose(2, 0, 3, 1).ravel()
        mean = np.bincount(ring, np.abs(spectrum.ravel()) ** 2 + aliases) / np.maximum(np.bincount(ring), 1)
        power = mean[ring].reshape(power.shape) + 1e-12 * mean.max()
        spectrum, shift = _centre(spectrum, shift, line)
        shift, flux, residual = _places(images, spectrum, shift, flux, line)
        free = max(1 - (used + 3 * count) / images.size, 1e-3)
        excess = max(float(np.sum(residual**2) / free / (noise.sum() * width**2)), 1.0)
    return spectrum, covariance, shift, flux, residual


def _spectra(images: Floats) -> Complexes:
    """Fourier transforms of centred windows, zero frequency in the middle."""
    axes = (-2, -1)
    return np.asarray(fft.fftshift(fft.fft2(fft.ifftshift(images, axes)), axes))


def _samples(spectrum: Complexes, width: int) -> Floats:
    """A fine spectrum's samples at whole pixels: its aliases add up."""
    s = len(spectrum) // width
    return _images(spectrum.reshape(s, width, s, width).sum(axis=(0, 2)))


def _images(spectrum: Complexes) -> Floats:
    """The inverse of `_spectra`, real part."""
    return np.asarray(fft.fftshift(fft.ifft2(fft.ifftshift(spectrum))).real)


def _ramp(line: Floats, shift: Floats) -> Complexes:
    """What a shift (y, x) in pixels multiplies a spectrum with."""
    turn = np.exp(-2j * np.pi * np.outer(shift, line))
    return np.asarray(turn[0][:, None] * turn[1])


def _solve(
    spectra: Complexes, shift: Floats, flux: Floats, weight: Floats, power: Floats, line: Floats
) -> tuple[Complexes, Complexes, float]:
    """The regularised fit of all aliases: spectrum, covariance (W^2, s^2, s^2), and freedoms that it used."""
    width = spectra.shape[-1]
    s = len(line) // width
    aliases = np.arange(s) - s // 2
    turns = np.stack([_ramp(aliases, c).ravel() for c in shift])
    normal = np.einsum("i,im,in->mn", weight * flux**2, turns.conj(), turns)
    right = np.zeros(power.shape, complex)
    for g, c, factor in zip(spectra, shift, weight * flux, strict=True):
        right += factor * _ramp(line, c).conj() * np.tile(g, (s, s))
    sides, order = (s, width, s, width), (1, 3, 0, 2)  # from a fine spectrum to frequency and alias
    prior = power.reshape(sides).transpose(order).reshape(-1, s * s)
    covariance = np.linalg.inv(normal + np.eye(s * s) / prior[:, None, :])
    found = np.einsum("kmn,kn->km", covariance, right.reshape(sides).transpose(order).reshape(-1, s * s)).reshape(
        width, width, s, s
    )
    used = float(np.einsum("kmn,nm->", covariance, normal).real)
    return found.transpose(2, 0, 3, 1).reshape(power.shape), covariance, used


def _centre(spectrum: Complexes, shift: Floats, line: Floats) -> tuple[Complexes, Floats]:
    """The spectrum with its centre of mirror symmetry, where p * p is largest, moved to 0."""
    mirror = _images(spectrum**2)
    y, x = np.unravel_index(np.argmax(mirror), mirror.shape)
    y, x = np.clip([y, x], 1, len(line) - 2)
    cross = np.stack([mirror[y - 1 : y + 2, x], mirror[y, x - 1 : x + 2]])
    bend = np.minimum(cross[:, 0] - 2 * cross[:, 1] + cross[:, 2], -1e-300)
    fine = np.array([y, x]) - len(line) // 2 + 0.5 * (cross[:, 0] - cross[:, 2]) / bend
    centre = 0.5 * fine / (len(line) * (line[1] - line[0]))
    return spectrum * _ramp(line, -centre), shift + centre


def _places(
    images: Floats, spectrum: Complexes, shift: Floats, flux: Floats, line: Floats
) -> tuple[Floats, Floats, Floats]:
    """One Gauss-Newton step of every shift and flux, and the residuals before it; the energy of p is made 1."""
    width = images.shape[-1]
    scale = np.sqrt(np.sum(_samples(spectrum, width) ** 2))
    slopes = (1.0, -2j * np.pi * line[:, None], -2j * np.pi * line)
    shift, flux, residual = shift.copy(), flux * scale, np.empty_like(images)
    for i, image in enumerate(images):
        moved = spectrum / scale * _ramp(line, shift[i])
        value, *slope = (_samples(moved * factor, width).ravel() for factor in slopes)
        residual[i] = image - flux[i] * value.reshape(image.shape)
        step = np.linalg.lstsq(np.stack([value, *(flux[i] * d for d in slope)], 1), residual[i].ravel())[0]
        flux[i] += step[0]
        shift[i] += np.clip(step[1:], -0.5, 0.5)
    return shift, flux, residual
