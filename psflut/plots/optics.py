"""Figures of optics: transfer functions beside those of theory, the filters of a set-up (thesis 2.5.3 to 5.1.1)."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from scipy.special import j1

from psflut.imagers import Imager
from psflut.optics import blur_radius
from psflut.plots.look import COLOURS, Plot, middle, styled
from psflut.table import PSFTable
from psflut.units import format_length

Floats = NDArray[np.floating]

FREQUENCIES = 200
"""From zero to half a cycle a pixel."""


@styled
def otfs(table: PSFTable, positions: Sequence[float]) -> Figure:
    """Cross-sections of transfer functions at some positions (metres): the table's, geometric optics', a Gaussian's.

    The last two (thesis 2.5.5 and 2.5.7), of light that falls on no pixels yet, need the table's camera; without one
    there is only the first.
    """
    curves = {"this table": _of_table(table, positions)}
    if table.camera is not None:
        waves = 2 * np.pi * _cycles() / table.pixel_pitch * np.abs(blur_radius(table.camera, positions))[:, None]
        safe = np.maximum(waves, 1e-9)
        curves = {"geometric optics (2.5.5)": 2 * j1(safe) / safe, "Gaussian (2.5.7)": np.exp(-(waves**2) / 4)} | curves
    figure = Plot(figsize=(3.1 * len(curves) + 0.4, 3.2), layout="constrained")
    axes = np.atleast_1d(figure.subplots(1, len(curves), sharey=True))
    for axis, (name, values) in zip(axes, curves.items(), strict=True):
        for colour, position, row in zip(COLOURS, positions, values, strict=False):
            axis.plot(1e-3 * _cycles() / table.pixel_pitch, row, color=colour, label=f"at {format_length(position)}")
        axis.axhline(0, color="0.8", lw=0.8, zorder=0)
        axis.set(title=name, xlabel="spatial frequency (cycles/mm)", xlim=(0, None))
    axes[0].set_ylabel("transfer function (share of contrast)")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=len(positions))
    return figure


def _cycles() -> Floats:
    """Cycles a pixel."""
    return np.linspace(0.0, 0.5, FREQUENCIES)


def _of_table(table: PSFTable, positions: Sequence[float]) -> Floats:
    """Real part along x, (positions, FREQUENCIES): phases turn about the middle of the PSF."""
    offset = np.arange(table.size) - table.size // 2
    return np.asarray(table.at(positions).sum(axis=1) @ np.cos(2 * np.pi * offset[:, None] * _cycles()))


@styled
def filters(table: PSFTable, position: float, imager: Imager) -> Figure:
    """The PSF at a position (metres) and the imager's kernel, each with its scale of values."""
    figure = Plot(figsize=(7.0, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    _plane(left, middle([table.at(position)])[0], f"PSF at {format_length(position)}")
    _plane(right, imager.kernel(), f"imager: {type(imager).__name__.lower()}")
    return figure


def _plane(axis: Axes, plane: Floats, title: str) -> None:
    reach = plane.shape[0] / 2
    limit = np.abs(plane).max()
    signed = plane.min() < 0
    shown = axis.imshow(
        plane,
        extent=(-reach, reach, reach, -reach),
        cmap="PuOr" if signed else "magma",
        vmin=-limit if signed else 0,
        vmax=limit,
        interpolation="nearest",
    )
    axis.set(title=title, xlabel="x (pixels)", ylabel="y (pixels)")
    for ticks in (axis.xaxis, axis.yaxis):
        ticks.set_major_locator(MaxNLocator(5, integer=True))
    axis.figure.colorbar(shown, ax=axis, label="weight (1)", fraction=0.046)
