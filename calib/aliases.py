"""A spectrum beyond the pixels' Nyquist frequency, from many under-sampled pictures of it: its aliases told apart.

Pixels show at each of their frequencies f the sum of aliases, turned by where a picture lies:

    G_i(f) = a_i sum_m P(f + m) exp(-2 pi i (f + m) c_i) + noise

Pictures at different places c_i tell the P(f + m) apart, but few do so badly. So P has a normal prior, independent
between frequencies: about a **round mean** (a function of radius, times the pixel's own transfer function) that is
fitted with it, by generalised least squares with all else integrated out, and with a variance that depends on radius.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

RINGS = 32
"""Of the round mean and of the prior's variance, a cycle a pixel; no more than there are frequencies."""

TOLD = 1e-9
"""What the pictures tell of a shape of the round mean, relative to the best known, below which it is left at zero."""


class Spectrum(NamedTuple):
    """What was found on the fine grid of frequencies (s W, s W), and how well it is known.

    `found` is the posterior mean, `round` the round mean, `variance` the posterior variance about it; `power` (W, W)
    the posterior variance of the sums of aliases; `pulled` (R, W, W) what one standard deviation of each of the
    independent errors of the round mean adds to these; `used` the freedoms used.
    """

    found: Complexes
    round: Complexes
    variance: Floats
    power: Floats
    pulled: Complexes
    used: float

    @property
    def errors(self) -> Floats:
        """(R, W, W) what those errors add to the samples at whole pixels; of many rounds only the last asks."""
        return images(self.pulled)


@dataclass(frozen=True)
class Aliases:
    """The frequencies of windows (W, W), W odd, and `oversampling` (odd) aliases of them along either axis."""

    width: int
    oversampling: int

    @cached_property
    def line(self) -> Floats:
        """(s W,) frequencies along an axis, cycles a pixel, ascending."""
        count = self.oversampling * self.width
        return (np.arange(count) - count // 2) / self.width

    @cached_property
    def pixel(self) -> Floats:
        """(s W, s W) transfer function of a pixel."""
        return np.outer(np.sinc(self.line), np.sinc(self.line))

    @cached_property
    def ring(self) -> NDArray[np.intp]:
        """(s W, s W) the ring of every frequency."""
        return np.asarray(np.rint(min(RINGS, self.width) * np.hypot(self.line[:, None], self.line)), dtype=np.intp)

    def ringed(self, values: Floats) -> Floats:
        """The mean of values (s W, s W) over the ring of each."""
        ring = self.ring.ravel()
        mean = np.bincount(ring, values.ravel()) / np.maximum(np.bincount(ring), 1)
        return np.asarray(mean[self.ring])

    def fit(self, spectra: Complexes, shift: Floats, flux: Floats, weight: Floats, power: Floats) -> Spectrum:
        """The posterior of P.

        Parameters
        ----------
        spectra : (N, W, W) array
            As `spectra` gives them.
        shift : (N, 2) array
            c_i, (y, x), pixels.
        flux, weight : (N,) arrays
            a_i, and one over the noise's variance of a frequency.
        power : (s W, s W) array
            Variance of the prior about the round mean.
        """
        normal = self._normal(shift, weight * flux**2)
        right = self._apart(self._right(spectra, shift, weight * flux))
        precision = self._apart(1.0 / power)
        covariance = np.asarray(
            np.linalg.inv(normal + precision[:, :, None] * np.eye(self.oversampling**2)), dtype=np.complex128
        )
        told = applied(covariance, right)
        profile, ways = self._round(covariance, precision, told)
        mean = self._shape(profile)
        found = told + applied(covariance, precision * mean)
        # Aliases add up: of the covariance the sums of its columns are all that an error of the round mean meets.
        pulled = ways @ self._by_ring(covariance.sum(axis=1) * precision * self._apart(self.pixel))
        both = self._twice
        return Spectrum(
            self._whole(found),
            self._whole(mean),
            self._whole(np.einsum("kmm->km", covariance)).real,
            self._mirrored(covariance.sum(axis=(1, 2))).real,
            self._mirrored(pulled),
            float(both @ (covariance.reshape(len(both), -1) @ normal.T.ravel()).real) + len(ways),
        )

    def _normal(self, shift: Floats, weight: Floats) -> Complexes:
        """(s^2, s^2) what pictures tell of the aliases of any frequency."""
        aliases = np.arange(self.oversampling) - self.oversampling // 2
        turns = np.stack([ramp(aliases, c).ravel() for c in shift])
        return np.asarray(np.einsum("i,im,in->mn", weight, turns.conj(), turns))

    def _right(self, spectra: Complexes, shift: Floats, weight: Floats) -> Complexes:
        """(s W, s W) the pictures, each turned back, added up."""
        right = np.zeros((len(self.line),) * 2, complex)
        for picture, c, factor in zip(spectra, shift, weight, strict=True):
            right += factor * ramp(self.line, c).conj() * np.tile(picture, (self.oversampling,) * 2)
        return right

    def _round(self, covariance: Complexes, precision: Floats, told: Complexes) -> tuple[Floats, Floats]:
        """Profile of the round mean by ring, and its independent errors (R, rings) of one standard deviation.

        With all else integrated out the pictures tell of the mean A^H C^-1 A = D - D V D, D the prior's precision and V
        the posterior covariance. Without aliases the mean is zero: there is nothing that it could tell apart, and it
        makes single particles rounder than they are (under a microscope 2 of 180 came to the wrong side of focus).
        """
        count = int(self.ring.max()) + 1
        if self.oversampling == 1:
            return np.zeros(count), np.empty((0, count))
        ring, pixel = self._apart(self.ring), self._apart(self.pixel)
        scaled = precision * pixel
        pairs = -(scaled[:, :, None] * covariance.real * scaled[:, None, :])
        line = np.arange(pairs.shape[1])
        pairs[:, line, line] += scaled * pixel
        pairs *= self._twice[:, None, None]
        flat = (ring[:, :, None] * count + ring[:, None, :]).ravel()
        known = np.bincount(flat, pairs.ravel(), minlength=count**2).reshape(count, count)
        right = np.bincount(ring.ravel(), (self._twice[:, None] * scaled * told.real).ravel(), minlength=count)
        power, shapes = np.linalg.eigh(0.5 * (known + known.T))
        shapes, power = shapes[:, power > TOLD * power[-1]], power[power > TOLD * power[-1]]
        return np.asarray(shapes @ (shapes.T @ right / power)), np.asarray((shapes / np.sqrt(power)).T)

    def _shape(self, profile: Floats) -> Floats:
        """What a profile by ring is at the frequencies worked out."""
        return np.asarray(profile[self._apart(self.ring)] * self._apart(self.pixel))

    def _by_ring(self, part: Complexes) -> Complexes:
        """(rings, W^2 // 2 + 1) values of a frequency and alias summed over the aliases in a ring."""
        ring = self._apart(self.ring)
        summed = np.zeros((int(self.ring.max()) + 1, len(part)), complex)
        np.add.at(summed, (ring, np.arange(len(part))[:, None]), part)
        return summed

    @property
    def _twice(self) -> Floats:
        """How often each frequency worked out stands in the plane."""
        twice = np.full(self.width**2 // 2 + 1, 2.0)
        twice[-1] = 1.0
        return twice

    def _apart(self, fine: NDArray[Any]) -> NDArray[Any]:
        """From the fine grid to (W^2 // 2 + 1, s^2): frequency and alias; the other half is the mirror of these."""
        s, width = self.oversampling, self.width
        whole = fine.reshape(s, width, s, width).transpose(1, 3, 0, 2).reshape(width**2, s * s)
        return whole[: width**2 // 2 + 1]

    def _whole(self, part: NDArray[Any]) -> NDArray[Any]:
        """The inverse of `_apart`: mirrored, P(-f) is the conjugate of P(f), and aliases are in reverse."""
        s, width = self.oversampling, self.width
        whole = np.concatenate([part, part[-2::-1, ::-1].conj()]).reshape(width, width, s, s)
        return whole.transpose(2, 0, 3, 1).reshape((s * width,) * 2)

    def _mirrored(self, part: NDArray[Any]) -> NDArray[Any]:
        """(..., W, W) of one number a frequency (..., W^2 // 2 + 1)."""
        whole = np.concatenate([part, part[..., -2::-1].conj()], axis=-1)
        return whole.reshape(*part.shape[:-1], self.width, self.width)


def applied(matrices: Complexes, vectors: NDArray[Any]) -> Complexes:
    """Each of the matrices (K, M, M) times its vector (K, M)."""
    return np.asarray((matrices @ vectors[:, :, None])[:, :, 0])


def spectra(pictures: Floats) -> Complexes:
    """Fourier transforms (..., W, W) of centred windows, zero frequency in the middle."""
    axes = (-2, -1)
    return np.asarray(fft.fftshift(fft.fft2(fft.ifftshift(pictures, axes)), axes))


def images(spectrum: Complexes) -> Floats:
    """The inverse of `spectra`, real part."""
    axes = (-2, -1)
    return np.asarray(fft.fftshift(fft.ifft2(fft.ifftshift(spectrum, axes)), axes).real)


def samples(spectrum: Complexes, width: int) -> Floats:
    """A fine spectrum's samples at whole pixels (W, W): its aliases add up."""
    s = len(spectrum) // width
    return images(spectrum.reshape(s, width, s, width).sum(axis=(0, 2)))


def ramp(line: Floats | NDArray[np.intp], shift: Floats) -> Complexes:
    """What a shift (y, x) in pixels multiplies a spectrum with."""
    turn = np.exp(-2j * np.pi * np.outer(shift, line))
    return np.asarray(turn[0][:, None] * turn[1])
