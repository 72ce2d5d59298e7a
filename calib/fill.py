"""The pupil model against the measured course: which explains the frames better, and a table filled by the model."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.build import table_of
from calib.pupil_fit import Lens, fit_lens
from calib.targets import Measurement
from psflut.table import PSFTable

Floats = NDArray[np.float64]

LEAST = 7
"""Positions from which on the model is fitted: without every second one, as many are left as it has numbers."""


def verdict(table: PSFTable, measurements: Sequence[Measurement], lens: Lens) -> dict[str, Any]:
    """Which predicts PSFs better at positions that neither saw: JSON with the lens' numbers, lengths in metres.

    Every second inner position is predicted by the course of all others, and by a lens that is fitted to the other
    half. ``chi_square`` is the mean squared difference over the window in the measured standard errors; 1 is the
    measured noise alone.
    """
    left, axis = range(1, len(table.axis) - 1, 2), table.axis
    kept = [k for k in range(len(axis)) if k not in left]
    half = fit_lens(table.even(axis[kept]), table.psf[kept], _errors(table)[kept], lens)
    by_lens = half.at(table.even(axis[list(left)]), table.size)
    rows = []
    for k, predicted in zip(left, by_lens, strict=True):
        others = [n for n in range(len(axis)) if n != k]
        course = table_of(axis[others], table.kind, [measurements[n] for n in others], table.pixel_pitch).at(axis[k])
        noise = np.mean(measurements[k].std ** 2)
        rows.append([np.mean((measurements[k].psf - each) ** 2) / noise for each in (course, predicted)])
    by_course, by_pupil = (float(each) for each in np.median(rows, axis=0))
    return {
        "better": "pupil" if by_pupil <= by_course else "course",
        "chi_square": {"course": by_course, "pupil": by_pupil},
        "focus_m": float(table.position(lens.focus)) if table.kind == "stage" or lens.focus > 0 else None,
        "slope_px": lens.slope,
        "sampling": lens.sampling,
        "spherical_waves": lens.spherical,
        "softness_px": lens.softness,
    }


def fill(table: PSFTable, lens: Lens, planes: int) -> PSFTable:
    """The lens' table of `planes` positions, even in the coordinate of interpolation, over the same span.

    Its standard errors are what it misses of the measured course, in every ring about the centre, and the course's own.
    """
    even = table.even(table.axis)
    axis = table.candidates(planes)
    across = np.arange(table.size) - table.size // 2
    ring = np.hypot(across[:, None], across).round().astype(int).ravel()
    missed = (table.psf - lens.at(even, table.size)) ** 2 + _errors(table) ** 2
    sums = np.stack([np.bincount(ring, plane.ravel()) for plane in missed])
    rings = np.sqrt(sums / np.bincount(ring))[:, ring].reshape(missed.shape)
    order, new = np.argsort(even), table.even(axis)
    std = np.apply_along_axis(lambda values: np.interp(new, even[order], values[order]), 0, rings)
    place = None if table.axis_std is None else np.interp(new, even[order], table.axis_std[order])
    return replace(table, axis=axis, psf=lens.at(new, table.size), psf_std=std, axis_std=place)


def _errors(table: PSFTable) -> Floats:
    return np.zeros_like(table.psf) if table.psf_std is None else table.psf_std
