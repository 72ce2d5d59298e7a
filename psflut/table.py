"""The table of point spread functions against distance: what calibration and estimation share.

This file is the table in memory; `psflut.store` reads and writes it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from psflut.errors import PsflutError
from psflut.fourier import transfer
from psflut.noise import Noise
from psflut.optics import Camera
from psflut.units import format_length

Floats = NDArray[np.float64]
Kind = Literal["distance", "stage"]

MOST_CANDIDATES = 100_000


@dataclass(frozen=True, eq=False)
class PSFTable:
    """Point spread functions at known distances.

    Between its planes the PSF follows a cubic spline in vergence (1 / distance), in which blur is nearly
    linear, or in the coordinate itself on a stage axis; the result is clipped at zero and given sum 1.
    Compared on a table of an f/2 lens with steps of 0.2 pixel in blur radius, between planes: linear
    interpolation errs by up to 4.0 % of the peak, the cubic spline by 0.36 %, a quintic one by 0.28 %.

    Near focus a step must stay below half a wave of defocus (W020), which is 2 wavelength * f-number in blur radius: an
    intensity |int P exp(2 pi i W020 rho^2)|^2 has up to one cycle a wave, as rho^2 differs by 1 at most, and needs two
    planes a cycle. Reading f/2 points of the pupil model in the three steps before focus, steps of 0.64 waves err by up
    to 0.14, 0.13 and 0.055 of a step, of 0.48 by 0.039, 0.033 and 0.013. No interpolant helps: quintic, Akima, monotone
    and square-root splines err by 0.11 to 0.15 in the worst step at 0.64 waves, and with planes beyond the end, on the
    other side of focus, by 0.06 to 0.10. Far from focus pixels average the rings, and longer steps do.

    Parameters
    ----------
    axis : (N,) array
        Object distances, positive, or stage coordinates; ascending, in metres; N >= 3.
    psf : (N, K, K) array
        One plane a distance, indexed [y, x]; non-negative, sum 1, centred on K // 2; K odd.
    pixel_pitch : float
        In metres on the detector.
    kind : "distance" or "stage"
        What the axis is.
    camera : Camera or None
        Where it is known.
    imager, noise
        What the captures of this set-up went through, `family.parse` text and `Noise` or None.
    psf_std, axis_std : arrays or None
        Standard errors of `psf` and of `axis` (metres), of the same shapes.
    psf_modes : (J, N, K, K) array or None
        How PSFs differ from point to point, over the field say: a point's own is `psf` plus the modes, each times a
        standard normal number that is the same at all distances. The point method integrates them out; the others,
        limits and held-out errors know `psf` alone.
    provenance, check : mappings
        What made the table, and its held-out error; plain JSON.

    Raises
    ------
    PsflutError
        Where any of this does not hold.
    """

    axis: Floats
    psf: Floats
    pixel_pitch: float
    kind: Kind = "distance"
    camera: Camera | None = None
    imager: str = "plain"
    noise: Noise | None = None
    psf_std: Floats | None = None
    axis_std: Floats | None = None
    psf_modes: Floats | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict)
    check: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        count, size = len(self.axis), self.psf.shape[-1]
        if self.kind not in ("distance", "stage"):
            raise PsflutError(f"the axis of a table is 'distance' or 'stage', got {self.kind!r}")
        if count < 3 or self.psf.shape != (count, size, size) or size % 2 == 0:
            raise PsflutError(
                f"a table has 3 or more planes of odd, square size, got {count} positions and PSFs of shape "
                f"{self.psf.shape}; make the window odd and take more positions"
            )
        for name, array in (("axis", self.axis), ("psf", self.psf)):
            if not np.all(np.isfinite(array)):
                raise PsflutError(f"the table's {name} holds values that are not finite; build it again")
        if np.any(np.diff(self.axis) <= 0) or (self.kind == "distance" and self.axis[0] <= 0):
            raise PsflutError(
                "the positions of a table must ascend without repeats and distances be positive; sort them"
            )
        if self.psf.min() < 0 or np.any(np.abs(self.psf.sum(axis=(1, 2)) - 1) > 1e-5):
            raise PsflutError("every PSF of a table must be non-negative and sum to 1; normalise it")
        for errors, values in ((self.psf_std, self.psf), (self.axis_std, self.axis)):
            if errors is not None and (errors.shape != values.shape or not np.all((errors >= 0) & (errors < np.inf))):
                raise PsflutError(
                    "standard errors of a table must be finite, non-negative and shaped like their values; mend them"
                )
        modes = self.psf_modes
        if modes is not None and (modes.shape[1:] != self.psf.shape or not np.all(np.isfinite(modes))):
            raise PsflutError("modes of a table must be finite and each shaped like its PSFs; mend them")
        if not (np.isfinite(self.pixel_pitch) and self.pixel_pitch > 0):
            raise PsflutError(f"pixel_pitch must be a positive length, got {self.pixel_pitch} m; give it")

    @property
    def size(self) -> int:
        """Side K of a PSF, in pixels."""
        return int(self.psf.shape[-1])

    @property
    def span(self) -> tuple[float, float]:
        """First and last position, in metres."""
        return float(self.axis[0]), float(self.axis[-1])

    def even(self, position: ArrayLike) -> Floats:
        """The coordinate in which the table is interpolated and the prior is flat: 1 / distance (1/m), or
        the stage coordinate itself (m)."""
        values = np.asarray(position, dtype=float)
        return 1.0 / values if self.kind == "distance" else values

    def position(self, even: ArrayLike) -> Floats:
        """The inverse of `even`, in metres."""
        return self.even(even)

    def candidates(self, count: int) -> Floats:
        """`count` positions over the span, spaced evenly in the interpolation coordinate; ascending, metres."""
        if not 2 <= count <= MOST_CANDIDATES:
            raise PsflutError(
                f"candidates span a table from end to end: 2 to {MOST_CANDIDATES} of them, got {count}; 200 are usual"
            )
        first, last = self.even(self.span)
        spread = self.position(np.linspace(first, last, count))
        spread[[0, -1]] = self.span  # exactly, whatever 1 / (1 / z) rounds to
        return spread

    def at(self, position: ArrayLike) -> Floats:
        """PSFs at positions within the span (metres): shape (..., K, K), non-negative, sum 1."""
        values = self._inside(position)
        planes = np.maximum(self._spline(self.even(values)), 0.0)
        return np.asarray(planes / planes.sum(axis=(-2, -1), keepdims=True))

    def modes_at(self, position: ArrayLike) -> Floats:
        """Modes at positions (M,) within the span (metres): shape (J, M, K, K), J = 0 where the table has none."""
        values = self.even(self._inside(position))
        if self.psf_modes is None:
            return np.zeros((0, *values.shape, self.size, self.size))
        order = np.argsort(self.even(self.axis))
        return np.asarray(CubicSpline(self.even(self.axis)[order], self.psf_modes[:, order], axis=1)(values))

    def derivative(self, position: ArrayLike) -> Floats:
        """d PSF / d position, per metre, of the spline before clipping: shape (..., K, K)."""
        values = self._inside(position)
        slope = self._spline(self.even(values), 1)
        chain = -1.0 / values**2 if self.kind == "distance" else np.ones_like(values)
        return np.asarray(slope * chain[..., None, None])

    def otf(self, shape: tuple[int, int], position: ArrayLike) -> NDArray[np.complexfloating]:
        """Optical transfer functions on the grid of ``rfft2`` of an image of that shape, centre at pixel 0."""
        planes = self.at(position)
        return transfer(planes, shape)

    def power(self, shape: tuple[int, int], position: ArrayLike) -> Floats:
        """Squared modulus of `otf`: what the optics leave of the power of each spatial frequency."""
        return np.asarray(np.abs(self.otf(shape, position)) ** 2)

    @cached_property
    def _spline(self) -> CubicSpline:
        order = np.argsort(self.even(self.axis))
        return CubicSpline(self.even(self.axis)[order], self.psf[order], axis=0)

    def _inside(self, position: ArrayLike) -> Floats:
        values = np.asarray(position, dtype=float)
        first, last = self.span
        if not np.all((values >= first) & (values <= last)):
            outside = values[~((values >= first) & (values <= last))].flat[0]
            raise PsflutError(
                f"{self.kind} {format_length(outside)} is outside the table, which runs from "
                f"{format_length(first)} to {format_length(last)}; stay inside"
            )
        return values
