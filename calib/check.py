"""What a calibration's own frames say of it: every inner position left out once, and predicted by the others."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from calib.build import smooth
from calib.targets import Measurement
from psflut.table import Kind, PSFTable

Floats = NDArray[np.float64]

CANDIDATES = 200
"""Positions at which a left-out PSF is compared with the table of the others, before the finest step."""


class HeldOut(NamedTuple):
    """Of every inner position: its place (metres), the error of its PSF and of the distance read from it.

    ``psf_error`` is the summed |difference| between measured and predicted PSF; ``position_error`` is in
    metres, answer less truth.
    """

    position: Floats
    psf_error: Floats
    position_error: Floats


def table_of(axis: Floats, kind: Kind, measurements: Sequence[Measurement], pixel_pitch: float) -> PSFTable:
    """The table of measurements at ascending positions, before anything else is known of it."""
    even = axis if kind == "stage" else 1.0 / axis
    order = np.argsort(even)
    course, back = smooth(even[order], [measurements[k] for k in order]), np.argsort(order)
    return PSFTable(axis, course.psf[back], pixel_pitch, kind=kind, psf_std=course.std[back])


def hold_out(axis: Floats, kind: Kind, measurements: Sequence[Measurement], pixel_pitch: float) -> HeldOut:
    """Predict every inner PSF, and read its position, by the table of all the others.

    The position is the one whose PSF is nearest to the measured one in its standard errors, over the whole
    table. The gap that is interpolated is twice that of the finished table, so errors are rather too large.
    """
    inner = range(1, len(axis) - 1)
    rows = []
    for k in inner:
        others = [each for n, each in enumerate(measurements) if n != k]
        table = table_of(np.delete(axis, k), kind, others, pixel_pitch)
        predicted = table.at(axis[k])
        rows.append((float(np.abs(measurements[k].psf - predicted).sum()), _read(table, measurements[k]) - axis[k]))
    errors = np.array(rows).reshape(-1, 2)
    return HeldOut(axis[1:-1], errors[:, 0], errors[:, 1])


def facts(found: HeldOut) -> dict[str, Any]:
    """What a table keeps of it, as JSON: medians, and every position's error in metres."""
    return {
        "held_out_positions": len(found.position),
        "psf_error": float(np.median(found.psf_error)),
        "position_error_m": float(np.median(np.abs(found.position_error))),
        "errors_m": [float(error) for error in found.position_error],
    }


def _read(table: PSFTable, seen: Measurement) -> float:
    """The position (metres) whose PSF fits a measured one best."""
    even = table.even(table.candidates(CANDIDATES))

    def misfit(place: float) -> float:
        inside = np.clip(table.position(place), *table.span)
        return float(np.sum(((seen.psf - table.at(inside)) / np.maximum(seen.std, 1e-12)) ** 2))

    best = int(np.argmin([misfit(place) for place in even]))
    ends = even[[max(best - 1, 0), min(best + 1, CANDIDATES - 1)]]
    found = minimize_scalar(misfit, bounds=(float(ends.min()), float(ends.max())), method="bounded")
    return float(np.clip(table.position(found.x), *table.span))
