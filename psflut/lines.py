"""Straight edges in a frame: found to the pixel by their gradient, then located far below it by a fit."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage, optimize, special

from psflut.imagers import Imager

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Line:
    """A straight edge.

    Parameters
    ----------
    point : (2,) array
        A point on it, (y, x) in pixels.
    angle : float
        Of its normal, which points to the bright side, radians: (cos, sin) in (y, x).
    pixels : (n, 2) array
        The pixels along it, (y, x).
    inliers : float
        Share of the pixels within one pixel of the line.
    sigma : float
        Standard deviation of its spread, pixels; this and what follows from `locate`.
    sag : float
        How far its ends are off the straight line through its middle, pixels.
    rise : float
        From the lowest to the highest of the fit, image units.
    contrast : float
        The rise in units of what the fit leaves.
    """

    point: Floats
    angle: float
    pixels: Floats
    inliers: float
    sigma: float = 1.0
    sag: float = 0.0
    rise: float = 0.0
    contrast: float = 0.0

    def along(self, places: Floats) -> tuple[Floats, Floats]:
        """Signed distance (positive: bright) and position along the edge of (n, 2) places, pixels."""
        away = places - self.point
        normal = np.array([np.cos(self.angle), np.sin(self.angle)])
        return away @ normal, away @ np.array([-normal[1], normal[0]])


def picture_behind(image: Floats, imager: Imager) -> Floats:
    """What the imager saw, roughly: saturated pixels filled, its filter inverted down to a thousandth of its peak.

    Only for finding edges; a filter that is blind to slow changes leaves the picture flat beside them.
    """
    filled = np.where(np.isfinite(image), image, np.nanmax(image, initial=0.0))
    if imager.kernel().size == 1:
        return filled
    height, width = image.shape
    mirrored = np.pad(filled - filled.mean(), ((0, height), (0, width)), mode="symmetric")
    transfer = imager.transfer(mirrored.shape)
    inverse = transfer / (transfer**2 + (0.001 * np.abs(transfer).max()) ** 2)
    return np.asarray(fft.irfft2(fft.rfft2(mirrored) * inverse, mirrored.shape)[:height, :width])


def edge_pixels(picture: Floats, smooth: float) -> tuple[NDArray[np.bool_], Floats, Floats]:
    """Pixels on edges (Canny); slope and direction of the gradient everywhere, radians from +y towards +x.

    The thresholds are 0.15 and 0.3 of the steepest slope; `smooth` is the sigma of the smoothing, pixels.
    """
    from skimage import feature

    gradient = [ndimage.gaussian_filter(picture, smooth, order=order) for order in ((1, 0), (0, 1))]
    slope, direction = np.hypot(*gradient), np.arctan2(gradient[1], gradient[0])
    steepest = 8.0 * float(slope.max())  # Canny's Sobel filters give 8 times the slope
    if not steepest > 1e-9:
        return np.zeros(picture.shape, bool), slope, direction
    return feature.canny(picture / steepest, smooth, 0.15, 0.3, mode="nearest"), slope, direction


def straight(
    mask: NDArray[np.bool_], slope: Floats, direction: Floats, shortest: float, alike: float
) -> Iterator[Line]:
    """Connected runs of edge pixels of one direction, longest first, each with a line by RANSAC.

    Runs whose mean slope is less than a share `alike` of the steepest one's are left out. One polarity each: where
    black and white change sides, as at the middle of a quartered disc, a run ends.
    """
    from skimage import measure

    runs = []
    for octant in range(8):
        near = np.cos(direction - octant * np.pi / 4) > np.cos(np.pi / 6)
        regions = measure.regionprops(measure.label(mask & near, connectivity=2))
        runs += [region.coords for region in regions if len(region.coords) >= shortest]
    least = alike * max((slope[*run.T].mean() for run in runs), default=0.0)
    runs = [run for run in runs if slope[*run.T].mean() >= least]
    taken = np.zeros(mask.shape, bool)
    places, turned = np.argwhere(mask), direction[mask]
    for run in sorted(runs, key=len, reverse=True):
        if taken[*run.T].mean() > 0.3:  # the octants overlap, and edges may be broken
            continue
        model = measure.LineModelND
        inliers = measure.ransac(run.astype(float), model, 2, 1.0, stop_probability=0.999, rng=0)[1]
        if inliers is None:
            continue
        pixels = run[inliers].astype(float)
        point = pixels.mean(axis=0)
        normal = np.linalg.svd(pixels - point)[2][1]
        uphill = np.stack([np.cos(direction[*run.T]), np.sin(direction[*run.T])]).mean(axis=1)
        normal *= np.copysign(1.0, normal @ uphill)
        line = Line(point, float(np.arctan2(normal[1], normal[0])), pixels, float(inliers.mean()))
        line = replace(line, pixels=_continued(line, places[np.cos(turned - line.angle) > 0.8].astype(float)))
        taken[*run.T] = taken[*line.pixels.T.astype(int)] = True
        yield line


def _continued(line: Line, places: Floats, gap: float = 6.0) -> Floats:
    """Those of the (m, 2) edge pixels that lie along a line, (n, 2), from its own on to the first gaps."""
    away, along = line.along(places)
    order = np.argsort(along[np.abs(away) < 2.0])
    places, along = places[np.abs(away) < 2.0][order], along[np.abs(away) < 2.0][order]
    part = np.cumsum(np.diff(along, prepend=along[:1]) > gap)
    own = part[np.argmin(np.abs(along))] if len(part) else 0
    return places[part == own] if len(part) else line.pixels


def locate(line: Line, places: Floats, values: Floats, kernel: Floats) -> Line:
    """The line through the samples `values` at (n, 2) `places`: position, angle, spread and sag by least squares.

    The model is low + step * (kernel * normal distribution)(distance / sigma). An edge blurred by a symmetric
    PSF is odd about its middle, whatever its shape, so that the middle has no bias where this model is wrong.
    """
    along = line.along(places)[1]
    half = max(float(np.ptp(along)) / 2.0, 1.0)
    normal = np.array([np.cos(line.angle), np.sin(line.angle)])
    middle = line.point + along.mean() * np.array([-normal[1], normal[0]])
    away, along = (places - middle) @ normal, (along - along.mean()) / half
    taps = np.argwhere(kernel != 0)
    shifts = (taps - kernel.shape[0] // 2) @ normal
    level = values - values.mean()

    def fit(settings: Floats) -> Floats:
        offset, tilt, sag, spread = settings
        distance = away - offset - tilt * along - sag * (along**2 - 1.0 / 3.0)
        pairs = zip(shifts, kernel[*taps.T], strict=True)
        shape = sum(weight * special.ndtr((distance - shift) / np.exp(spread)) for shift, weight in pairs)
        shape = shape - np.mean(shape)
        return np.asarray(shape * max(float(shape @ level), 0.0) / max(float(shape @ shape), 1e-30))

    start = [0.0, 0.0, 0.0, np.log(line.sigma)]
    best = optimize.least_squares(
        lambda settings: level - fit(settings), start, diff_step=1e-4, x_scale="jac", max_nfev=30
    )
    offset, tilt, sag, spread = best.x
    rise = float(np.ptp(fit(best.x)))
    contrast = rise / max(float(np.std(best.fun)), 1e-12)
    angle = float(line.angle - np.arctan(tilt / half))
    point = middle + offset * normal
    spread = float(np.exp(spread))
    return replace(line, point=point, angle=angle, sigma=spread, sag=float(sag), rise=rise, contrast=contrast)
