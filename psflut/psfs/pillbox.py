"""The blur disc of geometric optics."""

from dataclasses import dataclass

import numpy as np

from psflut.optics import Camera, Floats
from psflut.psfs import PSFModel, disc_radius


@dataclass(frozen=True)
class Pillbox(PSFModel):
    """A uniform disc, the shadow of the aperture (2.5.4), integrated exactly over every pixel.

    The model is 1 / (pi r^2) for x^2 + y^2 <= r^2 and 0 elsewhere, with r the magnitude of
    `optics.blur_radius` in metres: rays alone, no diffraction and no aberrations. A pixel holds the area of
    the disc inside it, in closed form; a disc inside the central pixel, as of an object in focus, is a delta.

    Raises
    ------
    PsflutError
        When called, if the disc is wider than the window of `size` pixels.
    """

    def plane(self, camera: Camera, distance: float, size: int) -> Floats:
        """See `PSFModel`."""
        pixels = disc_radius(camera, distance, size)
        # Any disc inside the central pixel is the same delta: the floor only keeps the division finite.
        edges = np.linspace(-size / 2.0, size / 2.0, size + 1) / max(pixels, 1e-9)
        corner = _corner_area(edges[np.newaxis, :], edges[:, np.newaxis])
        # Rounding leaves differences of some -1e-17 outside the disc.
        areas = np.maximum(np.diff(np.diff(corner, axis=0), axis=1), 0.0)
        return np.asarray(areas / areas.sum(), dtype=float)


def _corner_area(x: Floats, y: Floats) -> Floats:
    """Signed area of the unit disc inside the rectangle from its centre to the corner (x, y)."""
    across, down = np.minimum(np.abs(x), 1.0), np.minimum(np.abs(y), 1.0)
    # The rectangle is full up to where its far side meets the circle; from there on the circle bounds it.
    meets = np.minimum(np.sqrt(1.0 - down**2), across)
    area = meets * down + _under_circle(across) - _under_circle(meets)
    return np.asarray(np.sign(x) * np.sign(y) * area, dtype=float)


def _under_circle(x: Floats) -> Floats:
    """Integral of sqrt(1 - t^2) from 0 to x, for 0 <= x <= 1."""
    return np.asarray(0.5 * (x * np.sqrt(1.0 - x**2) + np.arcsin(x)), dtype=float)
