"""A known picture: registered in the frame, then the PSF that blurred it by regularised least squares."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, reduce
from operator import add
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib import known_scene, registration
from calib.alignment import PER, Aligned, align, overlap
from calib.noise_target import NoiseTarget
from calib.polar import Polar
from calib.targets import Measurement, Shot, Target
from psflut import lines
from psflut.errors import PsflutError
from psflut.imagers import Imager
from psflut.images import read_image
from psflut.units import format_length

Floats = NDArray[np.float64]

GRAIN = {False: 1.5, True: 4.0}
"""Sigma, pixels, of the smoothing before the picture is looked for: a signed imager shows mostly noise."""

CLIPPED = 0.05
"""Share of saturated pixels above which a frame is not used."""

CORE = 2.5
"""Radius within which the rings are finest, in sigmas of the spread and beyond 1.5 pixels."""


@dataclass(frozen=True)
class Pattern(Target):
    """A known picture, every pixel of which tells of the PSF: no points or edges are needed.

    A frame shows g = light * (L * h * f) + background, where f is the reference where a map puts it, and light and
    background vary slowly (quadratically). The map, the light and a rough symmetric h are fitted in turn, so that a
    symmetric blur does not bias the map (`calib.alignment`); h then is rings times waves (`calib.polar`) whose
    smoothness the data choose (`calib.known_scene`).

    The reference is the noise target that `psflut target` prints, found by its discs at any size, turn and tilt. Its
    edges are known far more finely than a pixel, so that a PSF of a pixel or two comes out as well.

    Or it is a sharp frame of the same scene by the same camera: in focus, or stopped down; the map then is affine and
    changes the size by some per cent, and the direction by some degrees. Such a reference holds one
    integration over a pixel, as the frame does; the PSF is given with its own. Where the reference is blurred, the PSF
    is what must be added to that blur; where it is noisy, or holds detail finer than its pixels, the PSF comes
    out too wide and the standard errors too small near focus (an errors-in-variables problem).

    Standard errors count the noise, what the smoothness hides, and what is left open of light and map.

    Assumed: the same PSF all over the part of the frame that is used; no waves around the centre above `order`; white
    noise.

    Measured on the page at its true size through an f/2 lens, 20 distances of 0.6 to 9.5 pixels of blur radius, two
    12-bit frames each: summed |error| 0.007 to 0.023, mean 0.011, and errors 1.1 times the stated ones.

    By a sharp frame: 0.03 down to a radius of 4 pixels, 0.05 to 0.07 at 3.4 to 2, 0.08 at 1.1, with errors 0.4 to 1.4
    (once 0.1) times the stated ones; at 0.6 pixels 0.27 and 2.7 times, so of no use. There, with the scene known five
    times as finely in its place, 0.08 and 1.0 times; with a frame free of noise, still 0.26: what folds at the
    reference's pixels is the limit, not noise nor smoothness. Leaving out all beyond 0.25, 0.3, 0.35 or 0.4 cycles a
    pixel, where it folds, made it 0.44 to 0.51 instead of 0.33, without waves. So near focus take the page.

    Parameters
    ----------
    reference : str
        File of the sharp frame, or the name of a printed target: noise:A4:0.
    gamma, srgb : float, bool
        Its encoding (`psflut.images.linearise`).
    order : int
        Finest wave of the PSF around its centre.
    side : int
        Longest side of the part of a frame that is used, pixels.
    least_side : int
        Shortest side of that part.
    error : float
        Largest root of energy of the standard errors, in units of that of the PSF.
    """

    reference: str = ""
    gamma: float = 1.0
    srgb: bool = False
    order: int = 2
    side: int = 256
    least_side: int = 48
    error: float = 0.5

    def measure(self, shots: Sequence[Shot], size: int, imager: Imager) -> Measurement:
        """See `Target`."""
        self.picture()
        found, rejected = [], []
        for shot in shots:
            try:
                found.append(self._align(shot, size, imager))
            except PsflutError as reason:
                rejected.append(f"{shot.name}: {reason}")
        if not found:
            raise PsflutError(f"no frame can be used at {format_length(shots[0].position)}: {rejected[0]}")
        psf, std = _solve(found, size, self.order)
        error = np.sqrt(np.sum(std**2) / np.sum(psf**2))
        if not error <= self.error:
            raise PsflutError(
                f"the PSF at {format_length(shots[0].position)} would be uncertain by {100 * error:.0f} %, as the "
                "reference is seen with too little contrast; take more light or more frames"
            )
        return Measurement(psf, std, len(found), tuple(rejected))

    @property
    def files(self) -> tuple[Path, ...]:
        """See `Target`."""
        return (Path(self.reference),) if self.reference and self.printed is None else ()

    @property
    def printed(self) -> NoiseTarget | None:
        """The printed target that the reference names, if it does."""
        return NoiseTarget.parse(self.reference) if self.reference.split(":")[0] == "noise" else None

    def picture(self) -> Floats:
        """The reference, read once.

        Raises
        ------
        PsflutError
            If there is none, it cannot be read, or is saturated.
        """
        if not self.reference:
            raise PsflutError("a pattern needs a reference; pass --reference with a sharp frame, or noise:A4:0")
        if self.printed:
            return _drawn(self.printed)
        return _read(self.reference, self.gamma, self.srgb)

    def _align(self, shot: Shot, size: int, imager: Imager) -> Aligned:
        """The part of a shot that shows the picture, and the picture where it lies there."""
        saturated = np.isnan(shot.image)
        frame = np.where(saturated, np.nanmax(shot.image), shot.image)
        picture = self.picture()
        if self.printed:
            matrix = self.printed.find(lines.picture_behind(frame, imager))
            picture = registration.pixel_mean(picture, matrix, ((frame.shape[0] - 1) / 2, (frame.shape[1] - 1) / 2))
        else:
            matrix = registration.coarse(frame, np.asarray(imager.response(picture), float), GRAIN[imager.signed])
        rows, columns = overlap(frame.shape, picture.shape, matrix, size, self.side, self.least_side)
        if saturated[rows, columns].mean() > CLIPPED:
            raise PsflutError(f"is saturated in {100 * saturated[rows, columns].mean():.0f} % of its pixels")
        matrix = matrix @ np.array([[1.0, 0.0, columns.start], [0.0, 1.0, rows.start], [0.0, 0.0, 1.0]])
        return align(shot.image[rows, columns], picture, matrix, size, imager, self.printed is not None)


@lru_cache(1)
def _drawn(printed: NoiseTarget) -> Floats:
    return printed.picture()


@lru_cache(1)
def _read(reference: str, gamma: float, srgb: bool) -> Floats:
    read = read_image(Path(reference), gamma, srgb)
    if read.saturated is not None and read.saturated.mean() > CLIPPED:
        raise PsflutError(
            f"the reference {reference} is saturated in {100 * read.saturated.mean():.0f} % of its pixels; take it "
            "darker, or give a printed target by its name, noise:A4:0 say"
        )
    return read.image


def _solve(found: Sequence[Aligned], size: int, order: int) -> tuple[Floats, Floats]:
    """The PSF and its standard error, (size, size), from all frames together."""
    sigma = max(each.sigma for each in found)
    basis = Polar.graded(min(size / 2.0, CORE * sigma + 1.5), size / 2.0, order)
    planes = basis.planes(size, PER)
    equations = [
        known_scene.normal(known_scene.shown(each.scene, planes, each.frame.shape, size, PER), each.frame, each.free)
        for each in found
    ]
    return known_scene.solve(reduce(add, equations), basis).psf(basis.planes(size, 1))
