"""Photon transfer: read noise and gain of a camera from repeated frames of a scene at rest.

The model is that of `psflut.noise.Noise`: variance = read^2 + (signal - offset) / gain. Half the squared difference
of two frames is the variance of a pixel, free of the scene; their mean is its signal. Between the two lies a
straight line with the slope 1 / gain and the intercept read^2 - offset / gain: the offset itself is not in the data
(Janesick 2007, Photon Transfer, chapter 5).
"""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from psflut.errors import PsflutError
from psflut.noise import Noise

Floats = NDArray[np.float64]

LEAST = 200
"""Pixels of a bin of signal, or more; levels that many pixels share may leave half of it."""

ALIKE = 0.1
"""Correlation of neighbouring differences above which a bin is not noise alone."""

CLIPPED = 0.005
"""Share of clipped pixels above which the variance of a bin is not trusted."""


def photon_transfer(frames_by_position: Iterable[Sequence[Floats]], offset: float | None = None) -> Noise | None:
    """Noise of a camera from frames that show the same.

    Assumes that between the two frames of a pair nothing changed but the noise, and that it is independent from
    pixel to pixel: neither lossy compression nor demosaicing. Whether that holds is seen from the differences of
    neighbouring pixels, which noise leaves uncorrelated; a moving scene or drifting light does not. Quantisation is
    part of what is measured, and counts as read noise.

    Parameters
    ----------
    frames_by_position : iterable of sequences of (H, W) arrays
        The frames taken at each position, linear, image units, saturated pixels NaN. They are paired in their order;
        positions of one frame say nothing.
    offset : float or None
        Dark level of these frames, image units: 0 once a dark frame was subtracted. None takes the lowest signal,
        and what shot noise there is below it counts as read noise: the variance at higher signals is the same.

    Returns
    -------
    Noise or None
        None without repeated frames. Its gain is None where the variance does not grow with the signal; its read
        noise is never taken as less than a tenth of the noise at the lowest signal.

    Raises
    ------
    PsflutError
        If repeated frames are identical, or if in most pixels they differ by more than noise.
    """
    return noise_of([each for frames in frames_by_position for each in pair_bins(frames)], offset)


def pair_bins(frames: Sequence[Floats]) -> list[Floats]:
    """What `noise_of` needs to know of the frames at one position, in little room: an array for every pair of them."""
    return [_bins(first, second) for first, second in zip(frames[::2], frames[1::2], strict=False)]


def noise_of(bins: Sequence[Floats], offset: float | None = None) -> Noise | None:
    """As `photon_transfer`, of the `pair_bins` of all positions."""
    if not bins:
        return None
    signal, variance, count, likeness = np.concatenate(bins, axis=1)
    if not variance.any():
        raise PsflutError("the repeated frames show no noise, or are all clipped; give frames that were taken twice")
    noise_alone = likeness < ALIKE + 3.0 / np.sqrt(count)
    if count[noise_alone].sum() < 0.5 * count.sum():
        raise PsflutError(
            "repeated frames differ by more than noise, neighbouring pixels alike; "
            "keep scene and light steady, and the files free of lossy compression"
        )
    return _noise(signal[noise_alone], variance[noise_alone], count[noise_alone], offset)


def _noise(signal: Floats, variance: Floats, count: Floats, offset: float | None) -> Noise:
    intercept, slope, slope_error = fit_line(signal, variance, count)
    if slope < 3.0 * slope_error:
        return Noise(read=float(np.sqrt(np.average(variance, weights=count))), offset=offset or 0.0)
    dark = float(signal.min()) if offset is None else offset
    lowest = max(intercept + slope * signal.min(), np.finfo(float).tiny)
    return Noise(read=float(np.sqrt(max(intercept + slope * dark, 0.01 * lowest))), gain=1.0 / slope, offset=dark)


def _bins(first: Floats, second: Floats) -> Floats:
    """Of pixels of like signal, a column for each bin: mean signal, variance, pixels, likeness of neighbours.

    What a difference shares with those around it, a little drift of light or focus, is not counted as variance.
    Pixels are sorted by their four neighbours, whose noise is not their own: sorted by their own signal, those that
    noise raised would come together with brighter ones, and the line would be too flat.
    """
    clipped = np.isnan(first + second) | (first == 0.0) | (second == 0.0)
    mean = np.where(clipped, 0.0, (first + second) / 2.0)
    difference = np.where(clipped, 0.0, first - second)
    bright = np.nan_to_num((first + second) / 2.0, nan=np.inf)  # saturated ones gather in the last bins
    around = _neighbours(bright)
    labels = np.digitize(around, _edges(around))
    inner = (slice(1, -1), slice(1, -1))

    def total(values: NDArray[np.generic]) -> Floats:
        return np.asarray(np.bincount(labels.ravel(), weights=values.ravel()), dtype=np.float64)

    pixels, bad = total(np.ones(labels.shape)), total(clipped[inner])
    keep = (pixels >= LEAST / 2) & (bad <= CLIPPED * pixels)
    count = (pixels - bad)[keep]
    squares = total(difference[inner] ** 2)[keep]
    shared = total(difference[inner] * _neighbours(difference))[keep]
    alike = shared / np.where(squares > 0.0, squares, 1.0)
    return np.stack([total(mean[inner])[keep] / count, (squares - shared) / count / 2.0, count, alike])


def _neighbours(image: Floats) -> Floats:
    """Mean of the four neighbours of every pixel but those at the border."""
    return np.asarray(image[:-2, 1:-1] + image[2:, 1:-1] + image[1:-1, :-2] + image[1:-1, 2:]) / 4.0


def _edges(signal: Floats) -> Floats:
    """Between bins of as many pixels, 32 of them where the frame is large enough."""
    bins = int(np.clip(signal.size // LEAST, 1, 32))
    return np.unique(np.quantile(signal, np.arange(1, bins) / bins, method="nearest"))


def fit_line(signal: Floats, variance: Floats, count: Floats) -> tuple[float, float, float]:
    """Intercept, slope and the slope's standard error of variance against signal.

    A variance from n pixels has the relative standard error sqrt(2 / n). Bins further than twice that from the line
    count less (Huber); scatter beyond it widens the standard error.
    """
    design = np.stack([np.ones_like(signal), signal], axis=1)
    line, weight = np.full_like(variance, np.median(variance)), np.ones_like(variance)
    for _ in range(20):
        error = np.maximum(line, 0.1 * np.median(variance)) * np.sqrt(2.0 / count)
        scaled = design * (np.sqrt(weight) / error)[:, None]
        (intercept, slope), *_ = np.linalg.lstsq(scaled, variance * np.sqrt(weight) / error, rcond=None)
        line = design @ (intercept, slope)
        pull = np.abs(variance - line) / error
        weight = np.minimum(1.0, 2.0 / np.maximum(pull, 1e-12))
    scatter = max(1.0, float(np.mean(np.minimum(pull, 2.0) ** 2)))
    covariance = np.linalg.pinv(scaled.T @ scaled) * scatter
    return float(intercept), float(slope), float(np.sqrt(covariance[1, 1]))
