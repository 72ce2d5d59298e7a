"""Figures of a comparison: estimates, errors and scatter against the true distance (thesis 5.2.2 to 5.2.7)."""

from collections.abc import Sequence
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from psflut.limits import Limits
from psflut.plots.look import INK, TRUTH, Palette, Plot, palette_of, styled
from psflut.scores import BASELINE, at_positions, covered, errors, of_method, risk_coverage, scale, widths
from psflut.trial import KNOWN, Record

Floats = NDArray[np.floating]

MARKERS = "osD^vP"
BAND = (5.0, 50.0, 95.0)
"""Percentiles: runs are shaded between the outer ones."""


def _coloured(records: Sequence[Record], palette: Palette | None) -> list[tuple[str, str]]:
    """(method, colour) of those that are there, by a palette that others share or their own."""
    own = palette_of(record.method for record in records)
    return [(name, (palette or own)[name]) for name in own]


def best(records: Sequence[Record]) -> tuple[Floats, Floats]:
    """True positions and the estimate nearest to each, metres. The thesis shows these, which only the truth chooses."""
    groups = at_positions(records)
    nearest = [truth + min(errors(each), key=abs) for truth, each in groups.items()]
    return np.array(list(groups)), np.array(nearest)


@styled
def agreement(records: Sequence[Record], title: str = "", palette: Palette | None = None) -> Figure:
    """Estimate against truth, a panel a method: median, band of the runs, and the best run as the thesis shows it."""
    methods = _coloured(records, palette)
    columns = min(len(methods), 4)
    rows = -(-len(methods) // columns)
    figure = Plot(figsize=(2.7 * columns + 0.4, 2.7 * rows + 0.9), layout="constrained")
    figure.suptitle(fill(title, 24 * columns), fontsize=10)
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for axis, (method, colour) in zip(grid.ravel(), methods, strict=False):
        own = of_method(records, method)
        groups = at_positions(own)
        truths = np.array(list(groups))
        runs = max(map(len, groups.values()))
        low, middle, high = np.array([np.percentile([r.estimate for r in g], BAND) for g in groups.values()]).T
        axis.plot(truths[[0, -1]], truths[[0, -1]], color=TRUTH, lw=1, ls="--", label="truth")
        axis.fill_between(truths, low, high, color=colour, alpha=0.25, lw=0, label="5 to 95 % of the runs")
        axis.plot(truths, middle, color=colour, marker="o", ms=3, lw=1.2, label="median")
        axis.plot(*best(own), color=INK, lw=0.8, ls=":", marker="x", ms=4, label="best run (thesis)")
        axis.set_title(f"{method}, {runs} runs")
    for axis in grid.ravel()[len(methods) :]:
        axis.set_axis_off()
    for axis in grid[-1]:
        axis.set_xlabel("object distance (m)")
    for axis in grid[:, 0]:
        axis.set_ylabel("estimate (m)")
    handles, labels = grid[0, 0].get_legend_handles_labels()
    handles[1:3] = [Patch(color=INK, alpha=0.25, lw=0), Line2D([], [], color=INK, marker="o", ms=3, lw=1.2)]
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
    return figure


@styled
def relative_errors(
    records: Sequence[Record], span: float | None = None, title: str = "", palette: Palette | None = None
) -> Figure:
    """Median absolute error against truth, in per cent of it (or of a stage's span), and the baseline's best run."""
    figure, axis = _single(title)
    for marker, (method, colour) in zip(MARKERS, _coloured(records, palette), strict=False):
        groups = at_positions(of_method(records, method))
        middle = [100 * np.median(np.abs(errors(each)) / scale(each, span)) for each in groups.values()]
        axis.plot(list(groups), middle, color=colour, marker=marker, ms=4, lw=1.2, label=method)
    for method, colour in _coloured(records, palette):
        if method.removesuffix(KNOWN) == BASELINE:
            truths, nearest = best(of_method(records, method))
            share = 100 * np.abs(nearest - truths) / (truths if span is None else span)
            axis.plot(
                truths, share, color=colour, marker="x", ms=4, lw=0.8, ls=":", label=f"{method}, best run (thesis)"
            )
    axis.set_ylabel(f"median error (% of {'the distance' if span is None else 'the range'})")
    return _finished(figure, axis)


@styled
def scatter(
    records: Sequence[Record], bound: Limits | None = None, title: str = "", palette: Palette | None = None
) -> Figure:
    """Standard deviation of the runs at every distance, and the Cramer-Rao bound for scenes of median contrast.

    Where the bound comes near the table's range, also the least that an estimate kept within the range can scatter.
    """
    figure, axis = _single(title)
    for marker, (method, colour) in zip(MARKERS, _coloured(records, palette), strict=False):
        groups = {z: errors(each) for z, each in at_positions(of_method(records, method)).items() if len(each) > 1}
        spread = [100 * np.std(each, ddof=1) for each in groups.values()]
        axis.plot(list(groups), spread, color=colour, marker=marker, ms=4, lw=1.2, label=method)
    truths = [record.truth for record in records]
    if bound is not None:
        axis.plot(bound.axis, 100 * bound.crb, color=TRUTH, lw=1.5, ls="--", label="Cramer-Rao bound, median contrast")
        seen = (bound.axis >= min(truths)) & (bound.axis <= max(truths))
        if np.any(bound.within[seen] < 0.95 * bound.crb[seen]):
            axis.plot(
                bound.axis, 100 * bound.within, color=TRUTH, lw=1, ls=":", label="the same within the table's range"
            )
        margin = 0.03 * (float(np.ptp(truths)) or max(truths))  # all may be at one distance
        axis.set_xlim(min(truths) - margin, max(truths) + margin)
    axis.set_ylabel("standard deviation of the runs (cm)")
    return _finished(figure, axis)


@styled
def reliability(records: Sequence[Record], level: float, span: float | None = None, title: str = "") -> Figure:
    """Whether intervals are honest, how wide they are, and what the surest patches err."""
    figure = Plot(figsize=(11.0, 3.9), layout="constrained")
    figure.suptitle(fill(title, 120), fontsize=10)
    covers, width, risk = figure.subplots(1, 3)
    methods = palette_of(record.method for record in records)
    for marker, (method, colour) in zip(MARKERS, methods.items(), strict=False):
        own = of_method(records, method)
        groups = at_positions(own)
        dashes = "--" if method.endswith(KNOWN) else "-"
        line = {"color": colour, "marker": marker, "ms": 4, "lw": 1.2, "ls": dashes, "label": method}
        covers.plot(list(groups), [100 * covered(each).mean() for each in groups.values()], **line)
        width.plot(list(groups), [100 * np.median(widths(each)) for each in groups.values()], **line)
        kept, error = risk_coverage(own, span)
        risk.plot(100 * kept, 100 * error, color=colour, lw=1.2, ls=dashes)
    covers.axhline(100 * level, color=TRUTH, lw=1, ls=":")
    covers.set(ylim=(-3, 103), xlabel="object distance (m)", ylabel=f"{level:.0%} intervals that cover (%)")
    width.set(yscale="log", xlabel="object distance (m)", ylabel=f"median width of {level:.0%} intervals (cm)")
    of = "the distance" if span is None else "the range"
    risk.set(yscale="log", xlabel="patches kept, narrowest intervals first (%)", ylabel=f"their mean error (% of {of})")
    figure.legend(*covers.get_legend_handles_labels(), loc="outside lower center", ncols=len(methods))
    return figure


@styled
def times(records: Sequence[Record], title: str = "") -> Figure:
    """What methods cost. Apart from the other figures: it alone differs from run to run."""
    methods = palette_of(record.method for record in records)
    figure = Plot(figsize=(6.4, 1.3 + 0.35 * len(methods)), layout="constrained")
    axis = figure.subplots()
    axis.set_title(fill(title, 90))
    seconds = [float(np.median([r.seconds for r in of_method(records, method)])) for method in methods]
    bars = axis.barh(list(methods), seconds, color=list(methods.values()))
    axis.bar_label(bars, fmt="%.2g s", padding=3)
    axis.invert_yaxis()
    axis.margins(x=0.12)
    axis.set(xscale="log", xlabel="median time of a patch on one core (s)")
    return figure


def _single(title: str) -> tuple[Figure, Axes]:
    figure = Plot(figsize=(6.4, 4.2), layout="constrained")
    axis = figure.subplots()
    axis.set_title(fill(title, 90))
    return figure, axis


def _finished(figure: Figure, axis: Axes) -> Figure:
    axis.set_yscale("log", nonpositive="mask")
    axis.set_xlabel("object distance (m)")
    figure.legend(loc="outside upper center", ncols=2)
    return figure
