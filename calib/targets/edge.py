"""Straight edges between black and white: a symmetric PSF straight from the samples beside them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from calib import lines
from calib.rings import Rings, smooth_fit
from calib.targets import Measurement, Shot, Target
from psflut.errors import PsflutError
from psflut.imagers import Imager

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Edge(Target):
    """Straight edges at any angle, one or several in a frame, sampled clear of corners and of each other.

    The optics' PSF is p(r) = sum a_j hat(r / d - j) with a_j >= 0 (`calib.rings`). With A_j the share of ring j
    on the bright side of an edge at a distance s, a pixel shows

        y(s) = low + step * sum_j a_j (L * box * A_j)(s),

    box being the pixel and L the imager's kernel, both turned with the edge. So nothing is differentiated, and a
    signed imager is not inverted: its kernel is in the model. The a_j of all edges and shots together are
    a regularised least-squares fit, whose smoothness the data choose (`calib.rings.smooth_fit`).

    Assumed: a rotationally symmetric PSF, the same along an edge; no light beyond 3 sigma + 2 pixels of the
    spread, sigma being that of the normal distribution nearest to it; white noise; even light on either side.
    An edge exactly along a row has one phase of sampling only, and leaves more of the PSF to the smoothness.
    Standard errors do not count on a_j >= 0: near focus, where that tells most, they are two to four times too large.

    Parameters
    ----------
    shortest : float
        Length that an edge must keep clear of corners and other edges, pixels.
    straightness : float
        Largest sag of its ends, pixels.
    contrast : float
        Smallest range of its samples, in units of what the fit of a normal distribution leaves.
    smooth : float
        Sigma of the smoothing before edges are looked for, pixels.
    near : float
        How far from the centre of a shot, where that is given, an edge may begin; pixels.
    """

    shortest: float = 8.0
    straightness: float = 0.3
    contrast: float = 5.0
    smooth: float = 2.0
    near: float = 50.0

    def measure(self, shots: Sequence[Shot], size: int, imager: Imager) -> Measurement:
        """See `Target`."""
        edges, rejected = [], []
        for shot in shots:
            used, refused = self.edges(shot, size, imager)
            edges += used
            rejected += [f"{shot.name}: {reason}" for reason in refused]
        if not edges:
            why = "; ".join(rejected[:3]) or "no straight edge found"
            raise PsflutError(f"no edge can be used at {shots[0].position} m: {why}; look at the frames")
        psf, std = _solve(edges, size, imager.kernel())
        return Measurement(psf, std, len(edges), tuple(rejected))

    def edges(self, shot: Shot, size: int, imager: Imager) -> tuple[list["_Sampled"], list[str]]:
        """The edges of a shot that can be used, and why others cannot."""
        mask, direction = lines.edge_pixels(lines.picture_behind(shot.image, imager), self.smooth)
        used, rejected = [], []
        for line in lines.straight(mask, direction, self.shortest):
            if shot.centre is not None and np.hypot(*(line.pixels - shot.centre).T).min() > self.near:
                continue
            try:
                used.append(self._sampled(shot.image, mask, line, size, imager.kernel()))
            except PsflutError as reason:
                rejected.append(f"the edge at ({line.point[0]:.0f}, {line.point[1]:.0f}) {reason}")
        return used, rejected

    def _sampled(
        self, image: Floats, mask: NDArray[np.bool_], line: lines.Line, size: int, kernel: Floats
    ) -> "_Sampled":
        """Located and sampled as widely as its blur asks for, which the first looks tell."""
        if line.inliers < 0.6:
            raise PsflutError("is curved")
        reach = min(size / 2.0, 6.0)
        for _ in range(3):
            places = _clear(image.shape, mask, line, reach, len(kernel) // 2)
            away, along = line.along(places)
            if len(places) == 0 or np.ptp(along) < self.shortest:
                raise PsflutError("is too short: corners and other edges leave too few pixels of it clear")
            if min(-away.min(), away.max()) < reach:
                raise PsflutError("is too near the border or another edge: its blur is not seen on both sides")
            values = image[*places.T.astype(int)]
            if np.mean(~np.isfinite(values)) > 0.002:
                raise PsflutError("is saturated")
            places, values = places[np.isfinite(values)], values[np.isfinite(values)]
            line = lines.locate(line, places, values, kernel)
            reach = min(size / 2.0, 3.0 * line.sigma + 2.0)
        if line.contrast < self.contrast:
            raise PsflutError(f"has a low contrast, {line.contrast:.1f} times its noise")
        if abs(line.sag) > self.straightness:
            raise PsflutError(f"is curved by {abs(line.sag):.2f} pixels")
        if 4.0 * line.sigma > size:
            raise PsflutError(f"is blurred wider than {size} pixels")
        return _Sampled(line, reach, line.along(places)[0], values)


@dataclass(frozen=True, eq=False)
class _Sampled:
    """An edge: its line, the reach of its blur (pixels), and values at signed distances from it (pixels), (n,)."""

    line: lines.Line
    reach: float
    distance: Floats
    values: Floats


def _clear(shape: tuple[int, ...], mask: NDArray[np.bool_], line: lines.Line, reach: float, border: int) -> Floats:
    """Pixels (n, 2) beside a line up to `reach` and a margin that see no other edge pixel within `reach`."""
    margin = int(2.0 * reach) + 5
    first = np.maximum(line.pixels.min(axis=0).astype(int) - margin, 0)
    last = np.minimum(line.pixels.max(axis=0).astype(int) + margin + 1, shape)
    window = mask[first[0] : last[0], first[1] : last[1]]
    places = np.moveaxis(np.indices(window.shape), 0, -1).reshape(-1, 2) + first
    away, along = line.along(places.astype(float))
    ends = line.along(line.pixels)[1]
    beside = (along >= ends.min()) & (along <= ends.max())
    clear = beside & (np.abs(away) < reach + 3.0)
    clear &= np.all((places > border) & (places < np.subtract(shape, border + 1)), axis=1)
    others = window & ~(beside & (np.abs(away) < 3.0)).reshape(window.shape)
    if others.any():
        clear &= ndimage.distance_transform_edt(~others).ravel() > reach
    return np.asarray(places[clear], dtype=float)


def _solve(edges: Sequence[_Sampled], size: int, kernel: Floats) -> tuple[Floats, Floats]:
    """The PSF and its standard error, (size, size), from all edges together."""
    reach = max(edge.reach for edge in edges)
    width = float(np.clip(reach / 32.0, 0.15, 0.5))
    rings = Rings(int(reach / width), width)
    designs = [rings.seen(edge.distance, edge.line.angle, kernel) for edge in edges]
    designs = [design - design.mean(axis=0) for design in designs]  # which takes the low level out
    levels = [edge.values - edge.values.mean() for edge in edges]
    sigma = max(edge.line.sigma for edge in edges)
    heights = np.exp(-0.5 * (width * np.arange(rings.count) / sigma) ** 2)
    for _ in range(3):  # the steps of the edges in turn with the PSF
        shapes = [design @ heights / (rings.mass @ heights) for design in designs]
        steps = [level @ shape / (shape @ shape) for level, shape in zip(levels, shapes, strict=True)]
        data = np.concatenate([level / step for level, step in zip(levels, steps, strict=True)])
        heights, covariance = smooth_fit(np.vstack(designs), data, rings.bend, 2 * len(edges))
    planes = rings.planes(size)
    total = (planes @ heights).sum()
    psf = planes @ heights / total
    slope = (planes - psf[..., None] * planes.sum(axis=(0, 1))) / total
    std = np.sqrt(np.maximum(np.einsum("yxi,ij,yxj->yx", slope, covariance, slope, optimize=True), 0.0))
    return psf, std
