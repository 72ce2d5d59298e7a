"""PSFs between the pixels: a table's planes resampled finely, though they are under-sampled."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

Floats = NDArray[np.float64]
Images = NDArray[np.float32]

KNOT = 0.25
"""Spacing of the radial profile's nodes, pixels."""

STIFFNESS = 1e-4
"""Weight of the profile's squared second differences beside the squared errors of a plane."""

SAMPLES = 6
"""Points across a pixel over which it integrates light."""


def finer(planes: Floats, factor: int, side: int) -> Images:
    """What pixels would show of each PSF at places a fraction of a pixel apart.

    A PSF of a few pixels changes by less than the sampling theorem asks, and a Fourier or spline shift mixes its
    aliases up. But a lens is round: pixels at many radii sample one radial profile h(r) in many phases. So every
    plane is h(r), integrated over pixels, which is known everywhere, plus a remainder that is interpolated by sinc
    functions, dark around. At whole pixels the planes themselves come back. The rounder a PSF, the less remains.

    Compared on pupil PSFs of an f/2 lens, shifted by 0.4 pixel both ways, summed |error| at blur radii of 8.9, 3.9,
    1.5 and 0.6 pixels: Fourier alone 0.08, 0.27, 1.1 and 5.3; this 0.003, 0.014, 0.03 and 0.12. Nodes twice as far are
    two to four times worse, a stiffness of 0.01 twice.

    Parameters
    ----------
    planes : (M, K, K) array
        Centred on K // 2.
    factor : int
        Even; samples a pixel.
    side : int
        Of the result in pixels, odd, at least K.

    Returns
    -------
    (M, factor * side, factor * side) float32 array
        Centred on factor * (side // 2).
    """
    count, size = len(planes), planes.shape[-1]
    solver, spread = _profiles(size, factor)
    profiles = planes.reshape(count, -1) @ solver.T
    fine = (profiles @ spread.T).reshape(count, factor * size, factor * size)
    rest = planes - fine[:, factor // 2 :: factor, factor // 2 :: factor]
    places = (np.arange(factor * size) - factor // 2) / factor
    between = np.sinc(places[:, None] - np.arange(size))
    fine += between @ rest @ between.T
    before = factor * (side // 2 - size // 2) - factor // 2
    after = factor * (side - size) - before
    return np.pad(fine.astype(np.float32), ((0, 0), (before, after), (before, after)))


@lru_cache(maxsize=2)
def _profiles(size: int, factor: int) -> tuple[Floats, Images]:
    """The matrix that fits a profile to a plane, and the one that draws it at `factor` places a pixel."""
    middle = np.arange(size, dtype=float) - size // 2
    seen = _drawing(middle, middle, size)
    stiff = np.diff(np.eye(seen.shape[1]), 2, axis=0)
    normal = seen.T @ seen + STIFFNESS * stiff.T @ stiff + 1e-9 * np.eye(seen.shape[1])
    spread = np.empty((factor * size, factor * size, seen.shape[1]), np.float32)
    for i, j in np.ndindex(factor, factor):
        down, right = (k / factor - 0.5 for k in (i, j))
        spread[i::factor, j::factor] = _drawing(middle + down, middle + right, size).reshape(size, size, -1)
    return linalg.solve(normal, seen.T, assume_a="pos"), spread.reshape(-1, seen.shape[1])


def _drawing(y: Floats, x: Floats, size: int) -> Floats:
    """(Y X, J) light in pixels at rows y and columns x of each triangular ring of a profile."""
    within = (np.arange(SAMPLES) - (SAMPLES - 1) / 2) / SAMPLES
    radius = np.hypot((y[:, None] + within)[:, :, None, None], x[:, None] + within) / KNOT
    rings = int(np.ceil(0.72 * (size + 2) / KNOT)) + 2
    low = np.floor(radius).astype(int)
    pixel = np.arange(y.size * x.size).reshape(y.size, 1, x.size, 1) * rings
    share = radius - low
    total = np.bincount((pixel + low).ravel(), (1 - share).ravel(), y.size * x.size * rings)
    total += np.bincount((pixel + low + 1).ravel(), share.ravel(), y.size * x.size * rings)
    return np.asarray(total.reshape(-1, rings) / SAMPLES**2)
