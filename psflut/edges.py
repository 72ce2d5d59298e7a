"""Straight edges in a frame, sampled where nothing else is seen: what a calibration and an estimate read."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from psflut import lines
from psflut.errors import PsflutError
from psflut.imagers import Imager

Floats = NDArray[np.float64]

REACH = 3.0
"""How far from an edge its blur is looked at: so many sigma of its spread, and 2 pixels."""

SMOOTHEST = 100
"""Pixels over which a frame is smoothed before edges are looked for, at most."""

CLEAR = 2.0
"""How far its pixels keep from corners and other edges: so many sigma of its spread, and 1 pixel."""


@dataclass(frozen=True, eq=False)
class Sampled:
    """An edge and the pixels beside it.

    Parameters
    ----------
    line : Line
    reach : float
        Of its blur, pixels.
    length : float
        Of what is sampled of it, pixels.
    distance, along : (n,) arrays
        Of the pixels from the edge, positive on its bright side (pixels), and their places along it, -1 .. 1.
    values : (n,) array
        Of the pixels, image units.
    """

    line: lines.Line
    reach: float
    length: float
    distance: Floats
    along: Floats
    values: Floats

    @property
    def light(self) -> Floats:
        """Columns (n, 2) that the low level, and the step likewise, may follow along the edge: even, and a slope.

        So does uneven light, and what a corner two sigma away leaves: beside one whose sides meet at right
        angles the spread of a separable PSF keeps its shape and loses a hundredth of its step.
        """
        return np.stack([np.ones_like(self.along), self.along], axis=1)


@dataclass(frozen=True)
class Search:
    """What counts as a straight edge between black and white.

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
        How far from the target's centre, where that is given, an edge may begin; pixels.
    alike : float
        Smallest range of its samples, in image units and in units of what the fit leaves, as a share of the largest
        in its frame: surroundings are greyer than a target of black and white, and less like an edge.
    """

    shortest: float = 8.0
    straightness: float = 0.3
    contrast: float = 5.0
    smooth: float = 2.0
    near: float = 50.0
    alike: float = 0.4

    def __post_init__(self) -> None:
        if not 0 <= self.smooth <= SMOOTHEST:
            raise PsflutError(f"smooth must be from 0 to {SMOOTHEST} pixels, got {self.smooth:g}; 2 is usual")

    def edges(
        self, image: Floats, size: int, imager: Imager, centre: tuple[float, float] | None = None
    ) -> tuple[list[Sampled], list[str]]:
        """The edges that can be used, and why others cannot.

        Parameters
        ----------
        image : (H, W) array
            Image units; saturated pixels NaN.
        size : int
            Widest blur, pixels.
        imager : Imager
        centre : (y, x) or None
            Of the target, pixels.
        """
        mask, slope, direction = lines.edge_pixels(lines.picture_behind(image, imager), self.smooth)
        found, rejected = [], []
        for line in lines.straight(mask, slope, direction, self.shortest, self.alike):
            if centre is not None and np.hypot(*(line.pixels - centre).T).min() > self.near:
                continue
            try:
                found.append(self._sampled(image, mask, line, size, imager.kernel()))
            except PsflutError as reason:
                rejected.append(f"{_name(line)} {reason}")
        rise, contrast = (
            self.alike * max((getattr(edge.line, what) for edge in found), default=0.0) for what in ("rise", "contrast")
        )
        used = [edge for edge in found if edge.line.rise >= rise and edge.line.contrast >= contrast]
        rejected += [f"{_name(edge.line)} is unlike the best of its frame" for edge in found if edge not in used]
        return used, rejected

    def _sampled(self, image: Floats, mask: NDArray[np.bool_], line: lines.Line, size: int, kernel: Floats) -> Sampled:
        """Located and sampled as widely as its blur asks for, which the first looks tell."""
        if line.inliers < 0.6:
            raise PsflutError("is curved")
        reach, clear = min(size / 2.0, 6.0), 4.0
        for share in (0.5, 0.5, 1.0):
            places = _clear(image.shape, mask, line, reach, clear, len(kernel) // 2)
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
            if line.contrast < share * self.contrast:
                raise PsflutError(f"has a low contrast, {line.contrast:.1f} times its noise")
            if abs(line.sag) > self.straightness:
                raise PsflutError(f"is curved by {abs(line.sag):.2f} pixels")
            reach, clear = min(size / 2.0, REACH * line.sigma + 2.0), CLEAR * line.sigma + 1.0
        if 4.0 * line.sigma > size:
            raise PsflutError(f"is blurred wider than {size} pixels")
        away, along = line.along(places)
        length = float(np.ptp(along))
        return Sampled(line, reach, length, away, 2.0 * (along - along.min()) / length - 1.0, values)


def _name(line: lines.Line) -> str:
    return f"the edge at ({line.point[0]:.0f}, {line.point[1]:.0f})"


def _clear(
    shape: tuple[int, ...], mask: NDArray[np.bool_], line: lines.Line, reach: float, clear: float, border: int
) -> Floats:
    """Pixels (n, 2) beside a line up to `reach` and a margin that see no other edge pixel within `clear`."""
    margin = int(2.0 * reach) + 5
    first = np.maximum(line.pixels.min(axis=0).astype(int) - margin, 0)
    last = np.minimum(line.pixels.max(axis=0).astype(int) + margin + 1, shape)
    window = mask[first[0] : last[0], first[1] : last[1]]
    places = np.moveaxis(np.indices(window.shape), 0, -1).reshape(-1, 2) + first
    away, along = line.along(places.astype(float))
    ends = line.along(line.pixels)[1]
    beside = (along >= ends.min()) & (along <= ends.max())
    near = beside & (np.abs(away) < reach + 3.0)
    near &= np.all((places > border) & (places < np.subtract(shape, border + 1)), axis=1)
    others = window & ~(beside & (np.abs(away) < 3.0)).reshape(window.shape)
    if others.any():
        near &= ndimage.distance_transform_edt(~others).ravel() > clear
    return np.asarray(places[near], dtype=float)
