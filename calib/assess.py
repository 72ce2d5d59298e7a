"""Everything that a calibration's own frames say of its table: its lens, held-out errors, placement, good ranges."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.build import smooth
from calib.check import facts, hold_out
from calib.fill import LEAST as LEAST_FOR_LENS
from calib.fill import fill, verdict
from calib.lens_course import guess_of
from calib.placement import LEAST as LEAST_FOR_PLACEMENT
from calib.placement import reading_error
from calib.pupil_fit import Lens, fit_lens
from calib.ranges import ranges
from calib.targets import Measurement
from psflut.errors import PsflutError
from psflut.table import PSFTable

Floats = NDArray[np.float64]

LEAST_FOR_CHECK = 4
"""Positions from which on one can be left out and three still make a table."""


@dataclass(frozen=True)
class Assessment:
    """What is looked into.

    Parameters
    ----------
    placement : float or None
        Standard error of a position, metres; None: from the scatter of held-out errors.
    model : bool
        Whether the pupil model is compared with the measured course.
    planes : int or None
        Of the finished table, by the model or by it and the measured course, where that explains the frames best; None:
        one a position.
    """

    placement: float | None = None
    model: bool = False
    planes: int | None = None

    def __post_init__(self) -> None:
        if self.placement is not None and not self.placement >= 0:
            raise PsflutError(f"a placement sigma is a length of 0 or more, got {self.placement} m")
        if self.planes is not None and (self.planes < 3 or not self.model):
            raise PsflutError("more planes than positions come from the model: give 3 or more, with --model pupil")

    def of(self, table: PSFTable, measurements: Sequence[Measurement]) -> PSFTable:
        """The table smoothed about its lens, with `axis_std` and `check`, and filled where that was asked for."""
        lens = _lens(table, measurements, self.model)
        if lens is not None:
            table = _about(table, measurements, lens)
        check: dict[str, Any] = {}
        std = None if self.placement is None else np.full(len(table.axis), self.placement)
        if len(table.axis) >= LEAST_FOR_CHECK:
            found = hold_out(table.axis, table.kind, measurements, table.pixel_pitch, lens)
            check = facts(found, table.kind)
            if lens is not None and np.any(found.gap):  # it explains the frames: what planes may be apart follows
                check["lens"] = {"slope": lens.slope, "focus": lens.focus, "sampling": lens.sampling}
            if std is None and len(found.position) >= LEAST_FOR_PLACEMENT:
                reading = reading_error(table, np.stack([each.std for each in measurements]))
                std, check["placement_m"] = found.place.axis_std(reading), found.place.sigma
        table = replace(table, axis_std=std)
        if self.model and lens is not None:
            answer = verdict(table, measurements, lens)
            check["model"] = answer
            if self.planes is not None and answer["better"] != "course":
                table = fill(table, lens, self.planes, measured=answer["better"] == "both")
                check |= facts(found._replace(gap=np.zeros_like(found.gap)), table.kind)
        return replace(table, check={**check, "ranges": ranges(table)})


def _lens(table: PSFTable, measurements: Sequence[Measurement], asked: bool) -> Lens | None:
    """The pupil model of measured PSFs, from a camera where there is one; None where too little is known of it."""
    if len(table.axis) < LEAST_FOR_LENS:
        if asked:
            raise PsflutError(f"a pupil model needs {LEAST_FOR_LENS} positions or more, got {len(table.axis)}")
        return None
    even = table.even(table.axis)
    known = table.camera is not None and table.kind == "distance"
    start = Lens.of_camera(table.camera) if known else Lens.of_moments(even, table.psf)  # type: ignore[arg-type]
    return fit_lens(even, *_stacked(measurements), start)


def _about(table: PSFTable, measurements: Sequence[Measurement], lens: Lens) -> PSFTable:
    """The table smoothed about the lens that fits its measurements."""
    even = table.even(table.axis)
    order = np.argsort(even)
    psf, std = (each[order] for each in _stacked(measurements))
    guess = guess_of(lens, even[order], psf, std)
    course, back = smooth(even[order], [measurements[k] for k in order], guess), np.argsort(order)
    return replace(table, psf=course.psf[back], psf_std=course.std[back])


def _stacked(measurements: Sequence[Measurement]) -> tuple[Floats, Floats]:
    """(N, K, K) their PSFs, and the standard errors."""
    return np.stack([each.psf for each in measurements]), np.stack([each.std for each in measurements])
