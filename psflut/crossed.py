"""What two images of one scene say of distance whatever the scene is: each blurred by the other's PSF, they agree.

    g1 = h1(z) * f + n1,   g2 = c h2(z) * s * f + n2   =>   r(z) = c s * h2(z) * g1 - h1(z) * g2 = noise alone

with c the ratio of exposures and s a small shift. At the true distance r has the power spectrum
D = c^2 |H2|^2 N1 + |H1|^2 N2, at another one the scene shows through (the cross relation of blind identification:
Xu, Liu, Tong, Kailath, IEEE Trans. Signal Processing 43, 2982 (1995); for depth from defocus, the orthogonal
operators of Favaro, Soatto, IEEE PAMI 27, 406 (2005)). With the scene's power S the density of both images is, at each
frequency,

    ln p = - w |r|^2 / D  +  (what the amplitudes say, `psflut.joint`)
    w = S A / (1 + S A),  A = |H1|^2 / N1 + c^2 |H2|^2 / N2

so that frequencies at which noise drowns the scene do not count. S A is read from the two images themselves, as
|g1|^2 / N1 + |g2|^2 / N2 has the mean S A + 2 at any distance.

Nothing is assumed of the scene, not even beyond the border: r is taken where both convolutions see the image alone, and
tapered there. Assumed: the same imager, magnification and point of view (a shift of up to a pixel is fitted, with the
ratio of exposures, at every distance), the same object in both.
"""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft

from psflut import fourier
from psflut.estimation import Problem
from psflut.fourier import once, phase, slopes, transfer
from psflut.spectrum import annuli
from psflut.table import PSFTable

Floats = NDArray[np.float64]
Spectrum = NDArray[np.complexfloating]

LOST = 1e-3
"""Share of a PSF's light that may come from beyond the border of what is compared."""

EDGE = 0.1
"""Share of the side of what is compared that the taper's rise takes, at either end."""

GAP = 8
"""Pixels over which opposite borders fade into each other, at least, at either end."""

SOLVES = 2
"""Times that gain and shift are fitted, each with the noise that the last gain makes."""

LOOSE = (1.0, 1.0)
"""Standard deviations of the ratio of exposures, relative to its first guess, and of a shift (pixels), before they
are fitted."""

FAINT = 1e-6
"""Noise below so much of its largest power at other frequencies is rounding."""

LARGEST_CORRECTION = 0.8
"""Share of a regressor's power that is taken for noise, at most."""


@dataclass(frozen=True, eq=False)
class Residual:
    """How two images disagree at each of M distances.

    Parameters
    ----------
    deviance : (M,) array
        Sum over independent frequencies of w |r|^2 / D at the gain and shift that suit the distance.
    log_volume : (M,) array
        ln of what the integral over gain and shift adds, but for a constant.
    gain : (M,) array
        c.
    shift : (M, 2) array
        Of the second image, down and across, pixels.
    """

    deviance: Floats
    log_volume: Floats
    gain: Floats
    shift: Floats


@dataclass(frozen=True, eq=False)
class Crossing:
    """Two captures, made ready to be compared at any distance.

    Parameters
    ----------
    first, second : Problem
        Of one shape and imager.
    margin : int
        Pixels along each border that are left out.
    shift : (float, float)
        Of the second image, about which a further one is linearised, pixels.
    """

    first: Problem
    second: Problem
    margin: int
    shift: tuple[float, float] = (0.0, 0.0)

    @cached_property
    def grid(self) -> tuple[int, int]:
        """Shape of the periodic grid."""
        return fourier.padded_shape(self.first.shape, GAP)

    @cached_property
    def taper(self) -> Floats:
        """On the grid: 0 along the borders, 1 in the middle, a cosine between."""
        return _taper(self.first.shape, self.grid, self.margin)

    @cached_property
    def excess(self) -> Floats:
        """(K,) S A + 1, the fused power of both images over their noise, by annulus of the patch."""
        rings = annuli(self.first.shape)
        response = rings.leaked(self.first.imager.transfer(rings.doubled) ** 2)
        pair = self.first, self.second
        parts = [each.power / each.noise.power(response, each.mean_level, rings.white) for each in pair]
        return np.asarray(np.maximum(sum(parts) - 1, 0.1))

    @cached_property
    def count(self) -> float:
        """Independent frequencies that count, sum of w."""
        return float(np.sum(self._weight))

    def at(self, even: ArrayLike) -> Residual:
        """The residual at distances (M,) in the coordinate of the flat prior."""
        rows = [self._solve(each) for each in np.atleast_1d(even)]
        deviance, volume, beta = (np.array(column) for column in zip(*rows, strict=True))
        shift = beta[:, 1:3] / beta[:, :1] + self.shift
        return Residual(deviance, volume, beta[:, 0], shift)

    def told(self, places: ArrayLike, gain: float) -> float:
        """What the deviance is expected to grow by from one of two distances to the other: 0 for equal PSFs."""
        one, two = (
            np.stack([otf(each.table, place, self.grid) / np.sqrt(noise) for place in np.asarray(places)])
            for each, noise in zip((self.first, self.second), self._noises, strict=True)
        )
        total = np.prod(np.abs(one) ** 2 + gain**2 * np.abs(two) ** 2, axis=0)
        turned = np.abs(gain * (one[0] * two[1] - two[0] * one[1])) ** 2 / np.maximum(total, np.finfo(float).tiny)
        return float(np.sum(self._weight * self.share / (1 - self.share) * turned))

    def recentred(self, shift: Floats) -> "Crossing":
        """The same about another shift."""
        return replace(self, shift=(float(shift[0]), float(shift[1])))

    def _solve(self, even: float) -> tuple[float, float, Floats]:
        """Deviance, log volume, and (c, c dy, c dx) at one distance."""
        one, two = (otf(each.table, even, self.grid) for each in (self.first, self.second))
        moved = self.spectra[0] * two
        fields = [moved, moved * self._slopes[0], moved * self._slopes[1], self.spectra[1] * one]
        shown = fft.irfft2(np.stack(fields), s=self.grid)
        seen = fft.rfft2(self.taper * np.concatenate([shown[:3], np.ones_like(shown[:1]), shown[3:]]))
        noises = (np.abs(two) ** 2 * self._noises[0], np.abs(one) ** 2 * self._noises[1])
        left, right = (np.maximum(self._smeared(each), FAINT * each.max()) for each in noises)
        beta = np.array([self._gain, 0.0, 0.0, 0.0])
        ridge = np.array([LOOSE[0], LOOSE[1], LOOSE[1], 1.0]) ** -2.0 / self._gain**2
        for _ in range(SOLVES):
            weight = self._weight / (beta[0] ** 2 * left + right)
            scaled = (seen * np.sqrt(weight / self._energy)).astype(np.complex64).view(np.float32).reshape(5, -1)
            products = (scaled @ scaled.T).astype(float)
            normal, aim = products[:4, :4], products[:4, 4]
            noise = np.minimum(self._squares @ (weight * left).ravel(), LARGEST_CORRECTION * np.diag(normal))
            normal = normal + np.diag(ridge - noise)
            beta = np.linalg.solve(normal, aim + ridge * [self._gain, 0.0, 0.0, 0.0])
        rest = np.append(beta, -1.0) @ scaled
        deviance = np.vdot(rest, rest)
        return float(deviance), float(-0.5 * np.linalg.slogdet(normal)[1]), beta

    @cached_property
    def spectra(self) -> tuple[Spectrum, Spectrum]:
        """Of both images about their means, the first moved by the shift."""
        one, two = (
            fft.rfft2(fourier.continued(each.image - each.image.mean(), self.grid))
            for each in (self.first, self.second)
        )
        return (one * phase(self.grid, self.shift)).astype(np.complex64), two.astype(np.complex64)

    @cached_property
    def _slopes(self) -> Spectrum:
        return slopes(self.grid).astype(np.complex64)

    @cached_property
    def _squares(self) -> Floats:
        """(4, bins) what the regressors (image, its two derivatives, a constant) make of the noise's power."""
        down, across = (np.abs(self._slopes) ** 2).reshape(2, -1)
        return np.stack([np.ones_like(down), down, across, np.zeros_like(down)])

    @cached_property
    def _noises(self) -> tuple[Floats, Floats]:
        return self.noise(self.grid)

    def noise(self, grid: tuple[int, int]) -> tuple[Floats, Floats]:
        """N1 and N2 on the half plane of a grid."""
        response = self.first.imager.transfer(grid) ** 2
        one, two = (each.noise.power(response, each.mean_level) for each in (self.first, self.second))
        return one, two

    @cached_property
    def _gain(self) -> float:
        """A first guess of c: the ratio of contrasts."""
        powers = [np.sum(each.power[: len(each.power) // 8 + 1]) for each in (self.first, self.second)]
        return float(np.sqrt(powers[1] / powers[0]))

    @cached_property
    def _energy(self) -> float:
        return float(np.sum(self.taper**2, dtype=float))

    @cached_property
    def freedom(self) -> float:
        """Independent pixels that the taper leaves."""
        return float(self._energy**2 / np.sum(self.taper**4, dtype=float))

    @cached_property
    def share(self) -> Floats:
        """w of every bin."""
        frequency = np.hypot(fft.fftfreq(self.grid[0])[:, None], fft.rfftfreq(self.grid[1]))
        share = np.maximum(1 - 1 / self.excess, 0.0)
        return np.asarray(np.interp(frequency, annuli(self.first.shape).frequency, share))

    @cached_property
    def _weight(self) -> Floats:
        """The same times the independent frequencies that a bin of the half plane stands for."""
        return np.asarray(self.freedom / self.taper.size * once(self.grid) * self.share)

    @cached_property
    def _lags(self) -> Floats:
        """Autocorrelation of the taper on the grid, 1 at lag zero."""
        lags = fft.irfft2(np.abs(fft.rfft2(self.taper)) ** 2, s=self.grid)
        return np.asarray(lags / lags[0, 0])

    def _smeared(self, power: Floats) -> Floats:
        """A noise's power spectrum as the taper shows it."""
        return np.asarray(fft.rfft2(fft.irfft2(power, s=self.grid) * self._lags).real)


def crossing(first: Problem, second: Problem, even: Floats) -> Crossing:
    """Two captures to be compared at distances within those given."""
    reach = max(_reach(each.table, float(even.min()), float(even.max())) for each in (first, second))
    return Crossing(first, second, min(reach, (min(first.shape) - 1) // 4))


def otf(table: PSFTable, even: float, grid: tuple[int, int]) -> Spectrum:
    """A table's transfer function at an even coordinate, in single precision."""
    position = np.clip(table.position(even), *table.span)
    return transfer(table.at(position).astype(np.float32), grid)


@lru_cache(maxsize=16)
def _reach(table: PSFTable, low: float, high: float) -> int:
    """Half the side of the square that holds all but `LOST` of every PSF between two even coordinates."""
    own, half = table.even(table.axis), table.size // 2
    planes = table.psf[(own >= low) & (own <= high)]
    ring = np.maximum(*np.abs(np.indices((table.size, table.size)) - half))
    held = np.cumsum([planes[:, ring == k].sum(axis=1) for k in range(half + 1)], axis=0)
    return int(np.argmax(np.all(held >= 1 - LOST - 1e-9, axis=1)))


@lru_cache(maxsize=16)
def _taper(shape: tuple[int, int], grid: tuple[int, int], margin: int) -> Floats:
    sides = []
    for n, total in zip(shape, grid, strict=True):
        inner = n - 2 * margin
        rise = max(int(EDGE * inner), 1)
        ramp = np.sin(0.5 * np.pi * (np.arange(rise) + 0.5) / rise) ** 2
        side = np.zeros(total)
        side[margin : margin + inner] = 1.0
        side[margin : margin + rise] = ramp
        side[margin + inner - rise : margin + inner] = ramp[::-1]
        sides.append(side)
    return np.outer(*sides).astype(np.float32)
