"""What a calibration's own frames say of it: every inner position left out once, and predicted by the others."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from calib.build import table_of
from calib.nearest import CANDIDATES, nearest, nearest_of
from calib.placement import FACTOR, Placement, placement, reading_error
from calib.pupil_fit import Lens
from calib.targets import Measurement
from psflut.table import Kind, PSFTable

Floats = NDArray[np.float64]

BETWEEN = np.array([1.0, 3.0, 5.0]) / 6.0
"""Places in every gap at which a model's PSFs are read, in units of the gap."""

TAILS = stats.t(4).ppf((np.arange(21) + 0.5) / 21.0)
"""Quantiles of the errors that `placement` fits, in units of their scale."""

DEGREE = 2
"""Of the polynomial in which a lens' own readings may go wrong along the axis: its focus, its aperture, and a bend."""


class HeldOut(NamedTuple):
    """Of every inner position, arrays of (M,), (M, J) for the gap; metres, but for the second.

    ``psf_error`` is the summed |difference| of the measured PSF, noise included, and the predicted one;
    ``position_error`` is what the others read, less the truth, and has twice the finished table's gap to bridge;
    ``noise`` is the same without that gap where a model of the lens tells, and ``gap`` how far the finished table errs
    at places in the two gaps beside it, by that model; without one they are the whole error, and zero.
    ``reading`` is what the pixels' standard errors let expect, and ``place`` how noise follows from it.
    """

    position: Floats
    psf_error: Floats
    position_error: Floats
    noise: Floats
    gap: Floats
    reading: Floats
    place: Placement

    @property
    def expected(self) -> Floats:
        """Errors to expect of the finished table between positions, (M, J times quantiles of noise), metres."""
        scale = np.sqrt(FACTOR * (self.place.sigma**2 + (self.place.times * self.reading) ** 2))
        errors = self.gap[:, :, None] + scale[:, None, None] * TAILS
        return np.asarray(np.abs(errors.reshape(len(errors), -1)))


def hold_out(
    axis: Floats, kind: Kind, measurements: Sequence[Measurement], pixel_pitch: float, lens: Lens | None = None
) -> HeldOut:
    """Predict every inner PSF, and read its position, by the table of all the others.

    The others leave twice the gap of the finished table, over which a spline errs 5 to 16 times more, and what a
    target gets wrong in step with the pixels, once a pixel of blur, comes out three times too large. So the noise
    is told by a lens model where there is one: how far its own PSFs misread the frames, less a slow change along the
    axis (`_misread`). Its PSFs between the positions say what the finished table's gaps cost. Noise is
    pooled: its size follows the pixels' standard errors along the axis, a few numbers for all (`calib.placement`).

    Compared by the median error, expected over true, of 160 fresh frames of points between 20 positions (four draws;
    the first two were looked at for the choice):

    | noise | draws |
    |---|---|
    | left-out errors, the lens' own given back, median of 18 | 1.69, 1.47, 1.37, 1.55 |
    | the same, pooled | 1.30, 1.26, 1.38, 1.34 |
    | misread by the lens, median of 18 | 1.34, 1.42, 1.01, 1.55 |
    | misread by the lens, pooled: taken | 1.19, 1.10, 1.15, 1.11 |

    The same of edges, three draws of 40 fresh frames: 1.29, 1.15 and 1.56 (the first way 1.59, 1.45, 1.82); those
    frames were blurred by a fifth of a pixel too much, and without that one draw gave 0.96. With 10 and 7 of the
    positions 0.8 to 0.9 and 1.0 of points, 0.8 to 1.0 and 1.3 of edges (the first way 2.3 to 2.5 at 10).
    """
    table = table_of(axis, kind, measurements, pixel_pitch)
    psf_error, read = [], []
    for k in range(1, len(axis) - 1):
        others = [n for n in range(len(axis)) if n != k]
        without = table_of(axis[others], kind, [measurements[n] for n in others], pixel_pitch)
        seen = measurements[k].psf
        psf_error.append(np.abs(seen - without.at(axis[k])).sum())
        read.append(_read(table, without.at(table.candidates(CANDIDATES)), seen))
    error = np.array(read) - axis[1:-1]
    reading = reading_error(table, np.stack([each.std for each in measurements]))[1:-1]
    noise, gap = error, np.zeros((len(error), 1))
    if lens is not None:
        misread = _misread(table, measurements, lens, reading)
        if np.median(np.abs(misread / reading)) < np.median(np.abs(error / reading)):
            noise, gap = misread, _gaps(lens, table)
    place = placement(noise, reading, float(np.ptp(axis)))
    return HeldOut(axis[1:-1], np.array(psf_error), error, noise, gap, reading, place)


def _read(table: PSFTable, planes: Floats, psf: Floats) -> float:
    """The position, metres, of a measured PSF among planes at all the table's candidates."""
    found = nearest_of(planes, table.even(table.candidates(CANDIDATES)), psf)
    return float(np.clip(table.position(found), *table.span))


def _misread(table: PSFTable, measurements: Sequence[Measurement], lens: Lens, reading: Floats) -> Floats:
    """How far a lens misreads inner positions, less a slow change along the axis, metres (M,).

    As large as a left-out position's: the others' noise is added to its own. The slow change is a polynomial by least
    squares in units of the standard errors of `reading`; every residual is freed of what it bent that by itself.
    """
    planes = lens.at(table.even(table.candidates(CANDIDATES)), table.size)
    inner = table.axis[1:-1]
    error = np.array([_read(table, planes, each.psf) for each in measurements[1:-1]]) - inner
    even = table.even(inner)
    weight = 1.0 / reading
    columns = np.polynomial.legendre.legvander((even - even.mean()) / np.ptp(even), DEGREE) * weight[:, None]
    basis, _ = np.linalg.qr(columns)
    left = error * weight - basis @ (basis.T @ (error * weight))
    own = np.sqrt(np.maximum(1.0 - np.sum(basis**2, axis=1), 0.1))
    return np.asarray(np.sqrt(FACTOR) * reading * left / own)


def _gaps(lens: Lens, table: PSFTable) -> Floats:
    """Errors (M, J) of a table of a lens' own PSFs at places beside every inner position, metres."""
    model = replace(table, psf=lens.at(table.even(table.axis), table.size), psf_std=None)
    even = model.even(model.axis)
    places = (even[:-1, None] + BETWEEN * np.diff(even)[:, None]).ravel()
    read = np.array([nearest(model, psf) for psf in lens.at(places, model.size)])
    error = (read - model.position(places)).reshape(-1, len(BETWEEN))
    return np.hstack([error[:-1], error[1:]])


def facts(found: HeldOut, kind: Kind) -> dict[str, Any]:
    """What a table keeps of it, as JSON: medians, and every position's error in metres."""
    share = float(np.median(found.expected / found.position[:, None])) if kind == "distance" else None
    return {
        "held_out_positions": len(found.position),
        "psf_error": float(np.median(found.psf_error)),
        "position_error_m": float(np.median(found.expected)),
        "position_error_of_distance": share,
        "positions_m": found.position.tolist(),
        "errors_m": found.position_error.tolist(),
        "expected_m": np.sqrt(np.mean(found.expected**2, axis=1)).tolist(),
    }
