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
from calib.unfolding import FINER, law, unfolded
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
    is what must be added to that blur. Its noise, and what is finer than its pixels and folds there, are counted by
    `calib.unfolding`.

    Standard errors count the noise, what the smoothness hides, and what is left open of light and map.

    Assumed: the same PSF all over the part of the frame that is used; no waves around the centre above `order`; white
    noise.

    Measured on the page at its true size through an f/2 lens, 20 distances of 0.6 to 9.5 pixels of blur radius, two
    12-bit frames each: summed |error| 0.007 to 0.023, mean 0.011, and errors 1.1 times the stated ones.

    By a sharp frame, three scenes with two frames a distance, summed |error| and errors over the stated ones, with the
    frame between its pixels by splines, unfolded, and for one scene known five times as finely in its place:

    | blur radius | splines | unfolded: taken | known finely |
    |---|---|---|---|
    | 4.8 pixels | 0.043, 0.91 | 0.040, 0.83 | |
    | 2.0 | 0.107, 1.75 | 0.053, 0.97 | 0.044, 0.61 |
    | 1.1 | 0.142, 1.43 | 0.075, 1.32 | 0.051, 1.31 |
    | 0.6 | refused: uncertain by 150 to 230 % | 0.168, 1.87 | 0.046, 0.39 |

    Of no help besides: a fit whitened by the spectrum of what it leaves (0.173, 1.82 at 0.6 pixels); standard errors
    from the scatter over blocks of 8 to 64 pixels, with both frames of a distance in one block (0.7 to 1.0 times those
    stated); errors of the smoothness' weight (no change). For what is left to err is what a pixel's PSF owes to
    frequencies that the reference does not show, 0.7 to 1.2 cycles a pixel. So near focus take the page. Over the 20
    distances errors are 0.9 times the stated ones, and those of the table 1.0 times, 2 times at the last plane. (What
    the smoothness hides is not alike at neighbouring distances here: counted so, it made them 0.55.)

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
        if not self.printed:
            sides = (rows.stop - rows.start, columns.stop - columns.start)
            picture, matrix = _finer(picture, matrix, sides, size, _law(self.reference, self.gamma, self.srgb))
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


@lru_cache(1)
def _law(reference: str, gamma: float, srgb: bool) -> Floats:
    return law(_read(reference, gamma, srgb))


def _finer(picture: Floats, matrix: Floats, sides: tuple[int, int], size: int, law: Floats) -> tuple[Floats, Floats]:
    """The part of the reference that a part of a frame shows, unfolded, and the map to that."""
    ends = (np.array([-size, n + size]) for n in sides)
    at = registration.place(matrix, *np.meshgrid(*ends))
    (top, bottom), (left, right) = ((max(int(a.min()), 0), int(np.ceil(a.max())) + 1) for a in at)
    shift = np.array([[1.0, 0.0, -left], [0.0, 1.0, -top], [0.0, 0.0, 1.0]])
    return unfolded(picture[top:bottom, left:right], law), np.diag([FINER, FINER, 1.0]) @ shift @ matrix


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
