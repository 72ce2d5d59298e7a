"""One PSF from many under-sampled points: its spectrum beyond the pixels' Nyquist frequency, and their places."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage, optimize

from calib.aliases import Aliases, Spectrum, images, ramp, samples, spectra

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

UNEVEN = 0.03
"""Share of the PSF's power that is thought not to be round before it is measured."""


@dataclass(frozen=True, eq=False)
class Fit:
    """What is shown, p, of energy 1 in its samples, and how well it is known.

    Parameters
    ----------
    psf : (W, W) array
        Samples at whole pixels, centred.
    power : (W, W) array
        Posterior variance of their discrete Fourier transform about the round mean, zero frequency in the middle.
    errors : (R, W, W) array
        What one standard deviation of each independent error of the round mean adds to the samples.
    shift, flux : (N, 2) and (N,) arrays
        Of every window: its centre less the middle pixel, (y, x), and its root of energy.
    residual : (N, W, W) array
    """

    psf: Floats
    power: Floats
    errors: Floats
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
        about = np.tensordot(rng.standard_normal((count, len(self.errors))), self.errors, 1)
        return np.asarray(self.psf + about + fft.irfft2(fft.rfft2(white) * gain, shape))

    @property
    def variance(self) -> Floats:
        """Of a sample (W, W), as the noise of coarse structures has it: below a quarter cycle a pixel."""
        line = (np.arange(len(self.psf)) - len(self.psf) // 2) / len(self.psf)
        noise = self.spread * self.power[np.hypot(line[:, None], line) < 0.25].mean() / self.psf.size
        return np.asarray(noise + np.sum(self.errors**2, axis=0))


def superresolve(pictures: Floats, shift: Floats, noise: Floats, oversampling: int, rounds: int) -> Fit:
    """Fit g_i(x) = a_i p(x - c_i) to all windows at once.

    Parameters
    ----------
    pictures : (N, W, W) array
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
    width = pictures.shape[-1]
    flux = np.sqrt(np.maximum(np.sum(pictures**2, axis=(1, 2)) - noise * width**2, noise))
    fit, shift, flux, residual = _alternate(pictures, shift, flux, noise, Aliases(width, oversampling), rounds)
    psf = samples(fit.found, width)
    scale = np.sqrt(np.sum(psf**2))
    return Fit(psf / scale, fit.power / scale**2, fit.errors / scale, shift, flux * scale, residual)


def _alternate(
    pictures: Floats, shift: Floats, flux: Floats, noise: Floats, aliases: Aliases, rounds: int
) -> tuple[Spectrum, Floats, Floats, Floats]:
    """Spectrum, shifts, fluxes and residuals, fitted in turn.

    The variance of the prior is the geometric mean of what two fixed points of its likelihood say: expectation
    maximisation (by itself slow, and then too wide) and that of MacKay (1992; by itself too sure).
    """
    count, width = pictures.shape[:2]
    shown, excess = spectra(pictures), 1.0
    light = float(np.median(np.abs(shown).max(axis=(1, 2)) / flux))
    power = (UNEVEN if aliases.oversampling > 1 else 1.0) * light**2 * aliases.pixel**2 + 1e-6
    for _ in range(rounds):
        weight = 1 / (excess * noise * width**2)
        fit = aliases.fit(shown, shift, flux, weight, power)
        uneven = aliases.ringed(np.abs(fit.found - fit.round) ** 2)
        told = aliases.ringed(1 - fit.variance / power)
        power = np.sqrt((uneven + aliases.ringed(fit.variance)) * uneven / np.maximum(told, 1e-9))
        power += 1e-12 * power.max()
        spectrum, shift = _centre(fit.found, shift, aliases.line)
        shift, flux, residual = _places(pictures, spectrum, shift, flux, aliases.line)
        free = max(1 - (fit.used + 3 * count) / pictures.size, 1e-3)
        excess = max(float(np.sum(residual**2) / free / (noise.sum() * width**2)), 1.0)
    return fit._replace(found=spectrum), shift, flux, residual


def _centre(spectrum: Complexes, shift: Floats, line: Floats) -> tuple[Complexes, Floats]:
    """The spectrum with its centre of mirror symmetry, where p * p is largest, moved to 0."""
    mirror = images(spectrum**2)
    y, x = np.unravel_index(np.argmax(mirror), mirror.shape)
    y, x = np.clip([y, x], 1, len(line) - 2)
    cross = np.stack([mirror[y - 1 : y + 2, x], mirror[y, x - 1 : x + 2]])
    bend = np.minimum(cross[:, 0] - 2 * cross[:, 1] + cross[:, 2], -1e-300)
    fine = np.array([y, x]) - len(line) // 2 + 0.5 * (cross[:, 0] - cross[:, 2]) / bend
    centre = 0.5 * fine / (len(line) * (line[1] - line[0]))
    return spectrum * ramp(line, -centre), shift + centre


def _places(
    pictures: Floats, spectrum: Complexes, shift: Floats, flux: Floats, line: Floats
) -> tuple[Floats, Floats, Floats]:
    """One Gauss-Newton step of every shift and flux, and the residuals before it; the energy of p is made 1."""
    width = pictures.shape[-1]
    scale = np.sqrt(np.sum(samples(spectrum, width) ** 2))
    slopes = (1.0, -2j * np.pi * line[:, None], -2j * np.pi * line)
    shift, flux, residual = shift.copy(), flux * scale, np.empty_like(pictures)
    for i, picture in enumerate(pictures):
        moved = spectrum / scale * ramp(line, shift[i])
        value, *slope = (samples(moved * factor, width).ravel() for factor in slopes)
        residual[i] = picture - flux[i] * value.reshape(picture.shape)
        step = np.linalg.lstsq(np.stack([value, *(flux[i] * d for d in slope)], 1), residual[i].ravel())[0]
        flux[i] += step[0]
        shift[i] += np.clip(step[1:], -0.5, 0.5)
    return shift, flux, residual
