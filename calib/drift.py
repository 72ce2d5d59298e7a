"""Whether a table still holds for new frames, and if not, how far the focus has moved."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.nearest import nearest
from calib.placement import reading_error
from calib.targets import Measurement
from psflut.errors import PsflutError
from psflut.table import PSFTable
from psflut.units import format_length

Floats = NDArray[np.float64]

SIGNIFICANT = 3.0
"""Standard errors beyond which a common shift is no chance."""

UNLIKE = 1.5
"""A PSF is of another shape if it differs from the table's by so many times what positions left out did."""


@dataclass(frozen=True, eq=False)
class Drift:
    """New frames read by a table.

    Parameters
    ----------
    table : PSFTable
    position, read : (M,) arrays
        Where the frames were taken, and what the table reads; metres.
    std : (M,) array
        Standard error of a reading, metres: the error that the table expects of itself.
    psf_error, allowed : (M,) arrays
        Summed |difference| between a measured PSF and the table's at the place read, and what is let pass.
    """

    table: PSFTable
    position: Floats
    read: Floats
    std: Floats
    psf_error: Floats
    allowed: Floats

    @property
    def shift(self) -> tuple[float, float]:
        """The common shift of all readings in the coordinate of interpolation (1/m, or m), and its standard error.

        A focus that moved, or a stage with another zero, shifts all alike there. A mean weighted by the standard
        errors; where readings scatter more than these say, its own is larger.
        """
        moved, std = self._moved()
        weight = 1.0 / std**2
        mean = np.sum(weight * moved) / np.sum(weight)
        scatter = np.sum(weight * (moved - mean) ** 2) / max(len(moved) - 1, 1)
        return float(mean), float(np.sqrt(max(scatter, 1.0) / np.sum(weight)))

    def _moved(self) -> tuple[Floats, Floats]:
        per_metre = 1.0 / self.position**2 if self.table.kind == "distance" else np.ones(len(self.position))
        return self.table.even(self.read) - self.table.even(self.position), self.std * per_metre

    @property
    def verdict(self) -> str:
        """ "changed" if PSFs look unlike the table's, or no one shift explains them; "drifted" by one; or "holds"."""
        shift, error = self.shift
        if np.median(self.psf_error / self.allowed) > 1.0 or self._chi_square(shift) > SIGNIFICANT**2:
            return "changed"
        return "drifted" if abs(shift) > SIGNIFICANT * error else "holds"

    def _chi_square(self, shift: float) -> float:
        """Mean squared reading error, less a shift, in standard errors."""
        moved, std = self._moved()
        return float(np.mean(((moved - shift) / std) ** 2))

    def facts(self) -> dict[str, Any]:
        """As JSON, lengths in metres; a shift on a distance axis is that at the middle of the new frames."""
        shift, error = self.shift
        middle = float(np.median(self.position))
        scale = -(middle**2) if self.table.kind == "distance" else 1.0
        rows = zip(self.position, self.read, self.std, self.psf_error, strict=True)
        names = ("position_m", "read_m", "expected_error_m", "psf_error")
        return {
            "verdict": self.verdict,
            "message": self.message(),
            "shift_m": scale * shift,
            "shift_std_m": abs(scale) * error,
            "shift_at_m": middle if self.table.kind == "distance" else None,
            "shift_dioptre": shift if self.table.kind == "distance" else None,
            "focus_m": self._focus(),
            "chi_square": {"as_it_is": self._chi_square(0.0), "shifted": self._chi_square(shift)},
            "frames": [dict(zip(names, map(float, row), strict=True)) for row in rows],
        }

    def _focus(self) -> float | None:
        """Where the camera is focused now, metres, if the table knows where it was."""
        camera = self.table.camera
        if camera is None or self.table.kind == "stage":
            return None
        focus = 1.0 / camera.focus_distance - self.shift[0]
        return 1.0 / focus if focus > 0 else None

    def message(self) -> str:
        """The verdict in one sentence."""
        shift, error = self.shift
        if self.verdict == "changed":
            times, left = np.median(self.psf_error / self.allowed), np.sqrt(self._chi_square(shift))
            return (
                f"the table does not hold, and no shift explains why: PSFs differ by {times:.2g} times the limit, "
                f"readings by {left:.2g} standard errors beside the shift; calibrate this lens and aperture again"
            )
        middle = float(np.median(self.position))
        if self.table.kind == "stage":
            by = f"{format_length(abs(shift))} (standard error {format_length(error)})"
            where = f"a shift of the stage by {'-' if shift < 0 else '+'}{by}"
        else:
            by = f"{format_length(abs(shift) * middle**2)} (standard error {format_length(error * middle**2)})"
            where = f"objects at {format_length(middle)} read {by} too {'near' if shift > 0 else 'far'}"
        if self.verdict == "holds":
            return f"the table holds: {where}, which is no more than chance"
        focus, camera = self._focus(), self.table.camera
        if focus is not None and camera is not None:
            before = format_length(camera.focus_distance)
            where += f", as if the focus had moved from {before} to {format_length(focus)}"
        return f"the table has drifted, best explained by a shift: {where}"


def drift(table: PSFTable, position: Floats, measurements: Sequence[Measurement]) -> Drift:
    """New measurements (M) at positions (M,) in metres, read by a table.

    Raises
    ------
    PsflutError
        If a position lies outside the table.
    """
    first, last = table.span
    if np.min(position) < first or np.max(position) > last:
        near, far = format_length(float(np.min(position))), format_length(float(np.max(position)))
        span = f"{format_length(first)} to {format_length(last)}"
        raise PsflutError(f"frames to check lie within the table, {span}, got {near} to {far}; leave the others out")
    read = np.array([nearest(table, each.psf) for each in measurements])
    error = [np.abs(each.psf - table.at(place)).sum() for each, place in zip(measurements, read, strict=True)]
    noise = np.sqrt(2 / np.pi) * np.array([each.std.sum() for each in measurements])
    check = table.check or {}
    allowed = UNLIKE * np.hypot(check.get("psf_error", 0.0), noise)
    return Drift(table, position, read, _expected(table, position, measurements), np.array(error), allowed)


def _expected(table: PSFTable, position: Floats, measurements: Sequence[Measurement]) -> Floats:
    """Standard error (metres) of every reading: what the table's own check expects there, and the frame's noise."""
    even, here = table.even(table.axis), table.even(position)
    planes = [int(np.argmin(np.abs(even - u))) for u in here]
    std = np.zeros_like(table.psf)
    own = []
    for plane, each in zip(planes, measurements, strict=True):
        std[plane] = each.std
        own.append(reading_error(table, std)[plane])
    check = table.check or {}
    if "expected_m" not in check:
        return np.array(own) if table.axis_std is None else np.hypot(own, table.axis_std[planes])
    places, expected = table.even(check["positions_m"]), np.array(check["expected_m"])
    order = np.argsort(places)
    return np.asarray(np.hypot(own, np.interp(here, places[order], expected[order])))
