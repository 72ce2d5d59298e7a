"""Figures, a topic a file: results in, Figure out. One look, units on every axis."""

from psflut.plots.comparison import agreement, relative_errors, reliability, scatter, times
from psflut.plots.depthmaps import depthmap, risk_coverage
from psflut.plots.estimates import curve, curves
from psflut.plots.images import page, pictures
from psflut.plots.limits import limits
from psflut.plots.look import COLOURS, Plot, check_figure, palette_of, save
from psflut.plots.optics import filters, otfs
from psflut.plots.tables import psfs, ranges

__all__ = [
    "COLOURS",
    "Plot",
    "agreement",
    "check_figure",
    "curve",
    "curves",
    "depthmap",
    "filters",
    "limits",
    "otfs",
    "page",
    "palette_of",
    "pictures",
    "psfs",
    "ranges",
    "relative_errors",
    "reliability",
    "risk_coverage",
    "save",
    "scatter",
    "times",
]
