"""Figures of a table: its PSFs, where it reads well."""

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from psflut.errors import PsflutError
from psflut.plots.look import COLOURS, INK, Plot, styled
from psflut.table import PSFTable
from psflut.units import format_length

Floats = NDArray[np.floating]


@styled
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


@styled
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
