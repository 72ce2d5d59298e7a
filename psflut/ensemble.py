"""Scenes drawn from a texture prior, as patches of a shape show them: bounds (`psflut.limits`) average over them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from psflut import evidence, fourier
from psflut.covariance import covariance
from psflut.imagers import Imager
from psflut.noise import Noise
from psflut.spectrum import Annuli, annuli
from psflut.table import PSFTable
from psflut.texture import TexturePrior, basis

Floats = NDArray[np.float64]

LEVEL = 0.5
"""Mean signal of a textured patch, on which photon noise depends; full scale is 1."""

DRAWS, SEED = 200, 0
"""Of scenes from the prior."""

SPARSE = 2
"""Steps between positions at which the information of textures is worked out: it changes as zeros of the transfer
function move, by a quarter of an annulus in so many."""

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

    @property
    def places(self) -> NDArray[np.intp]:
        """(m,) of the positions every `SPARSE`th, and the last."""
        return np.unique(np.r_[0 : len(self.bank.even) : SPARSE, len(self.bank.even) - 1])

    def scatter(self, sensor: Sensor) -> Floats:
        """(m, K, K) relative covariance of the powers, of captures of the typical scene, at `places`."""
        rings, prior = self.bank.rings, self.bank.prior
        frequency = np.maximum(fourier.frequency(rings.doubled), rings.frequency.min())
        coefficients = prior.basis(frequency.ravel(), fourier.direction(rings.doubled).ravel())
        response = sensor.imager.transfer(rings.doubled) ** 2
        scene = np.exp(coefficients @ self.typical).reshape(response.shape) * response
        own = np.exp(self.bank.basis @ self.typical)
        found = []
        for position in self.places:
            power = self.table.power(rings.doubled, self.table.position(self.bank.even[position]))
            noise = sensor.power(response, LEVEL, self._variances(own[None], position))
            found.append(covariance(rings, scene * power + noise))
        return np.array(found)

    def _variances(self, spectra: Floats, position: int) -> Floats:
        """(D,) variances of the captures of spectra (D, K)."""
        return _variance(spectra * self.bank.attenuation[position], self.bank.rings)


def textures(
    table: PSFTable, shape: tuple[int, int], imager: Imager, prior: TexturePrior, gain: float, count: int
) -> Textures:
    """Scenes for `count` positions over the table, their contrast the prior's median times a gain."""
    bank = evidence.bank(table, shape, imager, prior, count, prior.sectors)
    theta = np.random.default_rng(SEED).multivariate_normal(prior.mean, prior.covariance, size=DRAWS)
    theta[:, 0] = prior.mean[0] + 2.0 * np.log(gain)
    typical = np.append(theta[0, 0], prior.mean[1:])
    return Textures(bank, shape, table, np.exp(theta @ bank.basis.T), typical)


def contrast(prior: TexturePrior, imager: Imager) -> float:
    """Standard deviation of the ideal image with the prior's mean spectrum, what is slower than `SLOWEST` left out."""
    rings, shape = annuli(REFERENCE), REFERENCE
    spectrum = np.exp(basis(rings.frequency, prior.terms) @ prior.mean[: prior.terms])
    return float(np.sqrt(_variance(spectrum * rings.mean(imager.transfer(shape) ** 2), rings)))


def _variance(power: Floats, rings: Annuli) -> Floats:
    """Variance of a patch from its power spectrum (..., K), what is slower than `SLOWEST` left out: (...)."""
    fast = rings.frequency > SLOWEST
    return np.asarray(np.average(power[..., fast], axis=-1, weights=rings.effective[fast]))
