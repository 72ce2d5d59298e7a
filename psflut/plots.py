"""Figures: results in, Figure out. One look, units on every axis, colours that colour-blind readers tell apart."""

import io
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from pathlib import Path
from textwrap import fill
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from psflut.errors import PsflutError
from psflut.estimation import Estimate, Outcome
from psflut.files import staged
from psflut.table import PSFTable
from psflut.units import format_length

Floats = NDArray[np.floating]

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Of Okabe and Ito, in the order in which methods take them."""

LOWEST_LOG = -60.0
"""Nats below its peak to which a log density is shown."""

INCH = 0.0254
TRUTH, INK = "#222222", "#444444"
LOOK: Any = {
    "font.family": "sans-serif",
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.labelsize": 9,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "figure.dpi": 120,
    "savefig.dpi": 160,
    "image.cmap": "gray",
}


class Plot(Figure):
    """A Figure that shows itself in a notebook, whether or not pyplot was ever imported."""

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        with mpl.rc_context(LOOK):
            self.savefig(buffer, format="png", dpi=110, metadata={"Software": None})
        return buffer.getvalue()


def _styled(draw: Callable[..., Figure]) -> Callable[..., Figure]:
    @wraps(draw)
    def wrapper(*args: Any, **kwargs: Any) -> Figure:
        with mpl.rc_context(LOOK):
            return draw(*args, **kwargs)

    return wrapper


@_styled
def pictures(images: Mapping[str, Floats], title: str = "", columns: int = 4) -> Figure:
    """Images side by side, each with its name above and its own grey range (1st to 99th percentile)."""
    columns = min(columns, len(images))
    rows = -(-len(images) // columns)
    figure = Plot(figsize=(2.5 * columns, 2.75 * rows + 0.3), layout="constrained")
    figure.suptitle(title, fontsize=10)
    axes = np.atleast_1d(figure.subplots(rows, columns)).ravel()
    for axis, (name, image) in zip(axes, images.items(), strict=False):
        low, high = np.percentile(image, [1, 99])
        axis.imshow(image, vmin=low, vmax=max(high, low + 1e-9), interpolation="nearest")
        axis.set_title(name)
    for axis in axes:
        axis.set_axis_off()
    return figure


@_styled
def psfs(table: PSFTable, count: int = 8) -> Figure:
    """A contact sheet of a table: PSFs at `count` distances, and below each the course through its middle."""
    positions = table.candidates(count)
    planes = table.at(positions)
    figure = Plot(figsize=(1.5 * count, 3.4), layout="constrained")
    figure.suptitle("point spread functions, each scaled to its own peak; below: cut through the centre", fontsize=10)
    top, bottom = figure.subplots(2, count, height_ratios=(1.0, 0.7))
    reach = table.size / 2 * table.pixel_pitch * 1e6
    offsets = (np.arange(table.size) - table.size // 2) * table.pixel_pitch * 1e6
    for k, (position, plane) in enumerate(zip(positions, planes, strict=True)):
        top[k].imshow(plane, cmap="magma", extent=(-reach, reach, reach, -reach), interpolation="nearest")
        top[k].set_title(format_length(float(position)))
        top[k].set_axis_off()
        bottom[k].step(offsets, plane[table.size // 2], where="mid", color=COLOURS[0], lw=1)
        bottom[k].set(ylim=(0, None), xlim=(-reach, reach), xlabel="x (um)")
        bottom[k].tick_params(labelsize=7)
    bottom[0].set_ylabel("share of light\nin a pixel")
    return figure


@_styled
def ranges(table: PSFTable) -> Figure:
    """Where a measured table reads well: standard error along its axis, held-out errors, blind ranges shaded.

    Raises
    ------
    PsflutError
        If the table says nothing of its ranges: it was built by a recipe, not measured.
    """
    check = table.check or {}
    if "ranges" not in check:
        raise PsflutError("the table holds no ranges, which only measured ones have; draw its PSFs instead")
    found = check["ranges"]
    figure = Plot(figsize=(6.0, 3.6), layout="constrained")
    axis = figure.subplots()
    positions = np.array(found["positions_m"])
    by_distance = table.kind == "distance"

    def shown(error: Floats, at: Floats) -> Floats:
        return np.asarray(100.0 * np.abs(error) / at if by_distance else 1e3 * np.abs(error))

    std = np.array([np.nan if each is None else each for each in found["std_m"]])
    axis.plot(positions, shown(std, positions), color=COLOURS[0], label=f"point {found['snr']:g} times above the noise")
    if "expected_m" in check:
        places, errors = (np.array(check[name]) for name in ("positions_m", "expected_m"))
        axis.plot(places, shown(errors, places), "o", ms=4, color=COLOURS[1], label="expected from positions left out")
    limit = found["good_below"] * (1.0 if by_distance else np.ptp(table.axis))
    bound = 100.0 * limit if by_distance else 1e3 * limit
    axis.axhline(bound, color=INK, lw=0.8, ls="--", label="limit of a good range")
    for number, span in enumerate(found["blind_m"]):
        axis.axvspan(*span, color=INK, alpha=0.15, lw=0, label=None if number else "blind")
    axis.set(yscale="log", xlim=table.span, xlabel="distance (m)" if by_distance else "stage (m)")
    axis.set_ylabel("error (% of the distance)" if by_distance else "error (mm)")
    figure.legend(loc="outside upper center", ncols=2)
    return figure


@_styled
def curves(results: Mapping[str, Sequence[Estimate]], truths: Sequence[float]) -> Figure:
    """What every method (rows) made of every candidate distance, for captures at `truths` (columns, metres).

    With one capture the methods stand side by side instead.
    """
    shape = (len(results), len(truths)) if len(truths) > 1 else (1, len(results))
    figure = Plot(figsize=(3.2 * shape[1], 1.8 * shape[0] + 0.8), layout="constrained")
    grid = figure.subplots(*shape, squeeze=False)
    for row, (colour, (method, estimates)) in enumerate(zip(COLOURS, results.items(), strict=False)):
        for column, (found, truth) in enumerate(zip(estimates, truths, strict=True)):
            axis = grid[row, column] if len(truths) > 1 else grid[0, row]
            curve(axis, found, colour)
            axis.axvline(truth, color=TRUTH, lw=1, ls="--", label="truth")
            axis.set_title(f"{method}, object at {truth:g} m")
    for axis in grid[-1]:
        axis.set_xlabel("distance (m)")
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def curve(axis: Axes, found: Estimate, colour: str) -> None:
    """One method's curve or samples, with its estimate and interval, into an Axes."""
    near, far = found.interval
    axis.axvspan(near, far, color=colour, alpha=0.2, lw=0, label=f"{found.level:.0%} interval")
    axis.axvline(found.distance, color=colour, lw=1.5, label="estimate")
    axis.xaxis.set_major_locator(MaxNLocator(4))
    if "distances" in found.detail:
        samples = found.detail["distances"]
        axis.hist(samples, bins=60, density=True, color=colour, alpha=0.8)
        reach = max(1.2 * (far - near), 1e-3)
        span = np.array([found.distance - reach, found.distance + reach])
        axis.set(ylabel="density (1/m)", xlim=np.clip(span, samples.min() - 0.1 * reach, samples.max() + 0.1 * reach))
    elif found.curve is not None and found.curve.label.startswith("log"):
        values = found.curve.value - np.max(found.curve.value)
        axis.plot(found.curve.position, values, color=colour, lw=1.2)
        axis.set(ylabel=fill(found.curve.label, 18), ylim=(1.1 * max(np.min(values), LOWEST_LOG), 0.5))
    elif found.curve is not None:
        order = np.argsort(found.curve.position)
        axis.plot(found.curve.position[order], found.curve.value[order], color=colour, lw=1.2, marker=".", ms=2)
        axis.set(ylabel=fill(found.curve.label, 18))
        if np.min(found.curve.value) > 0:
            axis.set_yscale("log")
    if found.outcome is not Outcome.OK:
        axis.text(0.02, 0.95, found.outcome.name.lower(), transform=axis.transAxes, va="top", color=INK)


@_styled
def page(picture: Floats, dot: float, paper: tuple[float, float], place: float, words: str) -> Figure:
    """A page to print: a black and white picture, words and a scale of 100 mm below it.

    Parameters
    ----------
    picture : (H, W) array
        0 is black, 1 white.
    dot, place : float
        Side of a dot of the picture, and its distance from the left and upper rim; metres.
    paper : (float, float)
        Height and width of the page, metres.
    """
    height, width = paper
    across, down = dot * picture.shape[1], dot * picture.shape[0]
    figure = Plot(figsize=(width / INCH, height / INCH))
    bottom = height - place - down
    axis = figure.add_axes((place / width, bottom / height, across / width, down / height))
    axis.imshow(picture, vmin=0, vmax=1, interpolation="none", aspect="auto")
    axis.set_axis_off()
    ruler = figure.add_axes((0.02 / width, 0.009 / height, 0.1 / width, 0.003 / height))
    ruler.set(xlim=(0, 100), ylim=(0, 1), yticks=[], xticks=range(0, 101, 10))
    ruler.barh([0.5], [10] * 10, 1.0, left=range(0, 100, 10), color=["black", "white"] * 5, edgecolor="black", lw=0.5)
    ruler.tick_params(length=0, labelsize=6)
    figure.text(0.127 / width, 0.0095 / height, "mm", fontsize=7)
    figure.text(0.02 / width, (bottom - 0.001) / height, fill(words, 125), fontsize=7, va="top", color=INK)
    return figure


def save(figure: Figure, path: Path, overwrite: bool = True) -> None:
    """Write a figure whole or not at all; without a date, so the same figure gives the same bytes."""
    kind = path.suffix.lstrip(".").lower()
    metadata = {"CreationDate": None} if kind == "pdf" else {"Software": None}
    with mpl.rc_context(LOOK), staged(path, overwrite) as stage:
        figure.savefig(stage, format=kind, metadata=metadata)
