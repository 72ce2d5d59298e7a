"""The Cramer-Rao bound: how near any method can come to the distance of a patch, from the model of `psflut.evidence`.

Three scenes are told apart (`psflut.information` has the formulas):

- ``unknown``: texture, of which only the prior on its power spectrum is known; what one image can tell.
- ``known``: the ideal image itself is known.
- ``point``: a lone point in the middle of the patch; its light, its place and the background are not known.

Scenes are drawn from the prior and given the same contrast. The bound is the root of the mean over scenes of
1 / information: the root mean square error, over many scenes, of a method that is efficient with each. (The van Trees
bound, which averages the information instead, is lower, and out of reach where scenes differ much: by 2 times at 3 m
on lab16mm.) The table is taken as free of errors and the distance as free of a prior; what a prior over the table's
span adds is `Limits.within`.

It is a local bound: where it changes much within its own width no method can reach it. At 4.1 m on lab16mm it is 2.7 %,
and three times that 0.3 m further; scenes of the model itself are read with 4.8 %, biased to the far side.

Scenes are stationary Gaussian fields here. Photographs are not: their powers scatter more
(`TexturePrior.roughness`). ``prior=texture.learnt().over(texture.SECTORS)`` has this counted.
"""

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from psflut import ensemble, information, texture
from psflut.capture import setup_of
from psflut.ensemble import Sensor
from psflut.errors import PsflutError
from psflut.imagers import Imager
from psflut.noise import LEAST, MOST, Noise
from psflut.table import Kind, PSFTable

Floats = NDArray[np.float64]
Scene = Literal["unknown", "known", "point"]

GOOD = 0.05
"""Standard error up to which a range is good: of the distance, or on a stage axis of the span. Beyond it is blind."""

COUNT = 101
"""Positions that are looked at, even in the table's coordinate."""

NORMALISED_CONTRAST = 0.04
"""Of an ideal image that is scaled to [0, 1] by its own minimum and maximum: the median of 24 photographs (kodak shrunk
two-fold, 256 pixels, Laplacian); all but two lie between 0.025 and 0.082."""


@dataclass(frozen=True, eq=False)
class Limits:
    """The bound along a table.

    Parameters
    ----------
    axis : (M,) array
        Positions, metres, ascending.
    crb : (M,) array
        Root of the Cramer-Rao bound at each, metres; infinite where nothing tells the distance.
    within : (M,) array
        The same where the distance is known to lie within the table's span, metres: the variance of a flat prior there
        counts as information that any method has.
    kind : "distance" or "stage"
        What the axis is.
    scene : "unknown", "known" or "point"
    contrast : float
        Standard deviation of the ideal image of the prior's median scene over 128 pixels, without what is slower than
        50; of a point, its brightest pixel at the sharpest position. Image units.
    """

    axis: Floats
    crb: Floats
    within: Floats
    kind: Kind
    scene: Scene
    contrast: float

    @property
    def relative(self) -> Floats:
        """(M,) `crb` in units of the distance, or on a stage axis of the span."""
        return np.asarray(self.crb / (self.axis if self.kind == "distance" else np.ptp(self.axis)))

    @property
    def good(self) -> list[tuple[float, float]]:
        """Ranges (first, last) in metres in which the bound is at most `GOOD`."""
        return runs(self.axis, self.relative <= GOOD)

    @property
    def blind(self) -> list[tuple[float, float]]:
        """Ranges (first, last) in metres in which it is more."""
        return runs(self.axis, ~(self.relative <= GOOD))


def bound(
    table: PSFTable,
    shape: tuple[int, int],
    noise: Noise,
    imager: Imager,
    *,
    scene: Scene = "unknown",
    contrast: float | None = None,
    prior: texture.TexturePrior | None = None,
    relative: bool = False,
) -> Limits:
    """The Cramer-Rao bound on distance along a table, for patches of that shape.

    Parameters
    ----------
    table : PSFTable
    shape : (H, W)
        Of the patch, in pixels, not smaller than the table's PSFs.
    noise : Noise
    imager : Imager
    scene : "unknown", "known" or "point"
    contrast : float or None
        See `Limits`. None: that of the prior's mean spectrum; `NORMALISED_CONTRAST` where the set-up behind the table
        normalises; 1, full scale, for a point.
    prior : TexturePrior or None
        None: the learnt one, of unknown scenes over sectors, with scenes as stationary Gaussian fields. One for whole
        annuli gives the bound of methods that read these.
    relative : bool
        Whether ``noise.read ** 2`` is in units of the noiseless capture's variance (the thesis' second reading).

    Raises
    ------
    PsflutError
        For a patch smaller than the PSF, an unknown scene, or a contrast that is not positive.
    """
    if scene not in get_args(Scene):
        raise PsflutError(f"the scene is one of {', '.join(get_args(Scene))}, got {scene!r}")
    if min(shape) < table.size:
        held = f"{shape[0]} x {shape[1]} pixels"
        raise PsflutError(f"a patch of {held} is smaller than the table's PSF ({table.size}); take a larger one")
    if contrast is not None and not LEAST < contrast < MOST:
        raise PsflutError(
            f"contrast must be positive, from {LEAST:g} to {MOST:g}, got {contrast}; image units run from 0 to 1"
        )
    sensor = Sensor(imager, noise, relative)
    if scene == "point":
        contrast = contrast or 1.0
        told = information.of_point(table, shape, sensor, contrast, COUNT)
    else:
        if contrast is None and setup_of(table).normalise:
            contrast = NORMALISED_CONTRAST
        sectors = texture.SECTORS if scene == "unknown" else 1
        prior = prior or replace(texture.learnt().over(sectors), roughness=0.0)
        median = ensemble.contrast(prior, imager)
        contrast = contrast or median
        scenes = ensemble.textures(table, shape, imager, prior, contrast / median, COUNT)
        known = scene == "known"
        told = information.of_known_scene(scenes, sensor) if known else information.of_texture(scenes, sensor)
    return _limits(table, told, scene, contrast)


def _limits(table: PSFTable, told: Floats, scene: Scene, contrast: float) -> Limits:
    """Of information (M, D) in the even coordinate; de = dz / z^2 for a distance z."""
    axis = table.candidates(len(told))
    chain = axis**2 if table.kind == "distance" else np.ones_like(axis)
    flat = 12.0 / np.ptp(table.even(axis)) ** 2
    with np.errstate(divide="ignore"):
        crb = chain * np.sqrt(np.mean(1.0 / told, axis=1))
    within = chain * np.sqrt(np.mean(1.0 / (told + flat), axis=1))
    return Limits(axis, crb, within, table.kind, scene, contrast)


def runs(positions: Floats, which: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """(first, last) of every unbroken run; runs meet half way between two positions."""
    cuts = np.r_[0, np.flatnonzero(np.diff(which)) + 1, len(which)]
    borders = np.r_[positions[0], 0.5 * (positions[cuts[1:-1] - 1] + positions[cuts[1:-1]]), positions[-1]]
    return [(float(borders[n]), float(borders[n + 1])) for n in range(len(cuts) - 1) if which[cuts[n]]]
