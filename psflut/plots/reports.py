"""Figures of a report beside its posterior: the spectrum, where the error comes from, methods side by side."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from psflut.estimation import Estimate
from psflut.plots.look import COLOURS, INK, Plot, styled
from psflut.units import METRES, format_length

Floats = NDArray[np.float64]

REACH = 3.0
"""Of the figure of methods: half its width in widths of the reference's interval."""

RATIO = 3.0
"""Of observed to predicted power, up to which it is shown."""


@styled
def spectrum(frequency: Floats, power: Floats, noise: Floats, mean: Floats, replicated: Floats) -> Figure:
    """A patch's power by annulus (points) and what a posterior predicts: median, 95 % of replicas; below, the ratio.

    Parameters
    ----------
    frequency, power, noise : (K,) arrays
        Cycles a pixel; image units squared.
    mean, replicated : (n, K) arrays
        Draws of the mean power, and of powers that scatter about it.
    """
    figure = Plot(figsize=(5.0, 4.4), layout="constrained")
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1.0))
    middle = np.median(mean, axis=0)
    band = np.quantile(replicated, [0.025, 0.975], axis=0)
    for axis, scale in ((top, 1.0), (bottom, middle)):
        axis.fill_between(frequency, *(band / scale), color=COLOURS[0], alpha=0.25, lw=0, label="95 % of replicas")
        axis.plot(frequency, middle / scale, color=COLOURS[0], lw=1.2, label="predicted")
        axis.plot(frequency, power / scale, "o", ms=2.2, color=COLOURS[1], label="observed")
    top.plot(frequency, noise, color=INK, lw=1, ls="--", label="noise")
    top.set_xscale("log")
    bottom.set_xticks([0.02, 0.05, 0.1, 0.2, 0.5], ["0.02", "0.05", "0.1", "0.2", "0.5"])
    bottom.minorticks_off()
    lowest, highest = np.min([power, middle, noise]), np.max([power, middle])
    top.set(yscale="log", ylabel="power (full scale squared)", ylim=(0.3 * lowest, 5 * highest))
    top.legend(loc="upper right")
    bottom.set(ylabel="observed\nby predicted", xlabel="spatial frequency (cycles a pixel)", ylim=(0, RATIO))
    bottom.set_xlim(0.9 * frequency[0], 1.05 * frequency[-1])
    return figure


@styled
def budget(parts: Mapping[str, float]) -> Figure:
    """Standard deviations (metres) by where they come from, largest on top, and their sum in squares."""
    total = float(np.sqrt(sum(sd**2 for sd in parts.values())))
    rows = [*sorted(parts.items(), key=lambda part: -part[1]), ("together", total)]
    unit = next((unit for unit in ("m", "mm", "um") if total >= METRES[unit]), "nm")
    figure = Plot(figsize=(5.0, 0.4 * len(rows) + 0.6), layout="constrained")
    axis = figure.subplots()
    for place, (name, sd) in enumerate(reversed(rows)):
        axis.barh(place, sd / METRES[unit], height=0.6, color=INK if name == "together" else COLOURS[0], alpha=0.7)
        axis.annotate(
            format_length(float(f"{sd:.2g}")),
            (sd / METRES[unit], place),
            (4, 0),
            textcoords="offset points",
            va="center",
        )
    axis.set_yticks(range(len(rows)), [name for name, _ in reversed(rows)])
    axis.set(xlabel=f"standard deviation ({unit})", xlim=(0, 1.25 * total / METRES[unit]))
    return figure


@styled
def methods(results: Mapping[str, Estimate], reference: str, along: str) -> Figure:
    """Distance and interval of every method, around those of the reference; an arrow where one lies farther off."""
    near, far = results[reference].interval
    middle, half = 0.5 * (near + far), REACH * max(far - near, 1e-9)
    left, right = middle - half, middle + half
    figure = Plot(figsize=(5.0, 0.45 * len(results) + 0.7), layout="constrained")
    axis = figure.subplots()
    axis.axvspan(near, far, color=INK, alpha=0.12, lw=0)
    for place, (name, found) in enumerate(reversed(list(results.items()))):
        colour = COLOURS[0] if name == reference else COLOURS[1]
        if left < found.distance < right:
            axis.plot(
                np.clip(found.interval, left, right), [place] * 2, color=colour, lw=3, alpha=0.5, solid_capstyle="butt"
            )
            axis.plot(found.distance, place, "o", color=colour, ms=6)
        else:
            off, side = (left, "<") if found.distance <= left else (right, ">")
            axis.plot(off, place, side, color=colour, ms=8, clip_on=False)
            align = "left" if side == "<" else "right"
            step = (10 if side == "<" else -10, 0)
            axis.annotate(
                format_length(found.distance), (off, place), step, textcoords="offset points", ha=align, va="center"
            )
    axis.set_yticks(range(len(results)), list(results)[::-1])
    axis.set(xlim=(left, right), ylim=(-0.6, len(results) - 0.4), xlabel=along)
    return figure
