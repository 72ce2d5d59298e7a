"""Figures of maps of distance: the map beside its scene, how errors grow with the share of patches that is kept."""

from collections.abc import Mapping
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from psflut.plots.look import COLOURS, INK, TRUTH, Plot, styled

Floats = NDArray[np.floating]

GREY, MOST = "#bbbbbb", 1024
"""Of uncertain patches; pixels a side to which a scene is thinned for the figure."""

TICKS = np.array([1, 1.5, 2, 3, 4, 5, 6, 8, 10, 15, 20, 30, 40, 50, 60, 80, 100])
"""On the colour bar, times a power of ten."""


@styled
def depthmap(
    metres: Floats, sure: NDArray[np.bool_], about: Mapping[str, Any], image: Floats | None = None, title: str = ""
) -> Figure:
    """The scene, and beside it the distances of its patches; those that are not sure are grey.

    Parameters
    ----------
    metres, sure : (ny, nx) arrays
    about : mapping
        Of a `DepthMap`.
    image : (H, W) array or None
        The scene.
    """
    height, width = about["image_shape"]
    panels = 1 if image is None else 2
    side = 4.2 if width >= height else 4.2 * width / height
    figure = Plot(figsize=(side * panels + 1.0, side * height / width + 0.6), layout="constrained")
    axes = figure.subplots(1, panels, squeeze=False, sharex=True, sharey=True)[0]
    if image is not None:
        step = max(1, -(-max(image.shape) // MOST))
        shown = image[::step, ::step]
        low, high = np.percentile(shown, [0.5, 99.5])
        axes[0].imshow(shown, vmin=low, vmax=max(high, low + 1e-9), extent=(-0.5, width - 0.5, height - 0.5, -0.5))
        axes[0].set_title("scene")
    _map(figure, axes[-1], np.ma.array(metres, mask=~sure), about)
    words = f"{title or 'distance'} (grey: uncertain, {1 - sure.mean():.0%} of the patches)"
    axes[-1].set_title(fill(words, max(18, int(14 * side))))
    for axis in axes:
        axis.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xlabel="column (pixel)")
    axes[0].set_ylabel("row (pixel)")
    return figure


def _map(figure: Figure, axis: Axes, metres: Floats, about: Mapping[str, Any]) -> None:
    """Every patch as a square of its stride, about its centre."""
    rim = 0.5 * (about["size"] - about["stride"]) - 0.5
    right, bottom = (rim + about["stride"] * count for count in (metres.shape[1], metres.shape[0]))
    near, far = about["span_m"]
    scale = LogNorm(near, far) if about["axis"] == "distance" else Normalize(near, far)
    drawn = axis.imshow(
        metres, cmap="viridis_r", norm=scale, extent=(rim, right, bottom, rim), interpolation="none", zorder=2
    )
    axis.add_patch(Rectangle((rim, rim), right - rim, bottom - rim, color=GREY, zorder=1))
    bar = figure.colorbar(drawn, ax=axis, shrink=0.9)
    bar.set_label("distance (m)" if about["axis"] == "distance" else "stage (m)")
    if about["axis"] == "distance":
        ticks = [tick for tick in TICKS * 10.0 ** np.floor(np.log10(near)) if near <= tick <= far]
        bar.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks])
        bar.ax.minorticks_off()


@styled
def risk_coverage(kept: Floats, risk: Floats, covered: Floats, level: float, title: str = "") -> Figure:
    """Median error of the surest patches, and how many of their intervals hold, against the share that is kept."""
    figure = Plot(figsize=(6.4, 3.2), layout="constrained")
    figure.suptitle(title, fontsize=10)
    left, right = figure.subplots(1, 2)
    left.plot(100 * kept, 100 * risk, color=COLOURS[0], lw=1.5)
    left.set(ylabel="their median error (% of the distance)", ylim=(0, None))
    right.plot(100 * kept, 100 * covered, color=COLOURS[1], lw=1.5)
    right.axhline(100 * level, color=TRUTH, lw=1, ls=":")
    right.set(ylabel=f"{level:.0%} intervals that cover (%)", ylim=(60, 101))
    for axis in (left, right):
        axis.set_xlabel("patches kept, surest first (%)")
        axis.axvline(70, color=INK, lw=0.8, ls=":")
    return figure
