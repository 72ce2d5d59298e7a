"""Where a table tells distances well, and where it is blind: the standard error of a point's distance along it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from psflut.limits import GOOD, runs
from psflut.table import PSFTable

Floats = NDArray[np.float64]

SNR = 30.0
"""Of the point that stands before the camera: the root of its image's energy over the noise of a pixel."""

COUNT = 101
"""Positions that are looked at."""


def standard_error(table: PSFTable, position: float, snr: float = SNR) -> float:
    """Standard error (metres) of the distance of a point seen in white noise, brightness and place unknown.

    The PSFs a step of GOOD nearer and farther are compared, less what a change of brightness or place explains:
    their difference D is seen with d' = snr |D| / |h|. The energy that the table's own errors put into D is first taken
    off, or noise would pass for a change; where nothing is left, as at focus, where both sides look alike, it is
    infinite. The table's errors at the position, of pixels and of placement, are added.
    """
    near, far = _step(table, position)
    psf = table.at(position)
    change = table.at(far) - table.at(near)
    known = np.stack([psf, *np.gradient(psf)]).reshape(3, -1).T
    basis, _ = np.linalg.qr(known)
    left = change.ravel() - basis @ (basis.T @ change.ravel())
    pixel, place = _errors(table, position)
    across = abs(float(table.even(far) - table.even(near))) / (np.ptp(table.even(table.axis)) / (len(table.axis) - 1))
    energy = left @ left - min(across, 1.0) ** 2 * 2.0 * np.sum(np.broadcast_to(pixel, psf.shape) ** 2)
    if energy <= 0.0:
        return np.inf
    by_noise = (far - near) * np.linalg.norm(psf) / (snr * np.sqrt(energy))
    by_table = (far - near) * np.linalg.norm(left.reshape(psf.shape) * pixel) / energy
    return float(np.sqrt(by_noise**2 + by_table**2 + place**2))


def _step(table: PSFTable, position: float) -> tuple[float, float]:
    first, last = table.span
    step = GOOD * (position if table.kind == "distance" else last - first)
    return max(position - step, first), min(position + step, last)


def _errors(table: PSFTable, position: float) -> tuple[Floats, float]:
    """At a position, between those of the planes: standard errors of pixels (K, K) and of the place (metres), or 0."""
    even, here = table.even(table.axis), float(table.even(position))
    order = np.argsort(even)
    k = int(np.clip(np.searchsorted(even[order], here), 1, len(even) - 1))
    low, high = order[k - 1], order[k]
    part = (here - even[low]) / (even[high] - even[low])

    def between(values: Floats | None) -> Floats:
        return np.zeros(1) if values is None else np.asarray((1.0 - part) * values[low] + part * values[high])

    return between(table.psf_std), float(np.squeeze(between(table.axis_std)))


def ranges(table: PSFTable, snr: float = SNR) -> dict[str, Any]:
    """The standard error along the table, its good ranges and its blind ones, as JSON in metres; null is infinite."""
    positions = table.candidates(COUNT)
    std = np.array([standard_error(table, float(z), snr) for z in positions])
    good = std <= GOOD * (positions if table.kind == "distance" else np.ptp(table.axis))
    return {
        "snr": snr,
        "good_below": GOOD,
        "of": "the distance" if table.kind == "distance" else "the span",
        "good_m": runs(positions, good),
        "blind_m": runs(positions, ~good),
        "positions_m": positions.tolist(),
        "std_m": [float(each) if np.isfinite(each) else None for each in std],
    }
