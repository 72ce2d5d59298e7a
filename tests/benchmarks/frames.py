"""Frames of every calibration target, from the pupil model on pixels of a fifth: 12 bits, photon and read noise."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import imageio.v3 as iio
import numpy as np
from numpy.typing import NDArray
from page import TARGET, page
from scipy import fft, ndimage, signal

from calib.targets import Shot, Target
from calib.targets.edge import Edge
from calib.targets.pattern import Pattern
from calib.targets.point import Point
from psflut.optics import Camera
from psflut.psfs.pupil import Pupil

Floats = NDArray[np.float64]

LENS = Camera.of(16e-3, 6e-6, f_number=2, focus_distance=6.0)
FINE, SIZE, SIDE, MARGIN = 5, 33, 204, 20
READ, GAIN, LEVELS = 0.002, 20_000.0, 2**12 - 1
DISTANCES = 1 / np.linspace(1 / 0.95, 1 / 4.5, 20)


@cache
def fine_psf(distance: float) -> Floats:
    """On pixels of a fifth."""
    return Pupil()(replace(LENS, pixel_pitch=LENS.pixel_pitch / FINE), distance, FINE * SIZE)


@cache
def bare_psf(distance: float) -> Floats:
    """Not yet integrated over a fine pixel: a scene that is given by its means over fine pixels is so already."""
    psf = fine_psf(distance)
    part = np.sinc(fft.fftfreq(len(psf)))[:, None] * np.sinc(fft.rfftfreq(len(psf)))
    return np.asarray(fft.irfft2(fft.rfft2(psf) / part, psf.shape))


@cache
def truth(distance: float) -> Floats:
    """On the camera's own pixels."""
    return Pupil()(LENS, distance, SIZE)


def shot(light: Floats, distance: float, rng: np.random.Generator) -> Shot:
    """A frame of that light (1 is full scale), noisy and rounded to 12 bits."""
    noisy = rng.poisson(np.maximum(light, 0) * GAIN) / GAIN + READ * rng.standard_normal(light.shape)
    return Shot(np.round(np.clip(noisy, 0, 1) * LEVELS) / LEVELS, distance, f"{distance:.3f} m")


def points(distance: float, rng: np.random.Generator) -> Shot:
    """Nine bright points at random places, the brightest pixels at half of full scale."""
    model = fine_psf(distance)
    peak = model.reshape(SIZE, FINE, SIZE, FINE).sum(axis=(1, 3)).max()
    canvas = np.full((SIDE * FINE, SIDE * FINE), 0.02 / FINE**2)
    for y in (34, 102, 170):
        for x in (34, 102, 170):
            top, left = (FINE * (c - SIZE // 2) + int(rng.integers(-FINE, FINE + 1)) for c in (y, x))
            canvas[top : top + FINE * SIZE, left : left + FINE * SIZE] += 0.5 * model / peak
    return shot(canvas.reshape(SIDE, FINE, SIDE, FINE).sum(axis=(1, 3)), distance, rng)


def edges(distance: float, rng: np.random.Generator) -> Shot:
    """A quartered field, black and white, five degrees off the rows of pixels."""
    fine = (np.arange((SIDE + 2 * MARGIN) * FINE) + 0.5) / FINE - 0.5 - MARGIN
    y, x = fine[:, None] - SIDE / 2 - rng.uniform(-1, 1), fine - SIDE / 2 - rng.uniform(-1, 1)
    cosine, sine = np.cos(np.deg2rad(5)), np.sin(np.deg2rad(5))
    one, other = (np.clip(away * FINE + 0.5, 0, 1) for away in (y * cosine + x * sine, x * cosine - y * sine))
    return shot(blurred(0.08 + 0.62 * (one * other + (1 - one) * (1 - other)), distance), distance, rng)


def blurred(scene: Floats, distance: float) -> Floats:
    """What a fine scene with a margin looks like on the camera's pixels, the margin cut off."""
    picture = signal.oaconvolve(scene, bare_psf(distance), mode="same")
    whole = picture.reshape(SIDE + 2 * MARGIN, FINE, SIDE + 2 * MARGIN, FINE).mean(axis=(1, 3))
    return np.asarray(whole[MARGIN:-MARGIN, MARGIN:-MARGIN])


@cache
def pattern_scene() -> Floats:
    """A binary picture with power at all scales, on fine pixels, with a margin."""
    side = (SIDE + 2 * MARGIN) * FINE
    cycles = np.hypot(fft.fftfreq(side)[:, None], fft.rfftfreq(side))
    cycles[0, 0] = np.inf
    noise = fft.rfft2(np.random.default_rng(1).standard_normal((side, side)))
    field = fft.irfft2(noise / np.sqrt(cycles), (side, side))
    return np.asarray(ndimage.gaussian_filter(np.where(field > 0, 0.75, 0.08), 0.5 * FINE))


def pages(distance: float, rng: np.random.Generator) -> Shot:
    """The printed page."""
    return shot(page(LENS, distance, SIZE, rng), distance, rng)


def patterns(distance: float, rng: np.random.Generator) -> Shot:
    """The picture, moved by up to half a pixel."""
    moved = np.roll(pattern_scene(), rng.integers(-2, 3, 2), axis=(0, 1))
    return shot(blurred(moved, distance), distance, rng)


def pattern(folder: Path) -> Target:
    """The target, and its reference: the mean of four sharp frames."""
    side = SIDE + 2 * MARGIN
    sharp = pattern_scene().reshape(side, FINE, side, FINE).mean(axis=(1, 3))
    frame = np.mean([shot(sharp, 1.0, np.random.default_rng(100 + n)).image for n in range(4)], axis=0)
    iio.imwrite(folder / "sharp.png", np.round(frame * 65535).astype(np.uint16))
    return Pattern(str(folder / "sharp.png"))


FRAMES: dict[str, tuple[Callable[[Path], Target], Callable[[float, np.random.Generator], Shot]]] = {
    "point": (lambda folder: Point(), points),
    "edge": (lambda folder: Edge(), edges),
    "pattern": (lambda folder: Pattern(TARGET.name), pages),
    "pattern by a sharp frame": (pattern, patterns),
}
"""Of every target: itself, given a folder for what it needs, and how a frame of it is made."""
