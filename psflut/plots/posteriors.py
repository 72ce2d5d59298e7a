"""Figures of a sampled posterior: distance, its prior, pairs of parameters, the chain itself."""

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from scipy import fft
from scipy.ndimage import gaussian_filter, gaussian_filter1d

from psflut.density import Mode
from psflut.plots.look import COLOURS, INK, Plot, styled

Floats = NDArray[np.float64]

LIGHT_MODE = 0.01
"""Modes of less probability get no panel of their own."""

BINS, SMOOTH = 200, 5
"""Of a density's histogram, and the standard deviation of its smoothing, in bins: a twentieth of the range's width."""

TONES = (0.25, 0.5, 0.75)
"""Of the intervals, widest first."""

SQUARE, MASSES = 40, (0.95, 0.68, 0.39)
"""Bins a side of a density of two parameters, and the probability within its contours."""

WALKERS, POINTS = 8, 250
"""Of a chain that are drawn: a line each, through so many points."""


@styled
def posterior(
    samples: Floats,
    intervals: Mapping[float, tuple[float, float]],
    modes: Sequence[Mode],
    span: tuple[float, float],
    along: str,
) -> Figure:
    """The density of distance (samples in metres), a panel a mode, its intervals (by level) in deepening tones.

    Nothing lies outside the table's `span`; `along` is what an axis of distance is called, here and below:
    "distance (m)", or "stage (m)".
    """
    shown = [mode.distance for mode in modes if mode.weight >= LIGHT_MODE]
    parts = _parts(samples, shown)
    figure = Plot(figsize=(5.0, 2.9), layout="constrained")
    for axis, part in zip(figure.subplots(1, len(parts), sharey=True, squeeze=False)[0], parts, strict=True):
        centres, density = _density(part, len(part) / samples.size, span)
        axis.plot(centres, density, color=COLOURS[0], lw=1.5)
        for tone, (level, (near, far)) in zip(TONES, sorted(intervals.items(), reverse=True), strict=False):
            inside = (centres >= near) & (centres <= far)
            axis.fill_between(centres, density, where=inside, color="white", lw=0)
            axis.fill_between(centres, density, where=inside, color=COLOURS[0], alpha=tone, lw=0, label=f"{level:.0%}")
        axis.axvline(min(shown, key=lambda mode: abs(mode - np.median(part))), color=COLOURS[1], lw=1.2)
        axis.set(xlabel=along, ylim=(0, None), xlim=centres[[0, -1]])
        axis.xaxis.set_major_locator(MaxNLocator(5 if len(parts) == 1 else 3))
    figure.axes[0].set_ylabel("density (1/m)")
    figure.axes[0].legend(title="interval", loc="upper left")
    return figure


@styled
def priors(
    samples: Floats, prior: tuple[Floats, Floats], theta: Floats, mean: Floats, sigma: Floats, along: str
) -> Figure:
    """What was known before and after: of distance over the whole table, and of the scene's spectrum.

    Parameters
    ----------
    samples : (n,) array
        Distances, metres.
    prior : (positions, density)
        Metres, 1 / metre.
    theta : (n, J) array
        Coefficients of ln S, whose prior is normal: `mean` and `sigma`, (J,) each.
    """
    figure = Plot(figsize=(5.0, 4.4), layout="constrained")
    top, bottom = figure.subplots(2, 1)
    top.plot(*prior, color=INK, ls="--", lw=1.2, label="prior")
    centres, density = _density(samples, 1.0, (prior[0].min(), prior[0].max()))
    top.fill_between(centres, density, color=COLOURS[0], alpha=0.5, lw=0, label="posterior")
    top.set(yscale="log", xlabel=along, ylabel="density (1/m)", ylim=(0.3 * prior[1].min(), 2 * density.max()))
    top.legend(loc="upper right")
    number = np.arange(1, len(mean))  # the contrast, number 0, is free
    bottom.bar(number, 4 * sigma[1:], bottom=mean[1:] - 2 * sigma[1:], width=0.7, color=INK, alpha=0.2, label="prior")
    spread = 2 * theta[:, 1:].std(axis=0)
    bottom.errorbar(number, theta[:, 1:].mean(axis=0), spread, fmt="o", ms=4, color=COLOURS[0], label="posterior")
    bottom.set(xlabel="coefficient of the scene's log spectrum", ylabel="value (nats), 2 sd", xticks=number)
    bottom.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    return figure


@styled
def corner(points: Floats, names: Sequence[str]) -> Figure:
    """Every pair of parameters: (n, D) points; contours hold 39, 68 and 95 % of them."""
    count = len(names)
    figure = Plot(figsize=(5.0, 5.0), layout="constrained")
    grid = figure.subplots(count, count, sharex="col")
    ranges = np.quantile(points, [0.001, 0.999], axis=0).T
    for row, column in product(range(count), repeat=2):
        axis = grid[row, column]
        if column > row:
            axis.remove()
            continue
        if column == row:
            axis.plot(*_density(points[:, row], 1.0), color=COLOURS[0], lw=1.2)
            axis.set(yticks=[], ylim=(0, None))
        else:
            _pair(axis, points[:, [column, row]], ranges[[column, row]])
        axis.xaxis.set_major_locator(MaxNLocator(2))
        axis.tick_params(labelsize=7)
        if column == 0 and row > 0:
            axis.set_ylabel(names[row], fontsize=8)
            axis.yaxis.set_major_locator(MaxNLocator(2))
        elif column < row:
            axis.set_yticks([])
        if row == count - 1:
            axis.set_xlabel(names[column], fontsize=8)
    figure.align_labels()
    return figure


@styled
def chain(walks: Floats, time: float, along: str) -> Figure:
    """Where walkers went, and how soon they forgot it.

    Parameters
    ----------
    walks : (steps, walkers) array
        Distances, metres.
    time : float
        The longest autocorrelation time of any parameter, steps.
    """
    figure = Plot(figsize=(5.0, 4.0), layout="constrained")
    top, bottom = figure.subplots(2, 1)
    steps = np.unique(np.linspace(0, len(walks) - 1, POINTS).astype(int))
    for walk in walks.T[:WALKERS]:
        top.plot(steps, walk[steps], color=COLOURS[0], alpha=0.45, lw=0.6)
    top.set(xlabel="step", ylabel=along, xlim=(0, len(walks)))
    lags = np.arange(min(len(walks), int(6 * time) + 2))
    bottom.plot(lags, _autocorrelation(walks)[: len(lags)], color=COLOURS[0], lw=1.5, label="of distance")
    bottom.axvline(time, color=COLOURS[1], lw=1.2, label="autocorrelation time, longest")
    bottom.axhline(0, color=INK, lw=0.6)
    bottom.set(xlabel="lag (steps)", ylabel="autocorrelation", xlim=(0, lags[-1]))
    bottom.legend(loc="upper right")
    return figure


def _parts(samples: Floats, modes: Sequence[float]) -> list[Floats]:
    """Samples by the mode that is nearest in 1 / distance or in it, whichever the modes' order says; near to far."""
    ordered = np.sort(np.asarray(modes))
    nearest = np.argmin(np.abs(samples[:, None] - ordered), axis=1)
    return [part for k in range(len(ordered)) if (part := samples[nearest == k]).size > 1]


def _density(samples: Floats, weight: float, span: tuple[float, float] = (-np.inf, np.inf)) -> tuple[Floats, Floats]:
    """Middles of bins within the span and the smoothed density of samples there; its integral is the weight."""
    low, high = np.quantile(samples, [0.0005, 0.9995])
    pad = 0.15 * (high - low) + 1e-9
    counts, edges = np.histogram(samples, BINS, range=(max(low - pad, span[0]), min(high + pad, span[1])))
    smooth = gaussian_filter1d(counts.astype(float), SMOOTH, mode="reflect")
    return 0.5 * (edges[1:] + edges[:-1]), weight * smooth / (samples.size * np.diff(edges))


def _pair(axis: Axes, points: Floats, ranges: Floats) -> None:
    """Contours of the density of two parameters."""
    counts, x, y = np.histogram2d(points[:, 0], points[:, 1], bins=SQUARE, range=ranges)
    smooth = gaussian_filter(counts, 1.5).T
    order = np.sort(smooth.ravel())[::-1]
    levels = [order[np.searchsorted(np.cumsum(order) / order.sum(), mass)] for mass in MASSES]
    middles = [0.5 * (edges[1:] + edges[:-1]) for edges in (x, y)]
    for level in np.unique(levels):
        axis.contourf(*middles, smooth, levels=[level, np.inf], colors=[COLOURS[0]], alpha=0.3)


def _autocorrelation(walks: Floats) -> Floats:
    """(steps,) mean over walkers of the autocorrelation, 1 at lag zero."""
    offset = walks - walks.mean()
    size = fft.next_fast_len(2 * len(walks))
    power = np.abs(fft.rfft(offset, size, axis=0)) ** 2
    lags = fft.irfft(power.mean(axis=1), size)[: len(walks)]
    return np.asarray(lags / lags[0])
