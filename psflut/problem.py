"""What an estimator is asked: an observation as it comes, and the problem that it is behind the door."""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from psflut.imagers import Imager
from psflut.noise import Noise
from psflut.spectrum import Annuli, annular_power, annuli
from psflut.table import PSFTable

Floats = NDArray[np.float64]

TEXTURE_SIGMAS = 3.0
"""A patch is FLAT unless its power exceeds the noise's by so many of its standard deviations."""

SATURATED_SHARE = 0.005
"""Share of pixels at exactly full scale from which a patch is SATURATED."""


@dataclass(frozen=True, eq=False)
class Observation:
    """A patch and what is known of how it was taken.

    Parameters
    ----------
    image : (H, W) array
        Linear intensity, full scale 1; signed where the imager is.
    noise : Noise or None
        None: the table's, else an estimate from the image.
    imager : str or None
        As `family.parse` reads it; None: the table's.
    scene : (H, W) array or None
        The ideal image where it is known: what the imager would record without blur and noise.
    quantum : float
        Step between levels of the image, image units, 0 if unknown; bounds an estimated noise from below.
    second : (Observation, PSFTable) or None
        The same patch taken with another setting of the camera, and that setting's table.
    """

    image: NDArray[np.floating]
    noise: Noise | None = None
    imager: str | None = None
    scene: NDArray[np.floating] | None = None
    quantum: float = 0.0
    second: "tuple[Observation, PSFTable] | None" = None


@dataclass(frozen=True, eq=False)
class Problem:
    """An observation after the door: complete and checked. What an estimator solves.

    Parameters
    ----------
    image, scene : (H, W) float64 arrays
    table, imager, noise : PSFTable, Imager, Noise
    noise_source : "given", "table" or "image"
    level : float
        Of the interval.
    second : Problem or None
        The second image, of the same shape and imager.
    """

    image: NDArray[np.floating]
    table: PSFTable
    imager: Imager
    noise: Noise
    noise_source: str
    level: float
    scene: NDArray[np.floating] | None = None
    second: "Problem | None" = None

    @property
    def shape(self) -> tuple[int, int]:
        """Of the patch, in pixels."""
        return self.image.shape[0], self.image.shape[1]

    @cached_property
    def power(self) -> Floats:
        """(K,) mean power of the patch in each annulus, image units squared."""
        return annular_power(self.image)

    def powers(self, rings: Annuli) -> Floats:
        """(K,) the same by other annuli."""
        return self.power if rings.sectors == 1 else rings.power(self.image)

    @property
    def mean_level(self) -> float:
        """Mean signal before the imager, on which photon noise depends."""
        return float(mean_level(self.image, self.imager))

    @property
    def is_flat(self) -> bool:
        """Whether the patch's power is what its noise alone would have."""
        return bool(is_flat(self.power, self.noise, self.mean_level, self.imager, self.shape))

    @property
    def is_saturated(self) -> bool:
        """Whether too many pixels are at exactly full scale."""
        return bool(is_saturated(self.image))


def mean_level(images: NDArray[np.floating], imager: Imager) -> Floats:
    """(...) mean signal of patches (..., H, W) before the imager; half of full scale where the imager hides it."""
    return np.full(images.shape[:-2], 0.5) if imager.signed else np.asarray(images.mean(axis=(-2, -1)), dtype=float)


def is_flat(power: Floats, noise: Noise, level: ArrayLike, imager: Imager, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """(...) whether patches of that power (..., K) and mean level (...) show no more than their noise.

    Noise of known power has, over all annuli, sum n_k (P_k / N_k - 1) of mean zero and variance sum n_k.
    """
    rings = annuli(shape)
    floor = noise.power(_response(imager, shape), level, rings.white)
    excess = np.sum(rings.effective * (power / floor - 1), axis=-1)
    return np.asarray(excess < TEXTURE_SIGMAS * np.sqrt(rings.effective.sum()))


def is_saturated(images: NDArray[np.floating]) -> NDArray[np.bool_]:
    """(...) whether too many pixels of patches (..., H, W) are at exactly full scale."""
    return np.asarray(np.mean(images == 1.0, axis=(-2, -1)) >= SATURATED_SHARE)


@lru_cache(maxsize=8)
def _response(imager: Imager, shape: tuple[int, int]) -> Floats:
    """(K,) |L|^2 by annulus."""
    rings = annuli(shape)
    return rings.leaked(imager.transfer(rings.doubled) ** 2)
