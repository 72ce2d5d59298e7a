"""A known picture: registered in the frame, then the PSF that blurred it by regularised least squares."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, reduce
from operator import add
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, signal

from calib import known_scene, registration
from calib.polar import Polar
from calib.targets import Measurement, Shot, Target
from psflut.errors import PsflutError
from psflut.imagers import Imager
from psflut.images import read_image

Floats = NDArray[np.float64]

PER = 3
"""Samples a pixel, each way, at which the picture is blurred in the end; registration takes one."""

ROUGH_RINGS = 12
"""Of the symmetric PSF with which the picture is registered."""

ROUNDS, STILL = 10, 0.01
"""Of registration and blur in turn; and the movement of a corner, pixels, at which they end."""

GRAIN = {False: 1.5, True: 4.0}
"""Sigma, pixels, of the smoothing before the picture is looked for: a signed imager shows mostly noise."""

CLIPPED = 0.05
"""Share of saturated pixels above which a frame is not used."""


@dataclass(frozen=True)
class Pattern(Target):
    """A known picture, every pixel of which tells of the PSF: no points or edges are needed.

    A frame shows g = light * (L * h * f) + background, where f is the reference where an affine map puts it
    (`calib.registration`), and light and background vary slowly (quadratically). The map, the light and a rough
    symmetric h are fitted in turn, so that a symmetric blur does not bias the map; h then is rings times waves
    (`calib.polar`) whose smoothness the data choose (`calib.known_scene`).

    The reference is a sharp frame of the same scene by the same camera: in focus, or stopped down. It holds one
    integration over a pixel, as the frame does; the PSF is given with its own. Where the reference is blurred, the PSF
    is what must be added to that blur; where it is noisy, or holds detail finer than its pixels, the PSF comes
    out too wide and the standard errors too small (an errors-in-variables problem).

    Assumed: the same PSF all over the part of the frame that is used; no light beyond 3 sigma + 2 pixels of the
    spread; no waves around the centre above `order`; white noise.

    Parameters
    ----------
    reference : str
        File of the sharp frame.
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
        picture = self.picture()
        found, rejected = [], []
        for shot in shots:
            try:
                found.append(self._register(shot, picture, size, imager))
            except PsflutError as reason:
                rejected.append(f"{shot.name}: {reason}")
        if not found:
            raise PsflutError(f"no frame can be used at {shots[0].position} m: {rejected[0]}")
        psf, std = _solve(found, size, self.order)
        error = np.sqrt(np.sum(std**2) / np.sum(psf**2))
        if not error <= self.error:
            raise PsflutError(
                f"the PSF at {shots[0].position} m would be uncertain by {100 * error:.0f} %, as the reference is seen "
                "with too little contrast; take more light or more frames"
            )
        return Measurement(psf, std, len(found), tuple(rejected))

    def picture(self) -> Floats:
        """The reference, read once.

        Raises
        ------
        PsflutError
            If there is none, it cannot be read, or is saturated.
        """
        if not self.reference:
            raise PsflutError("the pattern target needs a reference; pass --reference with a sharp frame of the scene")
        return _read(self.reference, self.gamma, self.srgb)

    def _register(self, shot: Shot, picture: Floats, size: int, imager: Imager) -> "_Registered":
        """The part of a shot that shows the picture, and the picture where it lies there."""
        saturated = np.isnan(shot.image)
        frame = np.where(saturated, np.nanmax(shot.image), shot.image)
        matrix = registration.coarse(frame, np.asarray(imager.response(picture), float), GRAIN[imager.signed])
        rows, columns = _window(shot.image.shape, picture, matrix, size, self.side, self.least_side)
        if saturated[rows, columns].mean() > CLIPPED:
            raise PsflutError(f"is saturated in {100 * saturated[rows, columns].mean():.0f} % of its pixels")
        matrix = matrix @ np.array([[1.0, 0.0, columns.start], [0.0, 1.0, rows.start], [0.0, 0.0, 1.0]])
        return _refine(shot.image[rows, columns], picture, matrix, size, imager)


@dataclass(frozen=True, eq=False)
class _Registered:
    """An evened frame (H, W), the picture on its finer places, and sigma of the spread (pixels)."""

    frame: Floats
    scene: Floats
    sigma: float
    matrix: Floats


@lru_cache(1)
def _read(reference: str, gamma: float, srgb: bool) -> Floats:
    read = read_image(Path(reference), gamma, srgb)
    if read.saturated is not None and read.saturated.mean() > CLIPPED:
        raise PsflutError(
            f"the reference {reference} is saturated in {100 * read.saturated.mean():.0f} % of its pixels"
        )
    return read.image


def _window(
    shape: tuple[int, ...], picture: Floats, matrix: Floats, size: int, most: int, least: int
) -> tuple[slice, slice]:
    """The largest part of a frame, up to `most` a side, that the picture covers with half a PSF around it."""
    y, x = (np.arange(n, dtype=float) for n in shape)
    covered = ndimage.binary_erosion(registration.covered(picture, matrix, y, x), np.ones((3, 3)), size // 2)
    if covered.any():
        middle = np.argwhere(covered).mean(axis=0)
        reach = np.ptp(np.argwhere(covered), axis=0) / 2.0
        for share in np.linspace(1.0, 0.1, 37):
            half = np.minimum(share * reach, most / 2.0)
            low, high = np.ceil(middle - half).astype(int), np.floor(middle + half).astype(int) + 1
            if min(high - low) >= least and covered[low[0] : high[0], low[1] : high[1]].all():
                return slice(low[0], high[0]), slice(low[1], high[1])
    raise PsflutError(f"shows less than {least} pixels a side of the reference with {size // 2} pixels around them")


def _refine(frame: Floats, picture: Floats, matrix: Floats, size: int, imager: Imager) -> _Registered:
    """Map, light and a rough PSF in turn, until the map stands still."""
    shape, half = frame.shape, max(frame.shape) / 2.0
    y, x = known_scene.places(shape, size, 1)
    middle = ((shape[0] - 1) / 2.0, (shape[1] - 1) / 2.0)
    unit = np.array([[half, 0.0, middle[1]], [0.0, half, middle[0]], [0.0, 0.0, 1.0]])
    v, u = (np.arange(shape[0])[:, None] - middle[0]) / half, (np.arange(shape[1]) - middle[1]) / half
    slow = np.array([np.broadcast_to(each, shape) for each in (1.0, v, u, v * v, v * u, u * u)])
    rough = Polar(ROUGH_RINGS, size / 2.0 / ROUGH_RINGS, 0)
    planes, kernel = rough.planes(size, 1), imager.kernel()
    used = np.isfinite(frame)
    even = frame
    for _ in range(ROUNDS):
        scene = registration.sample(picture, matrix, y, x)
        scene = _filtered(scene, kernel)
        columns = known_scene.shown(scene, planes, shape, size, 1)
        fit = known_scene.solve(known_scene.normal(columns, even, slow), rough)
        model = np.tensordot(fit.coefficients, columns, 1)
        plane = np.tensordot(fit.coefficients, planes, 1)
        uneven = slow[:1] if imager.signed else slow
        free = np.concatenate([uneven * model, slow])
        parts = np.linalg.lstsq(free[:, used].T, frame[used], rcond=None)[0]
        light, ground = (
            np.tensordot(a, b, 1) for a, b in zip(np.split(parts, [len(uneven)]), (uneven, slow), strict=True)
        )
        if not light.min() > 0:
            raise PsflutError("does not match the reference where it seemed to show it")
        coordinates = (y - middle[0]) / half, (x - middle[1]) / half
        moved = _each(registration.slopes(scene, *coordinates, False), plane, shape, size)
        change = registration.refine(frame, moved, free)
        matrix = matrix @ unit @ registration.step(change, False) @ np.linalg.inv(unit)
        matrix /= matrix[2, 2]
        even = (frame - ground) / light
        if half * np.abs(change).max() < STILL:
            break
    known = ndimage.binary_erosion(registration.covered(picture, matrix, y, x), np.ones((3, 3)), size // 2)
    start = size // 2
    even = np.where(known[start : known.shape[0] - start, start : known.shape[1] - start], even, np.nan)
    if np.isfinite(even).mean() < 0.7:
        raise PsflutError("leaves the reference while it is registered; let the reference show more around it")
    heights = np.maximum(fit.coefficients, 0.0)
    radius = rough.width * np.arange(rough.count)
    sigma = np.sqrt(0.5 * np.sum(heights * radius**3) / np.sum(heights * np.maximum(radius, 0.25)))
    scene = registration.sample(picture, matrix, *known_scene.places(shape, size, PER))
    spaced = np.zeros([PER * (n - 1) + 1 for n in kernel.shape])
    spaced[::PER, ::PER] = kernel
    return _Registered(even, _filtered(scene, spaced), float(sigma), matrix)


def _each(scenes: Floats, plane: Floats, shape: tuple[int, int], size: int) -> Floats:
    """Several pictures through one PSF."""
    return np.concatenate([known_scene.shown(scene, plane[None], shape, size, 1) for scene in scenes])


def _filtered(scene: Floats, kernel: Floats) -> Floats:
    """The picture through an imager."""
    if kernel.size == 1:
        return scene
    return np.asarray(signal.oaconvolve(np.pad(scene, len(kernel) // 2, mode="edge"), kernel, mode="valid"))


def _solve(found: Sequence[_Registered], size: int, order: int) -> tuple[Floats, Floats]:
    """The PSF and its standard error, (size, size), from all frames together."""
    reach = min(size / 2.0, 3.0 * max(each.sigma for each in found) + 2.0)
    width = float(np.clip(reach / 32.0, 0.15, 0.5))
    basis = Polar(int(reach / width), width, order)
    planes = basis.planes(size, PER)
    equations = [
        known_scene.normal(
            known_scene.shown(each.scene, planes, each.frame.shape, size, PER),
            each.frame,
            np.ones((1, *each.frame.shape)),
        )
        for each in found
    ]
    return known_scene.solve(reduce(add, equations), basis).psf(basis.planes(size, 1))
