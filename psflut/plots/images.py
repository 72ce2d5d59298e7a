"""Figures of images: pictures side by side, a page to print."""

from collections.abc import Mapping, Sequence
from textwrap import fill

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from psflut.plots.look import INK, Plot, middle, styled

Floats = NDArray[np.floating]

INCH = 0.0254


@styled
def pictures(images: Mapping[str, Floats], title: str = "", columns: int = 4, psfs: Sequence[str] = ()) -> Figure:
    """Images side by side, each with its name above and its own grey range (1st to 99th percentile).

    Those named in `psfs` are shown from zero to their peak instead, and all as far out as the widest has light.
    """
    narrow = dict(zip(psfs, middle([images[name] for name in psfs]), strict=True)) if psfs else {}
    columns = min(columns, len(images))
    rows = -(-len(images) // columns)
    figure = Plot(figsize=(2.5 * columns, 2.75 * rows + 0.3), layout="constrained")
    figure.suptitle(title, fontsize=10)
    axes = np.atleast_1d(figure.subplots(rows, columns)).ravel()
    for axis, (name, image) in zip(axes, images.items(), strict=False):
        shown = narrow.get(name, image)
        low, high = (0.0, image.max()) if name in psfs else np.percentile(image, [1, 99])
        colours = "magma" if name in psfs else None
        axis.imshow(shown, vmin=low, vmax=max(high, low + 1e-9), cmap=colours, interpolation="nearest")
        axis.set_title(name)
    for axis in axes:
        axis.set_axis_off()
    return figure


@styled
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
