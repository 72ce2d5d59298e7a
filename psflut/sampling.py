"""Whether the planes of a table lie close enough together, by what diffraction makes of a defocus.

At the wavefront error W(rho) = W020 rho^2 a point shows |int P exp(2 pi i W020 rho^2 + ..)|^2: products of waves from
any two zones of the pupil, each with a frequency along the axis that is the difference of their rho^2, at most one
cycle a wave of W020. Two zones make a product in a pixel only if both send light there: the zone rho goes to rho times
the radius r of the blur, so that with pixels of a side p zones meet that differ by d = p / r at most, in frequency by

    1 - (1 - d)^2 = 2 d - d^2 cycles a wave,   d = min(p / r, 1).

So planes must be half a wave apart near focus and may be farther where blur is wide: 20 planes 0.64 waves apart are
too few below 1.9 pixels of r. There the point method errs by 0.14 and 0.13 of a step, above by less than 0.02 (f/2,
16 mm, pixels of 6 um, `PSFTable`). Planes left out do not tell: what they fold in can fit by chance.
"""

import numpy as np
from numpy.typing import NDArray

from psflut.optics import blur_radius, defocus_wavefront
from psflut.table import PSFTable
from psflut.units import format_length

Floats = NDArray[np.float64]

HALF = 0.5
"""Of a cycle, that planes may be apart."""


def defocus_of(table: PSFTable) -> tuple[Floats, Floats] | None:
    """W020 (N,) in waves and signed blur radius (N,) in pixels at the axis, from the camera or, without one, from the
    lens that a calibration found to explain its frames; None where neither is known."""
    lens = (table.check or {}).get("lens")
    if table.camera is not None and table.kind == "distance":
        waves = defocus_wavefront(table.camera, table.axis) / table.camera.wavelength
        return waves, blur_radius(table.camera, table.axis) / table.pixel_pitch
    if lens is not None:
        radius = lens["slope"] * (table.even(table.axis) - lens["focus"])
        return 0.25 * lens["sampling"] * radius, radius
    return None


def too_far(table: PSFTable) -> NDArray[np.bool_]:
    """(N - 1,) whether two neighbouring planes are farther apart than that; False where the defocus is not known."""
    known = defocus_of(table)
    if known is None:
        return np.zeros(len(table.axis) - 1, dtype=bool)
    waves, radius = known
    least = np.minimum(np.abs(radius[1:]), np.abs(radius[:-1])) * (radius[1:] * radius[:-1] > 0)
    meet = np.minimum(1.0 / np.maximum(least, 1.0), 1.0)
    return np.asarray(np.abs(np.diff(waves)) * (2.0 * meet - meet**2) > HALF)


def advice(table: PSFTable) -> str | None:
    """A sentence on planes that are too far apart, with how many there should be; None where all is well."""
    wrong = np.flatnonzero(too_far(table))
    known = defocus_of(table)
    if known is None or len(wrong) == 0:
        return None
    waves = np.abs(np.diff(known[0]))
    planes = int(np.ceil(abs(known[0][-1] - known[0][0]) / HALF)) + 1
    first, last = (format_length(float(table.axis[k])) for k in (wrong[0], wrong[-1] + 1))
    return (
        f"planes between {first} and {last} are up to {waves[wrong].max():.2f} waves of defocus apart, more than half "
        f"a wave so near focus: distances between them are less sure there; use {planes} planes, "
        "or let a fitted lens fill them in (psflut calibrate --model pupil --planes N)"
    )
