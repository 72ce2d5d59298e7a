"""Fisher's information of distance in a patch, for three kinds of scene; `psflut.limits` makes bounds of it.

Each is taken in the table's even coordinate e (vergence in 1/m, or stage in m), at M positions, with what is not known
of the scene projected out. The noise of `known` and `point` is Gaussian, its variance taken as known.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.interpolate import CubicSpline, interp1d

from psflut import evidence
from psflut.covariance import covariance
from psflut.fourier import transfer
from psflut.imagers import Imager
from psflut.noise import Noise
from psflut.spectrum import annuli
from psflut.table import PSFTable
from psflut.texture import TexturePrior, basis

Floats = NDArray[np.float64]

LEVEL = 0.5
"""Mean signal of a textured patch, on which photon noise depends; full scale is 1."""

DRAWS, SEED = 200, 0
"""Of scenes from the prior."""

SPARSE = 2
"""Steps between positions at which the covariance of annuli is worked out: it changes as zeros of the transfer function
move, by a quarter of an annulus in so many."""

REFERENCE, SLOWEST = (128, 128), 2.5 / 128
"""A patch over which contrast is meant, and frequencies (cycles a pixel) below which none is counted: the prior hardly
knows how much slower light and shade a scene has, and no blur shows in it."""


@dataclass(frozen=True)
class Sensor:
    """How a patch is recorded.

    Parameters
    ----------
    imager : Imager
    noise : Noise
    relative : bool
        Whether ``noise.read ** 2`` is in units of each noiseless capture's variance (the thesis' second reading).
    """

    imager: Imager
    noise: Noise
    relative: bool = False

    def power(
        self, response: Floats | float, level: Floats | float, variance: Floats | float, white: Floats | float = 1.0
    ) -> Floats:
        """Noise power where the imager has that squared response, of a capture of that level and variance; `white` is
        that of white noise of variance 1."""
        read = self.noise.read**2 * np.asarray(variance if self.relative else 1.0) * white
        return np.asarray(read + response * np.maximum(level, 0.0) / (self.noise.gain or np.inf))


@dataclass(frozen=True, eq=False)
class Textures:
    """Scenes drawn from a prior, as patches of a shape show them.

    Parameters
    ----------
    bank : evidence.Bank
        At the M positions.
    shape : (H, W)
    table : PSFTable
    spectra : (D, K) array
        S of every scene in each annulus.
    typical : (J,) array
        theta of the prior's mean scene, with the contrast of the others.
    """

    bank: evidence.Bank
    shape: tuple[int, int]
    table: PSFTable
    spectra: Floats
    typical: Floats

    def noise(self, sensor: Sensor, position: int) -> Floats:
        """(D, K) noise power of the captures at one of the positions."""
        variances = self._variances(self.spectra, position)[:, None]
        return sensor.power(self.bank.imager, LEVEL, variances, self.bank.white)

    def scatter(self, sensor: Sensor) -> Floats:
        """(M, K, K) relative covariance of the powers, of captures of the typical scene; of every `SPARSE`th position,
        linear between."""
        rings = annuli(self.shape)
        frequency = np.hypot(fft.fftfreq(rings.doubled[0])[:, None], fft.rfftfreq(rings.doubled[1]))
        coefficients = basis(np.maximum(frequency, rings.frequency[0]), len(self.typical))
        response = sensor.imager.transfer(rings.doubled) ** 2
        scene, own = np.exp(coefficients @ self.typical) * response, np.exp(self.bank.basis @ self.typical)
        places, found = np.unique(np.r_[0 : len(self.bank.even) : SPARSE, len(self.bank.even) - 1]), []
        for position in places:
            power = self.table.power(rings.doubled, self.table.position(self.bank.even[position]))
            noise = sensor.power(response, LEVEL, self._variances(own[None], position))
            found.append(covariance(self.shape, scene * power + noise))
        return np.asarray(interp1d(places, np.array(found), axis=0)(np.arange(len(self.bank.even))))

    def _variances(self, spectra: Floats, position: int) -> Floats:
        """(D,) variances of the captures of spectra (D, K)."""
        return _variance(spectra * self.bank.attenuation[position], self.shape)


def textures(
    table: PSFTable, shape: tuple[int, int], imager: Imager, prior: TexturePrior, gain: float, count: int
) -> Textures:
    """Scenes for `count` positions over the table, their contrast the prior's median times a gain."""
    bank = evidence.bank(table, shape, imager, prior, count)
    theta = np.random.default_rng(SEED).multivariate_normal(prior.mean, prior.covariance, size=DRAWS)
    theta[:, 0] = prior.mean[0] + 2.0 * np.log(gain)
    typical = np.append(theta[0, 0], prior.mean[1:])
    return Textures(bank, shape, table, np.exp(theta @ bank.basis.T), typical)


def contrast(prior: TexturePrior, imager: Imager) -> float:
    """Standard deviation of the ideal image with the prior's mean spectrum, what is slower than `SLOWEST` left out."""
    rings, shape = annuli(REFERENCE), REFERENCE
    spectrum = np.exp(basis(rings.frequency, len(prior.mean)) @ prior.mean)
    return float(np.sqrt(_variance(spectrum * rings.mean(imager.transfer(shape) ** 2), shape)))


def _variance(power: Floats, shape: tuple[int, int]) -> Floats:
    """Variance of a patch from its power spectrum (..., K), what is slower than `SLOWEST` left out: (...)."""
    rings = annuli(shape)
    fast = rings.frequency > SLOWEST
    return np.asarray(np.average(power[..., fast], axis=-1, weights=rings.effective[fast]))


def of_texture(scenes: Textures, sensor: Sensor) -> Floats:
    """(M, D) information of the annuli's powers, the prior on the spectrum being all that is known of a scene.

    With s_k = S_k |L|^2_k T_k / V_k and X = s [d ln T / de, P_0 .. P_J], (K, 1 + J), it is X' C^-1 X, C the relative
    covariance of the powers; the prior's precision is added to the block of the coefficients, which is projected out.
    That is the expected curvature of the log evidence, but for the correlation of neighbours that the evidence leaves
    out; powers are so nearly normal in the logarithm that what V tells by their variance is left out too.
    """
    bank, prior = scenes.bank, scenes.bank.prior
    scatter = scenes.scatter(sensor) + np.diag(prior.unevenness(annuli(scenes.shape).place))
    order = np.argsort(bank.even)
    slopes = CubicSpline(bank.even[order], bank.attenuation[order])(bank.even, 1)
    rows = []
    for position, (kept, slope, inverse) in enumerate(
        zip(bank.attenuation, slopes, np.linalg.inv(scatter), strict=True)
    ):
        noise = scenes.noise(sensor, position)
        mean = (scenes.spectra * kept + noise)[..., None]
        towards = np.column_stack([slope, kept[:, None] * bank.basis])
        change = scenes.spectra[..., None] * towards / mean
        found = change.transpose(0, 2, 1) @ (inverse @ change)
        rows.append(_projected(found, prior.precision))
    return np.array(rows)


def of_known_scene(scenes: Textures, sensor: Sensor) -> Floats:
    """(M, D) information of a patch of a scene that is known, also beyond the border: sum of S |L dH/de|^2 / N."""
    rings = annuli(scenes.shape)
    bins = np.bincount(rings.index.ravel(), _twice(scenes.shape).ravel())[:-1]
    response = sensor.imager.transfer(scenes.shape) ** 2
    rows = []
    for position, even in enumerate(scenes.bank.even):
        change = np.abs(transfer(_slope(scenes.table, even), scenes.shape)) ** 2
        told = bins * scenes.spectra * rings.mean(response * change)
        rows.append(np.sum(told * scenes.bank.white / scenes.noise(sensor, position), axis=1))
    return np.array(rows)


def of_point(table: PSFTable, shape: tuple[int, int], sensor: Sensor, peak: float, count: int) -> Floats:
    """(M, 1) information of a lone point in the middle of a dark patch: light, place and background are not known.

    Its light is such that at the sharpest of the positions its brightest pixel has that peak.
    """
    positions = table.candidates(count)
    planes = table.at(positions)
    light = peak / planes.max()
    kernel, steps = sensor.imager.kernel(), (fft.fftfreq(shape[0])[:, None], fft.rfftfreq(shape[1]))
    filtered, squared = transfer(kernel, shape).real, transfer(kernel**2, shape).real
    rows = []
    for plane, even in zip(planes, table.even(positions), strict=True):
        shown, moved = light * filtered * transfer(np.stack([plane, _slope(table, even)]), shape)
        nuisance = [shown, *(2j * np.pi * step * shown for step in steps)]
        columns = fft.irfft2(np.stack([moved, *nuisance]), s=shape).reshape(4, -1)
        columns = np.concatenate([columns, np.ones_like(columns[:1])])
        glow = fft.irfft2(squared * transfer(light * plane, shape), s=shape).ravel()
        noise = sensor.power(1.0, glow, columns[1].var())
        rows.append(_projected((columns / noise) @ columns.T, np.zeros((4, 4))))
    return np.array(rows)[:, None]


def _projected(information: Floats, prior: Floats) -> Floats:
    """What (..., 1 + J, 1 + J) tells of the first parameter once the others, with their prior's, are projected out."""
    cross = information[..., 1:, :1]
    others = np.linalg.solve(information[..., 1:, 1:] + prior, cross)
    return np.asarray(np.maximum(information[..., 0, 0] - np.sum(cross * others, axis=(-2, -1)), 0.0))


def _slope(table: PSFTable, even: float) -> Floats:
    """d PSF / d even (K, K); for a distance z = 1 / e, d/de = -z^2 d/dz."""
    position = np.clip(table.position(even), *table.span)
    chain = -(position**2) if table.kind == "distance" else 1.0
    return np.asarray(table.derivative(position) * chain)


def _twice(shape: tuple[int, int]) -> Floats:
    """How many bins of the whole plane each of the half plane stands for: 1 where the half holds its mirror, else 2."""
    column = np.arange(shape[1] // 2 + 1)
    return np.where((column == 0) | (2 * column == shape[1]), 1.0, 2.0) * np.ones((shape[0], 1))
