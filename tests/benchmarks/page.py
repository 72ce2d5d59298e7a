"""Frames of the printed noise page at its true size: the farther it stands, the smaller it is seen."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from calib.noise_target import CELL, DOTS, NoiseTarget
from psflut.optics import Camera
from psflut.psfs.pupil import Pupil

Floats = NDArray[np.float64]

TARGET = NoiseTarget()
PAPER, INK = 0.76, 0.06
TURN, TILT = np.deg2rad(2.0), 0.01
"""Of the page in the frame, and the change of its size from side to side."""

AWAY = 2.0
"""Distance, metres, up to which pixels are split 5 times each way; beyond, where blur is sharp, 9 times."""

PLACES = 8
"""At which a dot of the page is looked up, each way, at least."""


def page(lens: Camera, distance: float, size: int, rng: np.random.Generator) -> Floats:
    """The light of a frame, the page moved by up to a pixel."""
    split, fine = _fine(lens, distance, size)
    down, across = rng.integers(0, split, 2)
    rows, columns = (n // split - 1 for n in fine.shape)
    part = fine[down : down + rows * split, across : across + columns * split]
    return np.asarray(part.reshape(rows, split, columns, split).mean(axis=(1, 3)), dtype=float)


@lru_cache(2)
def _fine(lens: Camera, distance: float, size: int) -> tuple[int, NDArray[np.float32]]:
    """Pixels are split by this, and the blurred page on their parts."""
    picture = TARGET.picture()
    dots = distance * lens.pixel_pitch / lens.detector_distance / CELL * DOTS  # to a pixel
    split = 5 if distance < AWAY else 9
    shape = [(int(n / dots) + 10) * split for n in picture.shape]
    sharp = _sampled(picture < 0.5, dots / split, shape, max(4, int(np.ceil(PLACES * dots / split))))
    psf = Pupil()(replace(lens, pixel_pitch=lens.pixel_pitch / split), distance, split * size)
    sides = [fft.next_fast_len(n + len(psf), True) for n in shape]
    # Page and PSF are both means over a part of a pixel; once is enough.
    part = np.sinc(fft.fftfreq(sides[0]))[:, None] * np.sinc(fft.rfftfreq(sides[1]))
    dark = fft.irfft2(fft.rfft2(sharp, sides) * (fft.rfft2(psf, sides) / part), sides)
    half = len(psf) // 2
    dark = dark[half : half + shape[0], half : half + shape[1]]
    return split, (PAPER - (PAPER - INK) * dark).astype(np.float32)


def _sampled(black: NDArray[np.bool_], dots: float, shape: list[int], places: int) -> Floats:
    """Share of black in every part of a pixel, `dots` wide, from places x places samples."""
    turn = np.array([[np.cos(TURN), np.sin(TURN)], [-np.sin(TURN), np.cos(TURN)]])
    x = (np.arange(shape[1] * places) + 0.5) / places - shape[1] / 2.0
    out = np.empty(shape)
    for row in range(shape[0]):
        y = ((np.arange(row * places, (row + 1) * places) + 0.5) / places - shape[0] / 2.0)[:, None]
        scale = dots / (1.0 + TILT * x / shape[1])
        where = [scale * (a * x + b * y) + (n - 1) / 2.0 for (a, b), n in zip(turn, black.shape[::-1], strict=True)]
        across, down = (
            np.clip(np.rint(w), 0, n - 1).astype(np.int32) for w, n in zip(where, black.shape[::-1], strict=True)
        )
        out[row] = black[down, across].reshape(places, shape[1], places).mean(axis=(0, 2))
    return out
