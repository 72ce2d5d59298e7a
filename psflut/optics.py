"""First-order optics of a camera with a fixed lens: thin lens, vergence, blur radius, defocus.

Plain functions on floats or arrays, in metres. Distances are measured from the lens, positive towards the
object; equation numbers are those of the thesis, chapter 2.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from psflut.errors import PsflutError

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Camera:
    """A thin lens with a round aperture and a detector at a fixed distance behind it.

    Parameters
    ----------
    focal_length : float
        F, in metres.
    aperture_diameter : float
        D, in metres.
    detector_distance : float
        From the lens to the detector, zd, in metres; at least F, so that the focus is real or at infinity.
    pixel_pitch : float
        In metres on the detector.
    wavelength : float
        In metres; at which wavefronts are counted in waves.

    Raises
    ------
    PsflutError
        For a length that is not positive and finite, or a detector nearer than the focal length.
    """

    focal_length: float
    aperture_diameter: float
    detector_distance: float
    pixel_pitch: float
    wavelength: float = 550e-9

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value > 0):
                raise PsflutError(f"{name} must be a positive length, got {value} m; check the camera")
        if self.detector_distance < self.focal_length:
            raise PsflutError(
                f"detector_distance {self.detector_distance} m is shorter than focal_length {self.focal_length} m, "
                "so nothing is ever in focus; move the detector behind the focal plane"
            )

    @classmethod
    def of(
        cls,
        focal_length: float,
        pixel_pitch: float,
        *,
        aperture_diameter: float | None = None,
        f_number: float | None = None,
        focus_distance: float | None = None,
        detector_distance: float | None = None,
        wavelength: float = 550e-9,
    ) -> Self:
        """A camera in the terms of a photographer, lengths in metres.

        Either the aperture's diameter or the f-number; either the distance at which an object is sharp
        or that of the detector.

        Raises
        ------
        PsflutError
            For both or neither of a pair, and as the class does.
        """
        _one_of(aperture_diameter=aperture_diameter, f_number=f_number)
        _one_of(focus_distance=focus_distance, detector_distance=detector_distance)
        if f_number is not None:
            if not f_number > 0:
                raise PsflutError(f"f_number must be positive, got {f_number}; check the camera")
            aperture_diameter = focal_length / f_number
        if not focal_length > 0:
            raise PsflutError(f"focal_length must be positive, got {focal_length} m; check the camera")
        if focus_distance is not None:
            if not focus_distance > focal_length:
                raise PsflutError(
                    f"focus_distance must exceed focal_length {focal_length} m, got {focus_distance} m; "
                    "no detector sees a nearer object sharp"
                )
            detector_distance = float(image_distance(focal_length, focus_distance))
        assert aperture_diameter is not None
        assert detector_distance is not None
        return cls(focal_length, aperture_diameter, detector_distance, pixel_pitch, wavelength)

    @property
    def focus_distance(self) -> float:
        """Object distance that is sharp on the detector, in metres; infinite for a detector at F."""
        if self.detector_distance == self.focal_length:
            return np.inf
        return float(object_distance(self.focal_length, self.detector_distance))

    @property
    def f_number(self) -> float:
        """Focal length over aperture diameter."""
        return self.focal_length / self.aperture_diameter


def _one_of(**pair: float | None) -> None:
    first, second = pair
    if (pair[first] is None) == (pair[second] is None):
        raise PsflutError(f"a camera has either {first} or {second}; give one of them")


def vergence(distance: ArrayLike) -> Floats:
    """1 / distance, in dioptres (1/m). Blur is nearly linear in it. Its own inverse."""
    return 1.0 / np.asarray(distance, dtype=float)


def image_distance(focal_length: float, object_distance: ArrayLike) -> Floats:
    """Where a thin lens images an object, in metres behind it: 1/zi = 1/F - 1/zo (2.4.1)."""
    return 1.0 / (1.0 / focal_length - vergence(object_distance))


def object_distance(focal_length: float, image_distance: ArrayLike) -> Floats:
    """What a thin lens images there, in metres before it: the inverse of `image_distance`."""
    return 1.0 / (1.0 / focal_length - vergence(image_distance))


def defocus(camera: Camera, distance: ArrayLike) -> Floats:
    """Vergence of the object less that of the focus, 1/zo + 1/zd - 1/F, in dioptres; positive when nearer."""
    return vergence(distance) + 1.0 / camera.detector_distance - 1.0 / camera.focal_length


def blur_radius(camera: Camera, distance: ArrayLike) -> Floats:
    """Radius of the geometric blur disc on the detector, in metres (2.5.3); negative beyond the focus."""
    return 0.5 * camera.aperture_diameter * camera.detector_distance * defocus(camera, distance)


def distance_at_blur(camera: Camera, radius: ArrayLike) -> Floats:
    """Object distance with that signed blur radius, in metres: the inverse of `blur_radius`."""
    difference = 2.0 * np.asarray(radius, dtype=float) / (camera.aperture_diameter * camera.detector_distance)
    return 1.0 / (difference - 1.0 / camera.detector_distance + 1.0 / camera.focal_length)


def defocus_wavefront(camera: Camera, distance: ArrayLike) -> Floats:
    """Defocus W020 at the rim of the pupil, in metres: W(rho) = W020 rho^2, D^2/8 times `defocus`.

    Its slope at the rim gives back the blur radius: r = 4 (zd / D) W020.
    """
    return camera.aperture_diameter**2 / 8.0 * defocus(camera, distance)
