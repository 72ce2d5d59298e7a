"""The summary of a comparison: as numbers for a CSV, as words for a prompt, as a table in Markdown."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from psflut.estimation import Outcome
from psflut.scores import BASELINE, KEPT, Score


def rows(found: Sequence[Score]) -> list[list[Any]]:
    """The summary as numbers: a line of names, then a method a line."""
    kept = [f"mean_error_of_surest_{share:.0%}" for share in KEPT]
    names = ["method", "captures", "median_error_m", "median_error", "rmse_m", "bias_m", "scatter_m", "coverage"]
    names += ["width_m", *kept, *(f"share_{o.name.lower()}" for o in Outcome)]
    names += ["milliseconds", f"ratio_to_{BASELINE}", "ratio_low", "ratio_high"]
    return [
        names,
        *([each if isinstance(each, str | int) else float(f"{each:.5g}") for each in _row(s)] for s in found),
    ]


def _row(s: Score) -> list[Any]:
    errors = [s.median_error, s.median_relative, s.rmse, s.bias, s.scatter]
    numbers = [*errors, s.coverage, s.width, *s.kept, *s.outcomes.values(), s.milliseconds, *s.ratio]
    return [s.method, s.captures, *(float(f"{each:.5g}") for each in numbers)]


def words(found: Sequence[Score], span: float | None = None) -> list[list[str]]:
    """The summary for a person: centimetres, per cent; a line of names, then a method a line."""
    of = "of distance" if span is None else "of range"
    kept = [f"surest {share:.0%}: mean" for share in KEPT]
    names = ["method", "captures", "median error", of, "RMSE", "bias", "scatter", "95 % cover", "width", *kept]
    names += ["outcomes", "ms", f"error / {BASELINE}"]
    return [names, *(_words(each) for each in found)]


def _words(s: Score) -> list[str]:
    metres = s.median_error, s.rmse, s.bias, s.scatter, s.width
    lengths = ["" if np.isnan(each) else f"{100 * each:.3g} cm" for each in metres]  # one capture has no scatter
    outcomes = ", ".join(f"{name} {share:.0%}" for name, share in s.outcomes.items() if share)
    ratio, low, high = s.ratio
    compared = "" if np.isnan(ratio) else f"{ratio:.2g} ({low:.2g} to {high:.2g})"
    return [
        s.method,
        str(s.captures),
        lengths[0],
        f"{s.median_relative:.2%}",
        *lengths[1:4],
        f"{s.coverage:.0%}",
        lengths[4],
        *(f"{each:.2%}" for each in s.kept),
        outcomes,
        f"{s.milliseconds:.3g}",
        compared,
    ]


def markdown(table: Sequence[Sequence[str]]) -> str:
    """Lines of words as a table in Markdown."""
    lines = [f"| {' | '.join(row)} |" for row in table]
    return "\n".join([lines[0], "|" + "---|" * len(table[0]), *lines[1:], ""])
