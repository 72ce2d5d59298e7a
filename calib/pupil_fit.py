"""The pupil model fitted to a whole course of measured PSFs: focus, aperture, spherical aberration, softness."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d
from scipy.optimize import least_squares
from scipy.special import ive

from calib.fit_errors import fit_errors
from calib.radial import radial_planes
from psflut.optics import Camera

Floats = NDArray[np.float64]

FEW = 8
"""Positions, evenly chosen, to which the model is fitted before all of them."""

APERTURES = (1.0, 0.7, 1.4, 0.5, 2.0, 0.35, 2.8, 0.25, 4.0)
"""Times the first guess of the aperture, that fits start from: the rings of a wrong one make local minima. From halves
and doubles alone, one of six draws of 20 planes of points ended at a sampling of 4.4 in place of 5.4."""


@dataclass(frozen=True)
class Lens:
    """A course of PSFs along the axis u (1 / distance in 1/m, or stage in m) by wave optics.

    The geometric blur disc has the radius slope * (u - focus); the wavefront at the pupil's rim is
    W020 = sampling * radius / 4 waves, plus spherical aberration. Neither focal length nor detector distance is told
    by PSFs: only these ratios are. The sign of the slope and that of the aberration change together.

    Parameters
    ----------
    slope : float
        Pixels a unit of u.
    focus : float
        u of the sharpest PSF's geometric focus.
    sampling : float
        Pixel pitch in units of wavelength * detector distance / aperture.
    spherical : float
        Zernike (4, 0), waves (6 rho^4 - 6 rho^2 + 1).
    softness : float
        Sigma of a further Gaussian blur, pixels: several colours, a detector's cross-talk.
    """

    slope: float
    focus: float
    sampling: float
    spherical: float = 0.0
    softness: float = 0.0

    @classmethod
    def of_camera(cls, camera: Camera) -> Self:
        """The lens that a camera's data give; u is 1 / distance."""
        ratio = camera.aperture_diameter / camera.detector_distance
        slope = 0.5 * camera.aperture_diameter * camera.detector_distance / camera.pixel_pitch
        return cls(slope, 1.0 / camera.focus_distance, camera.pixel_pitch * ratio / camera.wavelength)

    @classmethod
    def of_moments(cls, even: Floats, psf: Floats) -> Self:
        """A first guess from the second moments of PSFs (N, K, K): a disc of radius R has R^2 / 2 of it."""
        across = np.arange(psf.shape[1]) - psf.shape[1] // 2
        moment = np.sum(psf * (across[:, None] ** 2 + across**2), axis=(1, 2))
        scale = np.ptp(even)
        bend, tilt, _ = np.polyfit((even - even.mean()) / scale, moment, 2)
        bend = max(bend, 0.1 * abs(tilt), 1e-3)
        return cls(float(np.sqrt(2.0 * bend) / scale), float(even.mean() - 0.5 * scale * tilt / bend), 2.0)

    def at(self, even: Floats, size: int) -> Floats:
        """PSFs (M, size, size) at coordinates (M,), sum 1."""
        radius = np.clip(self.slope * (np.asarray(even) - self.focus), -0.49 * size, 0.49 * size)
        planes = radial_planes(radius, self.sampling, self.spherical, size)
        reach = int(np.ceil(4.0 * self.softness)) + 1
        spread = ive(np.arange(-reach, reach + 1), self.softness**2)  # a Gaussian on pixels (Lindeberg 1990)
        planes = convolve1d(convolve1d(planes, spread, axis=1, mode="constant"), spread, axis=2, mode="constant")
        return np.asarray(planes / planes.sum(axis=(1, 2), keepdims=True))


def fit_lens(even: Floats, psf: Floats, std: Floats, start: Lens) -> Lens:
    """The lens whose course fits measured PSFs (N, K, K) best, by least squares in units of `fit_errors`.

    First a few positions from each of `APERTURES`, then all from the best of them.
    """
    sigma = fit_errors(psf, std)
    few = np.unique(np.linspace(0, len(even) - 1, min(FEW, len(even))).round().astype(int))
    starts = [replace(start, sampling=factor * start.sampling, softness=0.3) for factor in APERTURES]
    tries = [_fit(even[few], psf[few], sigma[few], each) for each in starts]
    best = min(tries, key=lambda found: found[1])[0]
    return _fit(even, psf, sigma, best)[0]


def _fit(even: Floats, psf: Floats, sigma: Floats, start: Lens) -> tuple[Lens, float]:
    """The lens from one start, and the mean squared residual."""
    scale = float(np.ptp(even))
    middle = float(even.mean())

    def lens(p: Floats) -> Lens:
        numbers = np.exp(p[0]) / scale, middle + scale * p[1], np.exp(p[2]), p[3], np.sqrt(p[4])
        return Lens(*(float(each) for each in numbers))

    def residual(p: Floats) -> Floats:
        return np.asarray((lens(p).at(even, psf.shape[1]) - psf) / sigma).ravel()

    first = [np.log(start.slope * scale), (start.focus - middle) / scale, np.log(start.sampling), start.spherical]
    low, high = [-7.0, -20.0, np.log(0.1), -2.0, 0.0], [7.0, 20.0, np.log(30.0), 2.0, 9.0]
    inside = np.clip([*first, start.softness**2], np.add(low, 1e-3), np.subtract(high, 1e-3))
    found = least_squares(
        residual,
        inside,
        bounds=(low, high),
        x_scale=[0.1, 0.1, 0.1, 0.1, 0.1],
        diff_step=1e-3,
        ftol=1e-4,
        xtol=1e-4,
        max_nfev=25,
    )
    return lens(found.x), float(np.mean(found.fun**2))
