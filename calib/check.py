"""What a calibration's own frames say of it: every inner position left out once, and predicted by the others."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from calib.build import table_of
from calib.nearest import CANDIDATES, nearest, nearest_of
from calib.pupil_fit import Lens
from calib.targets import Measurement
from psflut.table import Kind, PSFTable

Floats = NDArray[np.float64]

BETWEEN = np.array([1.0, 3.0, 5.0]) / 6.0
"""Places in every gap at which a model's PSFs are read, in units of the gap."""

SHARES = np.linspace(0.0, 1.0, 5)
"""Of what a model adds to a left-out prediction: the best is taken, 0 where the model does not help."""


class HeldOut(NamedTuple):
    """Of every inner position, (M,) arrays but for the last, metres but for the second.

    ``psf_error`` is the summed |difference| of the measured PSF, noise included, and the predicted one;
    ``position_error`` is what the others read, less the truth, and has twice the finished table's gap to bridge;
    ``noise`` is the same where a model of the lens helps to bridge it, and ``gap`` (M, J) how far the finished table
    errs at places in the two gaps beside it, by that model; without one they are the whole error, and zero.
    """

    position: Floats
    psf_error: Floats
    position_error: Floats
    noise: Floats
    gap: Floats

    @property
    def expected(self) -> Floats:
        """Errors to expect of the finished table between positions, with either sign of noise, (M, 2 J), metres."""
        noise = self.noise[:, None]
        return np.abs(np.hstack([self.gap + noise, self.gap - noise]))


def hold_out(
    axis: Floats, kind: Kind, measurements: Sequence[Measurement], pixel_pitch: float, lens: Lens | None = None
) -> HeldOut:
    """Predict every inner PSF, and read its position, by the table of all the others.

    The others leave twice the gap of the finished table, over which a spline errs 5 to 16 times more. A lens model
    tells how much: what its own PSFs lose when they are left out is given back to the prediction, so that the
    error left is noise; and its PSFs between the positions say what the finished table's gaps cost. Measured on
    points and edges at 20, 10 and 7 distances: errors of fresh frames between the positions were 0.2 to 0.9, 2 and 5
    mm at 1 m, plain left-out ones 1, 19 and 54; extrapolated from yet wider gaps 0.4 to 1.5, 13 and 10 to 15. Here
    1.2, 1.0 and 0.9 times the fresh ones' median is expected of points, 1.5, 2.6 and 1.2 times of edges.
    """
    table = table_of(axis, kind, measurements, pixel_pitch)
    candidates = table.candidates(CANDIDATES)
    even, inner = table.even(candidates), range(1, len(axis) - 1)
    model = None if lens is None else replace(table, psf=lens.at(table.even(axis), table.size), psf_std=None)
    truth = 0.0 if lens is None else lens.at(even, table.size)
    psf_error, read = [], []
    for k in inner:
        others = [n for n in range(len(axis)) if n != k]
        without = table_of(axis[others], kind, [measurements[n] for n in others], pixel_pitch)
        lost = 0.0 if model is None else truth - _some(model, others).at(candidates)
        planes = without.at(candidates)
        seen = measurements[k].psf
        psf_error.append(np.abs(seen - without.at(axis[k])).sum())
        read.append([nearest_of(planes + share * lost, even, seen) for share in (SHARES if lens else SHARES[:1])])
    errors = np.clip(table.position(np.array(read)), *table.span) - axis[1:-1, None]
    best = int(np.argmin(np.abs(errors / axis[1:-1, None] if kind == "distance" else errors).sum(axis=0)))
    gap = np.zeros((len(errors), 1)) if lens is None or model is None else _gaps(lens, model)
    return HeldOut(axis[1:-1], np.array(psf_error), errors[:, 0], errors[:, best], gap)


def _some(table: PSFTable, kept: list[int]) -> PSFTable:
    return replace(table, axis=table.axis[kept], psf=table.psf[kept])


def _gaps(lens: Lens, model: PSFTable) -> Floats:
    """Errors (M, J) of a table of a lens' own PSFs at places beside every inner position, metres."""
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
