"""Distance from two images of one scene, or from one image of a known scene."""

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np

from psflut.errors import PsflutError
from psflut.estimation import AbstractEstimator, Curve, Estimate, Problem, conclude, nothing_to_see
from psflut.joint import join, overlap
from psflut.noise import Noise
from psflut.table import PSFTable

SHARP = 1e-3
"""Noise of a known scene, in units of the capture's."""


@dataclass(frozen=True)
class TwoImage(AbstractEstimator):
    """Distance by comparing a patch with the same patch taken with another aperture or focus.

    Blurred by each other's PSF of the true distance the two agree, whatever the scene (`psflut.crossed`); at other
    distances the scene shows in their difference. The joint posterior (`psflut.joint`) needs no prior on scenes
    where the two settings blur differently. A small aperture serves as well as another focus; exposures may differ, and
    a shift of up to a pixel, both of which are fitted. Nothing may have moved between the two, and both must have one
    magnification, which another focus changes in many lenses.

    With a known scene the second image is that: without blur and noise.

    Compared on 72 captures of photographs, f/2 beside f/8, noise 0.005 (median error %, 95 % intervals cover, interval
    score relative to distance; a single image errs by 0.5 to 1.5 %):

    ====================================================================  =====  ====  =====
    as here                                                               0.096  97 %  0.009
    a taper that rises over a quarter of the side at either end           0.105  99 %  0.015
    a Hann taper                                                          0.187  96 %  0.159
    a Hann taper over the whole patch, borders included                   0.100  99 %  0.011
    as the second, all frequencies counted alike, drowned or not          0.132  92 %  0.074
    ====================================================================  =====  ====  =====

    ``stats`` gives the second image's ``gain`` (its exposure over the first's) and ``shift_y``, ``shift_x`` (pixels),
    and ``misfit``: power of the difference over what noise leaves, 1 where all is well; what is above widens the
    interval. The interval is what the two images' noise allows; of the tables' errors it counts placement and
    interpolation, not those of the pixels.

    Parameters
    ----------
    candidates : int
        Distances over those that both tables span, evenly in vergence; more are added where they are likely.
    """

    candidates: int = 100

    uses_scene: ClassVar[bool] = True
    uses_second: ClassVar[bool] = True
    sees_flat: ClassVar[bool] = True

    def solve(self, problem: Problem) -> Estimate:
        """See `AbstractEstimator`."""
        second = _other(problem)
        span = overlap(problem.table, second.table)
        if problem.is_flat and second.is_flat:
            return nothing_to_see(problem, span)
        if np.array_equal(problem.image, second.image):
            raise PsflutError(
                "two_image compares two captures, each with noise of its own, got one capture twice; give another one"
            )
        found = join(problem, second, self.candidates)
        down, across = map(float, found.shift)
        return conclude(
            problem,
            found.density,
            Curve(problem.table.position(found.even), found.log_evidence, "log evidence"),
            stats={"misfit": found.misfit, "gain": found.gain, "shift_y": down, "shift_x": across},
            detail={"restored": found.restored},
        )


def _other(problem: Problem) -> Problem:
    """The image to compare with: the second one, or the known scene as a camera without blur would take it."""
    if problem.second is not None and problem.scene is None:
        return problem.second
    if problem.scene is None or problem.second is not None:
        raise PsflutError(
            "two_image compares with a second image and its table, or with the known scene, got "
            f"{'neither' if problem.scene is None else 'both'}; give one of them"
        )
    noise = Noise(SHARP * problem.noise.read)
    return Problem(problem.scene, _sharp(problem.table), problem.imager, noise, "given", problem.level)


@lru_cache(maxsize=8)
def _sharp(table: PSFTable) -> PSFTable:
    """A table of the same positions that blurs nothing."""
    return PSFTable(table.axis, np.ones((len(table.axis), 1, 1)), table.pixel_pitch, table.kind)
