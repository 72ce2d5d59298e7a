"""Figures of estimates: what a method made of every candidate distance."""

from collections.abc import Mapping, Sequence
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from scipy.interpolate import PchipInterpolator

from psflut.estimation import Estimate, Outcome
from psflut.plots.look import INK, TRUTH, Palette, Plot, palette_of, styled

LOWEST_LOG = -20.0
"""Nats below its peak to which a log density is shown, and the distances where it is higher."""


@styled
def curves(
    results: Mapping[str, Sequence[Estimate]], truths: Sequence[float], palette: Palette | None = None
) -> Figure:
    """What every method (rows) made of every candidate distance, for captures at `truths` (columns, metres).

    With one capture the methods stand side by side instead, three in a row. Colours are those of a palette that other
    figures share, or their own.
    """
    shape = (len(results), len(truths)) if len(truths) > 1 else (-(-len(results) // 3), min(len(results), 3))
    figure = Plot(figsize=(3.2 * shape[1], 1.8 * shape[0] + 0.8), layout="constrained")
    grid = figure.subplots(*shape, squeeze=False)
    colours = palette or palette_of(results)
    for row, (method, estimates) in enumerate(results.items()):
        for column, (found, truth) in enumerate(zip(estimates, truths, strict=True)):
            axis = grid[row, column] if len(truths) > 1 else grid.flat[row]
            curve(axis, found, colours[method])
            axis.axvline(truth, color=TRUTH, lw=1, ls="--", label="truth")
            show(axis, truth)
            axis.set_title(f"{method}, object at {truth:.4g} m")
    for axis in grid[-1] if len(truths) > 1 else grid.flat:
        axis.set_xlabel("distance (m)")
    for axis in grid.flat[len(results) * len(truths) :]:
        axis.set_axis_off()
    _, labels = grid[0, 0].get_legend_handles_labels()
    handles = [Patch(color=INK, alpha=0.2, lw=0), Line2D([], [], color=INK, lw=1.5), grid[0, 0].lines[-1]]
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def show(axis: Axes, place: float) -> None:
    """Widen an Axes, if it must be, until a distance is in it."""
    low, high = axis.get_xlim()
    margin = 0.05 * (high - low)
    axis.set_xlim(min(low, place - margin), max(high, place + margin))


def curve(axis: Axes, found: Estimate, colour: str) -> None:
    """One method's curve or samples, with its estimate and interval, into an Axes."""
    near, far = found.interval
    axis.axvspan(near, far, color=colour, alpha=0.2, lw=0, label=f"{found.level:.0%} interval")
    axis.axvline(found.distance, color=colour, lw=1.5, label="estimate")
    axis.xaxis.set_major_locator(MaxNLocator(4))
    if "distances" in found.detail:
        samples = found.detail["distances"]
        reach = max(1.2 * (far - near), 1e-3)
        span = np.array([found.distance - reach, found.distance + reach])
        reached = np.clip(span, samples.min() - 0.1 * reach, samples.max() + 0.1 * reach)
        axis.hist(samples, bins=60, range=tuple(reached), density=True, color=colour, alpha=0.8)
        axis.set(xlabel="distance (m)", ylabel="density (1/m)", xlim=reached)
    elif found.curve is not None and found.curve.label.startswith("log"):
        values = found.curve.value - np.max(found.curve.value)
        order = np.argsort(found.curve.position)
        smooth = PchipInterpolator(found.curve.position[order], values[order])
        seen = np.append(found.curve.position[values > LOWEST_LOG], found.interval)
        margin = 0.1 * float(np.ptp(seen))
        low, high = max(seen.min() - margin, smooth.x[0]), min(seen.max() + margin, smooth.x[-1])
        positions = np.linspace(float(low), float(high), 500)
        axis.plot(positions, smooth(positions), color=colour, lw=1.2)
        floor = 1.1 * max(np.min(values), LOWEST_LOG)
        axis.set(ylabel=fill(found.curve.label, 18), xlim=(low, high), ylim=(floor, 0.5))
    elif found.curve is not None:
        order = np.argsort(found.curve.position)
        axis.plot(found.curve.position[order], found.curve.value[order], color=colour, lw=1.2, marker=".", ms=2)
        axis.set(ylabel=fill(found.curve.label, 18))
        if np.min(found.curve.value) > 0:
            axis.set_yscale("log")
    if found.outcome is not Outcome.OK:
        axis.text(0.02, 0.95, found.outcome.name.lower(), transform=axis.transAxes, va="top", color=INK).set_bbox(
            {"color": axis.get_facecolor(), "pad": 1}
        )
