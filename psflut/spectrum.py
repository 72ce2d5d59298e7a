"""The tapered power spectrum of a patch, averaged in narrow annuli of spatial frequency.

A patch is whitened, tapered and transformed, and the whitening divided out again:

    P = |F{w (d * g)}|^2 / (|D|^2 sum w^2)

so that white noise of variance s^2 has the mean power s^2, but for what leaks (`Annuli.white`). Frequencies are in
cycles a pixel. d is a Laplacian: a blurred scene's power falls by f^-5 and more, and without it slow light and shade
would leak over what tells the blur (prewhitening: Percival and Walden 1993, section 6.5). So the taper may be flat but
for a cosine rise over an eighth of the side at either end (Tukey 1967).

Compared by the median error of distance on 576 captures of kodak (lab16mm; up to 2.5 m, middle, beyond 3.5 m), the
prior learnt anew with each from the other photographs:

======================================  ==================  ==================  ==========
taper, and by what the patch is         128 pixels, %       64 pixels, %        95 % covers
whitened
======================================  ==================  ==================  ==========
Hann, none                              0.53  0.96  2.0     1.64  1.37  2.1     83, 91 %
rise over a quarter, none               0.37  0.75  1.6     1.17  1.16  2.1     86, 92 %
rise over 0.15, none                    0.43  0.65  1.4     1.83  1.24  1.9     87, 89 %
half a sine, none                       0.44  0.76  1.5     1.16  1.25  2.2     87, 90 %
two by two sines, none                  0.48  0.65  1.6     1.45  1.19  1.8     85, 87 %
two by two Slepian, NW = 2, none        0.57  0.94  1.8     1.50  1.25  2.4     80, 89 %
rise over 0.12, two differences         0.39  0.66  1.4     1.12  1.24  1.7     89, 91 %
rise over a quarter, Laplacian          0.38  0.72  1.6     0.97  1.29  2.2     86, 91 %
rise over 0.12, Laplacian               0.38  0.68  1.4     1.02  1.03  1.8     89, 91 %
rise over 0.06, Laplacian               0.40  0.65  1.6     1.02  1.07  1.9     90, 91 %
======================================  ==================  ==================  ==========

(Intervals of the model itself, of 128 and 64 pixels, before what `psflut.evidence.discount` and `psflut.gross` do.) A
Hann window leaves 0.27 of the independent bins, a rise over an eighth 0.75.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.signal.windows import tukey

from psflut import fourier
from psflut.fourier import autocorrelation, once

Floats = NDArray[np.float64]

LOWEST = 2.5
"""Annuli begin at this many bins from zero: nearer, the taper mixes in what is left of slow shade."""

RISE = 0.125
"""Share of the side over which the taper rises, at either end."""


@dataclass(frozen=True, eq=False)
class Annuli:
    """The annuli of patches of one shape, one bin of the shorter side wide, whole or cut into sectors.

    Parameters
    ----------
    shape : (H, W)
    sectors : int
        Into which every annulus is cut, opposite directions in one; K counts the sectors of all annuli, one direction
        after the other, without those that no bin falls into.
    taper : (H, W) array
        Zero along the borders, which the whitening of a patch does not reach.
    index : (H, W // 2 + 1) array of int
        Annulus of every bin of the half plane, K for those that belong to none.
    frequency : (K,) array
        Mean frequency, cycles a pixel.
    ring : (K,) array of int
        The whole annulus that each is of.
    direction : (K,) array
        Middle of the sector, radians from x (across) towards y (down); 0 for whole annuli.
    effective : (K,) array
        Effective number of independent bins: those of the half plane times (sum w^2)^2 / (N sum w^4), which
        is what the correlation between neighbours leaves of them in a long run of bins.
    """

    shape: tuple[int, int]
    sectors: int
    taper: Floats
    index: NDArray[np.intp]
    frequency: Floats
    ring: NDArray[np.intp]
    direction: Floats
    effective: Floats

    @cached_property
    def count(self) -> int:
        """Of whole annuli."""
        return int(self.ring.max()) + 1

    @property
    def place(self) -> Floats:
        """(K,) frequency in bins of the shorter side."""
        return self.frequency * min(self.shape)

    @cached_property
    def sector(self) -> NDArray[np.intp]:
        """(K,) number of the sector."""
        return np.rint(self.direction * self.sectors / np.pi).astype(np.intp)

    def spread(self, values: Floats, missing: float) -> Floats:
        """Values by sector and annulus, (..., K) -> (..., sectors, annuli); `missing` where there is no bin."""
        out = np.full((*values.shape[:-1], self.sectors, self.count), missing)
        out[..., self.sector, self.ring] = values
        return out

    def listed(self, values: Floats) -> Floats:
        """The same back: (..., sectors, annuli) -> (..., K)."""
        return values[..., self.sector, self.ring]

    def mean(self, power: NDArray[np.floating]) -> Floats:
        """Average over each annulus of the whole plane: (..., H, W // 2 + 1) -> (..., K)."""
        index, count = self.index.ravel(), len(self.frequency)
        flat = (power * once(self.shape)).reshape(-1, len(index))
        sums = np.array([np.bincount(index, weights=row, minlength=count + 1)[:count] for row in flat])
        return np.asarray(sums.reshape(*power.shape[:-2], count) / self.bins)

    @cached_property
    def bins(self) -> Floats:
        """(K,) frequencies in each annulus, of which the plane holds two bins each."""
        weight = np.broadcast_to(once(self.shape), self.index.shape)
        return np.asarray(np.bincount(self.index.ravel(), weight.ravel())[: len(self.frequency)], dtype=float)

    def power(self, image: NDArray[np.floating]) -> Floats:
        """Mean power of patches in each annulus: (..., H, W) -> (..., K), image units squared."""
        spectrum = self.transformed(image)
        return self.mean(spectrum.real**2 + spectrum.imag**2)

    def whole(self, values: Floats) -> Floats:
        """The mean over each whole annulus of what is known of its sectors: (..., K) -> (..., annuli)."""
        if self.sectors == 1:
            return values
        members = (self.ring == np.arange(self.count)[:, None]) * self.bins
        return np.asarray(values @ (members / members.sum(axis=1, keepdims=True)).T)

    def transformed(self, image: NDArray[np.floating]) -> NDArray[np.complexfloating]:
        """(..., H, W // 2 + 1) transform of patches (..., H, W) whose squared modulus is the power P."""
        from psflut.kernels.summing import laplacian

        inner = np.ascontiguousarray(self.taper[1:-1, 1:-1], dtype=image.dtype)
        whitened = np.empty((*image.shape[:-2], *inner.shape), image.dtype)
        laplacian(np.ascontiguousarray(image).reshape(-1, *self.shape), inner, whitened.reshape(-1, *inner.shape))
        spectrum = fft.rfft2(whitened, s=self.shape)
        spectrum *= self._scale.astype(image.dtype)
        return np.asarray(spectrum)

    def smear(self, power: NDArray[np.floating]) -> Floats:
        """What whitening and taper make of a power transfer function (H, W // 2 + 1): it convolved with the taper's
        power spectrum."""
        return self.unwhitening * self._convolved(self._white * power)

    def pulled(self, change: NDArray[np.floating]) -> Floats:
        """The adjoint of `smear`: how a function of the smeared power changes with the power, both per bin."""
        return self._white * self._convolved(self.unwhitening * change)

    def _convolved(self, power: Floats) -> Floats:
        return np.asarray(fft.rfft2(fft.irfft2(power, s=self.shape) * self._lag_window).real)

    @property
    def doubled(self) -> tuple[int, int]:
        """The shape of a grid of half this one's steps in frequency."""
        return 2 * self.shape[0], 2 * self.shape[1]

    def leaked(self, power: NDArray[np.floating]) -> Floats:
        """Mean of P in each annulus (K,) for a field with that power spectrum, on the grid of `doubled`."""
        whitened = power * whitening(self.doubled) ** 2
        smeared = fft.rfft2(fft.irfft2(whitened, s=self.doubled) * self.lags).real[::2, ::2]
        return self.mean(smeared * self.unwhitening)

    @cached_property
    def white(self) -> Floats:
        """(K,) power of white noise of variance 1: more than 1 in the lowest annuli, into which it leaks."""
        return self.leaked(np.ones((self.doubled[0], self.shape[1] + 1)))

    @cached_property
    def _white(self) -> Floats:
        """(H, W // 2 + 1) squared transfer function of the whitening."""
        return whitening(self.shape) ** 2

    @cached_property
    def unwhitening(self) -> Floats:
        """(H, W // 2 + 1) one over that; 0 at zero frequency, which no annulus holds."""
        white = self._white
        return np.divide(1.0, white, out=np.zeros_like(white), where=white > 0)

    @cached_property
    def _scale(self) -> Floats:
        return np.asarray(np.sqrt(self.unwhitening / np.sum(self.taper**2)))

    @cached_property
    def lags(self) -> Floats:
        """(2 H, 2 W) autocorrelation of the taper, 1 at lag zero."""
        return np.asarray(autocorrelation(self.taper, self.doubled), dtype=np.float64)

    @cached_property
    def _lag_window(self) -> Floats:
        """(H, W) autocorrelation of the taper at the lags of a patch, 1 at lag zero."""
        near = [np.r_[0 : (n + 1) // 2, 2 * n - n // 2 : 2 * n] for n in self.shape]
        return np.asarray(self.lags[np.ix_(*near)])


@lru_cache(maxsize=16)
def annuli(shape: tuple[int, int], sectors: int = 1) -> Annuli:
    """The annuli of patches of that shape."""
    taper = np.outer(*(tukey(side, 2 * RISE) for side in shape))
    frequency = fourier.frequency(shape)
    ring = np.floor(frequency * min(shape) - LOWEST).astype(np.intp)
    count = int(ring.max()) + 1
    sector = np.rint(fourier.direction(shape) * sectors / np.pi).astype(np.intp) % sectors
    pairs, index = np.unique(np.where(ring < 0, sectors * count, sector * count + ring), return_inverse=True)
    pairs = pairs[pairs < sectors * count]
    weight = once(shape) * np.ones_like(frequency)
    index = index.reshape(frequency.shape)
    bins, sums = (np.bincount(index.ravel(), each.ravel())[: len(pairs)] for each in (weight, weight * frequency))
    independent = np.sum(taper**2) ** 2 / (taper.size * np.sum(taper**4))
    centre, direction = sums / bins, np.pi * (pairs // count) / sectors
    return Annuli(shape, sectors, taper, index, centre, pairs % count, direction, bins * independent)


def annular_power(image: NDArray[np.floating]) -> Floats:
    """Mean power of patches in each whole annulus: (..., H, W) -> (..., K), image units squared."""
    return annuli((image.shape[-2], image.shape[-1])).power(image)


def whitening(shape: tuple[int, int]) -> Floats:
    """Transfer function |D| of the Laplacian, (H, W // 2 + 1) on the grid of ``rfft2``: 6 (1 - s(u) s(v))."""
    down, across = fft.fftfreq(shape[0])[:, None], fft.rfftfreq(shape[1])
    return np.asarray(6.0 - (2 + np.cos(2 * np.pi * down)) * (2 + np.cos(2 * np.pi * across)) * (6 / 9))
