"""The Bayesian uncertainty report of one patch: every estimator asked, one self-contained page of HTML.

What the page says is worked out here, in `psflut.findings` and in `psflut.origins`; how it looks is ``report.html``.
Equal patches, tables and seeds give equal bytes: the page holds no times of the day and none that a computer took.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from psflut import family, findings, origins
from psflut.errors import PsflutError
from psflut.estimation import Estimate, Observation, estimate, for_any_scene
from psflut.files import refuse_overwrite, staged
from psflut.plots import posteriors, reports
from psflut.plots.inline import png, svg
from psflut.table import PSFTable

Floats = NDArray[np.float64]

REFERENCE = "posterior"
"""The method that the report is about; the others stand beside it."""


@dataclass(frozen=True, eq=False)
class Report:
    """What `report` found; it shows itself in a notebook.

    Parameters
    ----------
    html : str
        The whole page.
    estimates : mapping
        By method; ``posterior`` is what the page is about.
    intervals : mapping
        By level, (near, far) in metres.
    """

    html: str
    estimates: Mapping[str, Estimate]
    intervals: Mapping[float, tuple[float, float]]

    def save(self, path: Path | str, overwrite: bool = False) -> None:
        """Write the page, whole or not at all.

        Raises
        ------
        PsflutError
            If the name does not end in .html, the file exists and may not be replaced, or cannot be written.
        """
        check_page(Path(path), overwrite)
        with staged(Path(path), overwrite) as stage:
            stage.write_text(self.html, encoding="utf-8")

    def _repr_html_(self) -> str:
        page = escape(self.html, quote=True)
        return f'<iframe srcdoc="{page}" title="report" sandbox width="100%" height="900" style="border:0"></iframe>'


def check_page(path: Path, overwrite: bool) -> None:
    """Refuse, before the work, a path that `Report.save` would refuse after it."""
    if path.suffix.lower() not in (".html", ".htm"):
        raise PsflutError(f"a report's name ends in .html, got {path.name}")
    refuse_overwrite(path, overwrite)


def report(
    observation: Observation,
    table: PSFTable,
    *,
    name: str = "a patch",
    about: Mapping[str, str] | None = None,
    seed: int = 0,
    watch: Callable[[Iterable[str]], Iterable[str]] = iter,
) -> Report:
    """Ask every method that takes any scene, and report on the posterior of distance.

    Parameters
    ----------
    observation : Observation
    table : PSFTable
    name : str
        Of the image, for the heading.
    about : mapping or None
        More to tell of where the patch and the table come from, by heading.
    seed : int
        Of every method that has one.
    watch : callable
        Wraps the names of the methods while they are asked one after the other: a progress bar.

    Raises
    ------
    PsflutError
        As `estimate` raises it for the posterior; what another method refuses is told in its row.
    """
    estimates, refusals = {}, {}
    for method in watch(sorted(for_any_scene(), key=lambda method: method != REFERENCE)):
        part = family.load("psflut.estimators", method)
        settings = {"seed": seed} if "seed" in {field.name for field in fields(part)} else {}
        try:
            estimates[method] = estimate(observation, table, part(**settings))
        except PsflutError as error:
            if method == REFERENCE:
                raise
            refusals[method] = str(error)
    found = estimates[REFERENCE]
    intervals = findings.intervals(found, table)
    facts = {
        "name": name,
        "found": found,
        "intervals": intervals,
        "patch": png(observation.image),
        "shape": observation.image.shape,
        "restored": png(found.detail["restored"]) if "restored" in found.detail else None,
        "figures": _figures(estimates, intervals, table),
        "estimates": estimates,
        "refusals": refusals,
        "findings": findings.sentences(found, table),
        "tables": origins.provenance(observation, table, found, {**(about or {}), "seed": str(seed)}),
        "citations": origins.citations(),
    }
    return Report(_page(facts), estimates, intervals)


def _page(facts: Mapping[str, Any]) -> str:
    import jinja2

    shapes = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    shapes.filters["length"] = findings.length
    return shapes.from_string(files("psflut").joinpath("report.html").read_text(encoding="utf-8")).render(facts)


def _figures(
    estimates: Mapping[str, Estimate], intervals: Mapping[float, tuple[float, float]], table: PSFTable
) -> dict[str, tuple[str, str]]:
    """Of each figure that the estimate has the material for: its SVG, and what it shows in words."""
    found = estimates[REFERENCE]
    along = f"{table.kind} (m)"
    drawn = {"methods": reports.methods(estimates, REFERENCE, along)}
    if "chain" in found.detail:
        samples, points = found.detail["distances"], found.detail["chain"]
        seen, names, theta = found.detail["prediction"], found.detail["names"], findings.coefficients(found)
        picked, labels = findings.pairs(samples, points, names, along)
        drawn |= {
            "posterior": posteriors.posterior(samples, intervals, found.modes, table.span, along),
            "priors": posteriors.priors(samples, findings.prior(table), theta, *findings.prior_spectrum(), along),
            "spectrum": reports.spectrum(seen.frequency, seen.power, seen.noise, seen.mean, seen.replicated),
            "corner": posteriors.corner(picked, labels),
            "chain": posteriors.chain(table.position(points[:, :, 0]), found.stats["autocorrelation_time"], along),
        }
    if "budget" in found.stats:
        drawn["budget"] = reports.budget(found.stats["budget"])
    words = findings.descriptions(estimates, intervals)
    return {name: (svg(figure, name, words[name]), words[name]) for name, figure in drawn.items()}
