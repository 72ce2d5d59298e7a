"""A known picture put where a frame shows it: its map, the light on it and a rough blur are fitted in turn."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, signal

from calib import known_scene, registration
from calib.polar import Polar
from psflut.errors import PsflutError
from psflut.imagers import Imager

Floats = NDArray[np.float64]

PER = 5
"""Samples a pixel, each way, of the picture that comes out; the fits here take one."""

ROUGH_RINGS = 12
"""Of the rough PSF."""

ROUNDS, STILL = 12, 0.01
"""Of the fits at most; and the movement of a corner, pixels, at which they end."""

LEAST_KNOWN = 0.7
"""Share of the frame's part that the picture must still cover in the end."""


@dataclass(frozen=True, eq=False)
class Aligned:
    """An even part of a frame and the picture in it.

    Parameters
    ----------
    frame : (H, W) array
        With its light made even and its background taken off; NaN where it is saturated or the picture unknown.
    scene : (h, w) array
        The picture through the imager, at `known_scene.places` with PER samples a pixel.
    free : (n, H, W) array
        What may be left in that frame of the light, the background and the picture's place.
    sigma : float
        Of the spread, as a line shows it; pixels.
    matrix : (3, 3) array
        From (x, y, 1) of the frame's part to that of the picture.
    """

    frame: Floats
    scene: Floats
    free: Floats
    sigma: float
    matrix: Floats


def overlap(
    shape: tuple[int, ...], picture: tuple[int, ...], matrix: Floats, size: int, most: int, least: int
) -> tuple[slice, slice]:
    """The largest part of a frame, from `least` up to `most` a side, that a picture covers with half a PSF around it.

    Raises
    ------
    PsflutError
        If it has less than `least` pixels a side.
    """
    y, x = (np.arange(n, dtype=float) for n in shape)
    known = ndimage.binary_erosion(registration.covered(picture, matrix, y, x), np.ones((3, 3)), size // 2)
    if known.any():
        middle = np.argwhere(known).mean(axis=0)
        reach = np.ptp(np.argwhere(known), axis=0) / 2.0
        for share in np.linspace(1.0, 0.1, 37):
            half = np.minimum(share * reach, most / 2.0)
            low, high = np.ceil(middle - half).astype(int), np.floor(middle + half).astype(int) + 1
            if min(high - low) >= least and known[low[0] : high[0], low[1] : high[1]].all():
                return slice(low[0], high[0]), slice(low[1], high[1])
    raise PsflutError(f"shows less than {least} pixels a side of the reference with {size // 2} pixels around them")


def align(frame: Floats, picture: Floats, matrix: Floats, size: int, imager: Imager, projective: bool) -> Aligned:
    """Refine a map (3, 3) that is right to some pixels until no corner of the frame's part moves any more.

    Raises
    ------
    PsflutError
        If the frame does not match the picture after all, or leaves it.
    """
    shape, half = frame.shape, max(frame.shape) / 2.0
    coefficients = registration.splines(picture)
    middle = ((shape[0] - 1) / 2.0, (shape[1] - 1) / 2.0)
    y, x = known_scene.places(shape, size, 1)
    v, u = (y - middle[0]) / half, (x - middle[1]) / half
    unit = np.array([[half, 0.0, middle[1]], [0.0, half, middle[0]], [0.0, 0.0, 1.0]])
    rough, even = Polar(tuple(np.arange(ROUGH_RINGS) * size / 2.0 / ROUGH_RINGS), 0), frame
    planes, slow = rough.planes(size, 1), _slow(shape)
    for _ in range(ROUNDS):
        scene = _filtered(registration.sample(coefficients, matrix, y, x), imager.kernel())
        columns = known_scene.shown(scene, planes, shape, size, 1)
        heights = known_scene.solve(known_scene.normal(columns, even, slow), rough).coefficients
        model, plane = np.tensordot(heights, columns, 1), np.tensordot(heights, planes, 1)
        free = np.concatenate([(slow[:1] if imager.signed else slow) * model, slow])
        even = _evened(frame, free, model, slow)
        slopes = registration.slopes(scene, v, u, projective)
        moved = np.concatenate([known_scene.shown(each, plane[None], shape, size, 1) for each in slopes])
        change = registration.refine(frame, moved, free)
        matrix = matrix @ unit @ registration.step(change, projective) @ np.linalg.inv(unit)
        matrix = matrix / matrix[2, 2]
        if half * np.abs(change).max() < STILL:
            break
    known = ndimage.binary_erosion(registration.covered(picture.shape, matrix, y, x), np.ones((3, 3)), size // 2)
    even = np.where(known[size // 2 : -(size // 2), size // 2 : -(size // 2)], even, np.nan)
    if np.isfinite(even).mean() < LEAST_KNOWN:
        raise PsflutError("leaves the reference while it is registered; let the reference show more around it")
    scene = registration.sample(coefficients, matrix, *known_scene.places(shape, size, PER))
    left = np.concatenate([slow, free[1 : len(free) - len(slow)], moved])
    return Aligned(even, _filtered(scene, _spaced(imager.kernel())), left, _spread(rough, heights), matrix)


def _slow(shape: tuple[int, ...]) -> Floats:
    """Quadratic surfaces, (6, H, W)."""
    v, u = np.meshgrid(*(np.linspace(-1.0, 1.0, n) for n in shape), indexing="ij")
    return np.array([np.ones(shape), v, u, v * v, v * u, u * u])


def _evened(frame: Floats, free: Floats, model: Floats, slow: Floats) -> Floats:
    """The frame as it would be under the light and background of the picture; `free` is light * model, background."""
    used = np.isfinite(frame)
    parts = np.linalg.lstsq(free[:, used].T, frame[used], rcond=None)[0]
    light, ground = (np.tensordot(p, slow[: len(p)], 1) for p in np.split(parts, [len(parts) - len(slow)]))
    if not light.min() > 0:
        raise PsflutError("does not match the reference where it seemed to show it")
    return np.asarray((frame - ground) / light)


def _filtered(scene: Floats, kernel: Floats) -> Floats:
    """The picture through an imager."""
    if kernel.size == 1:
        return scene
    return np.asarray(signal.oaconvolve(np.pad(scene, len(kernel) // 2, mode="edge"), kernel, mode="valid"))


def _spaced(kernel: Floats) -> Floats:
    """An imager's kernel on the finer places."""
    out = np.zeros([PER * (n - 1) + 1 for n in kernel.shape])
    out[::PER, ::PER] = kernel
    return out


def _spread(rough: Polar, heights: Floats) -> float:
    """Sigma of the line that these rings show, pixels."""
    radius = np.array(rough.knots)
    light = np.maximum(heights, 0.0) * np.maximum(radius, 0.25 * radius[1])
    return float(np.sqrt(0.5 * np.sum(light * radius**2) / np.sum(light)))
