"""The door: an observation is checked once, here, and what is behind it may rely on that."""

from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from psflut import family
from psflut.errors import PsflutError
from psflut.imagers import Imager
from psflut.noise import Noise, estimate_noise
from psflut.problem import Observation, Problem
from psflut.table import PSFTable

Floats = NDArray[np.float64]

NEGATIVE_SIGMAS = 6.0
"""A plain image may fall below zero by so many noise sigma, and no further."""


class Method(Protocol):
    """What the door asks of an estimator: what it can use beside the patch."""

    uses_scene: ClassVar[bool]
    uses_second: ClassVar[bool]


def door(observation: Observation, table: PSFTable, method: Method, level: float) -> Problem:
    """The problem that an observation is.

    Parameters
    ----------
    level : float
        Probability of the interval.

    Raises
    ------
    PsflutError
        For a patch that is smaller than the table's PSF, not finite, or negative though the imager is not signed; for
        a known scene or second image that the method does not use; for a level that is no probability.
    """
    check_level(level)
    image = _sound(observation.image, table.size)
    imager = family.parse("psflut.imagers", observation.imager or table.imager)
    source, noise = _noise(observation, table, image)
    if not imager.signed and image.min() < -NEGATIVE_SIGMAS * noise.read and not _is_normalised(table):
        raise PsflutError(
            f"the patch falls to {image.min():.3g}, but a plain image is not negative; "
            "check its offset, or name its imager"
        )
    known, second = _known(observation, method), _second(observation, imager, method, level)
    return Problem(image, table, imager, noise, source, level, known, second)


def check_level(level: float) -> None:
    """Refuse what is no probability."""
    if not 0 < level < 1:
        raise PsflutError(f"level is a probability between 0 and 1, got {level}; 0.95 is usual")


def _sound(image: NDArray[Any], least: int) -> Floats:
    """The patch in double precision, once it is seen to be real, finite and large enough."""
    image = np.asarray(image)
    if image.ndim != 2 or not (np.isrealobj(image) and np.issubdtype(image.dtype, np.number)):
        raise PsflutError(f"a patch is a real (H, W) array, got {image.dtype} of shape {image.shape}; give one channel")
    if min(image.shape) < least:
        raise PsflutError(
            f"the patch of {image.shape[0]} x {image.shape[1]} pixels is smaller than the table's PSF ({least}); "
            "take a larger patch"
        )
    if not np.all(np.isfinite(image)):
        raise PsflutError("the patch holds values that are not finite; mask or replace them")
    return image.astype(np.float64)


def _noise(observation: Observation, table: PSFTable, image: Floats) -> tuple[str, Noise]:
    """Where the noise comes from, and the noise: given, else the table's, else estimated from the image."""
    if observation.noise is not None:
        return "given", observation.noise
    if table.noise is not None:
        return "table", table.noise
    return "image", estimate_noise(image, observation.quantum)


def _is_normalised(table: PSFTable) -> bool:
    """Whether the set-up behind the table scales its captures, so that zero means nothing."""
    return bool(table.provenance.get("capture", {}).get("normalise", False))


def _known(observation: Observation, method: Method) -> Floats | None:
    if observation.scene is None:
        return None
    scene = np.asarray(observation.scene, dtype=np.float64)
    if not method.uses_scene:
        raise PsflutError(f"{family.describe(method)} does not use a known scene; leave the scene out")
    if scene.shape != np.shape(observation.image) or not np.all(np.isfinite(scene)):
        raise PsflutError(
            f"the known scene must be finite and of the patch's shape {np.shape(observation.image)}, got {scene.shape}"
        )
    return scene


def _second(observation: Observation, imager: Imager, method: Method, level: float) -> Problem | None:
    if observation.second is None:
        return None
    if not method.uses_second:
        raise PsflutError(f"{family.describe(method)} does not use a second image; leave it out or name two_image")
    second = door(*observation.second, method, level)
    if second.shape != np.shape(observation.image) or second.imager != imager:
        raise PsflutError(
            "both images must show the same patch through one imager, got "
            f"{np.shape(observation.image)} through {family.describe(imager)} and {second.shape} through "
            f"{family.describe(second.imager)}; crop and filter them alike"
        )
    return second
