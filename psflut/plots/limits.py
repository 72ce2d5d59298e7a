"""The figure of the Cramer-Rao bound against distance."""

from collections.abc import Mapping

from matplotlib.figure import Figure

from psflut.limits import GOOD, Limits
from psflut.plots.look import COLOURS, INK, Plot, styled


@styled
def limits(bounds: Mapping[str, Limits], title: str = "") -> Figure:
    """Bounds against distance, each with its name; shaded where even the best of them is blind."""
    figure = Plot(figsize=(6.0, 3.6), layout="constrained")
    axis = figure.subplots()
    for colour, (name, found) in zip(COLOURS, bounds.items(), strict=False):
        axis.plot(found.axis, 100.0 * found.relative, color=colour, label=name)
    best = min(bounds.values(), key=lambda found: sum(last - first for first, last in found.blind))
    of = "distance" if best.kind == "distance" else "span"
    axis.axhline(100.0 * GOOD, color=INK, lw=0.8, ls="--", label="limit of a good range")
    for number, span in enumerate(best.blind):
        axis.axvspan(*span, color=INK, alpha=0.15, lw=0, label=None if number else "blind")
    axis.set(yscale="log", xlim=(best.axis[0], best.axis[-1]), title=title)
    axis.set(xlabel=f"{best.kind} (m)", ylabel=f"Cramer-Rao bound (% of the {of})")
    figure.legend(loc="outside upper center", ncols=3)
    return figure
