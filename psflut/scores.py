"""How well methods did in a comparison: error, bias, scatter, coverage, outcomes, time."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from psflut.estimation import Outcome
from psflut.trial import Record

Floats = NDArray[np.float64]

BASELINE = "golden_section"
"""The thesis' method, to which the errors of the others are compared."""

RESAMPLES, LEVEL = 2000, 0.95
"""Of the bootstrap, and the probability of its interval."""

KEPT = (0.8, 0.5)
"""Shares of the patches, those of the narrowest intervals, whose mean error the summary tells."""


@dataclass(frozen=True)
class Score:
    """What a summary says of a method. Lengths in metres; errors are estimate less truth.

    Parameters
    ----------
    median_error, rmse, bias : float
        Of all captures: median of the absolute error, root of the mean square, mean.
    median_relative : float
        Median absolute error as a share of the distance, or of the stage's range.
    scatter : float
        Standard deviation at a distance, pooled over distances; NaN where all have one run.
    coverage, width : float
        Share of intervals that hold the truth, and the median of their widths.
    kept : tuple of float
        Mean absolute error, as a share, of the patches that `KEPT` keeps.
    outcomes : dict
        Share of each outcome.
    milliseconds : float
        Median of an estimate.
    ratio : (float, float, float)
        Median absolute error over that of `BASELINE` on the captures that both saw, and its bootstrap interval; NaN
        without such captures.
    """

    method: str
    captures: int
    median_error: float
    median_relative: float
    rmse: float
    bias: float
    scatter: float
    coverage: float
    width: float
    kept: tuple[float, ...]
    outcomes: dict[str, float]
    milliseconds: float
    ratio: tuple[float, float, float]


def scores(records: Sequence[Record], span: float | None = None) -> list[Score]:
    """A score a method, in the order in which they come.

    Parameters
    ----------
    span : float or None
        Of a stage axis, metres: shares are of it. None: of each capture's distance.
    """
    return [_score(method, records, span) for method in dict.fromkeys(record.method for record in records)]


def of_method(records: Sequence[Record], method: str) -> list[Record]:
    """The records of one method."""
    return [record for record in records if record.method == method]


def errors(records: Sequence[Record]) -> Floats:
    """(N,) estimate less truth, metres."""
    return np.array([record.estimate - record.truth for record in records])


def widths(records: Sequence[Record]) -> Floats:
    """(N,) of the intervals, metres."""
    return np.array([record.far - record.near for record in records])


def covered(records: Sequence[Record]) -> NDArray[np.bool_]:
    """(N,) whether an interval holds the truth."""
    return np.array([record.near <= record.truth <= record.far for record in records])


def scale(records: Sequence[Record], span: float | None = None) -> Floats:
    """(N,) metres that a relative error is a share of."""
    return np.array([record.truth if span is None else span for record in records])


def risk_coverage(records: Sequence[Record], span: float | None = None) -> tuple[Floats, Floats]:
    """Share of patches kept, those of the narrowest intervals first, and their mean absolute relative error: (N,) each.

    An interval that tells good estimates from bad ones gives a curve that rises; one that says nothing, a flat one.
    """
    of = scale(records, span)
    order = np.argsort(widths(records) / of, kind="stable")
    count = np.arange(1, len(records) + 1)
    return count / len(records), np.cumsum(np.abs(errors(records) / of)[order]) / count


def paired_ratio(records: Sequence[Record], others: Sequence[Record]) -> tuple[float, float, float]:
    """Median absolute error of records over that of others, on the captures that both hold, with its interval.

    The interval is the percentile bootstrap's: captures are drawn anew, each with both its errors, as if they were
    independent.
    """
    mine, theirs = ({(r.position, r.run): abs(r.estimate - r.truth) for r in each} for each in (records, others))
    both = [(mine[key], theirs[key]) for key in sorted(mine.keys() & theirs.keys())]
    if not both:
        return float("nan"), float("nan"), float("nan")
    pairs = np.array(both)
    drawn = np.random.default_rng(0).integers(len(pairs), size=(RESAMPLES, len(pairs)))
    found = np.concatenate([np.median(pairs, axis=0)[None], np.median(pairs[drawn], axis=1)])
    ratios = found[:, 0] / np.maximum(found[:, 1], 1e-12)
    low, high = np.quantile(ratios[1:], [0.5 - LEVEL / 2, 0.5 + LEVEL / 2])
    return float(ratios[0]), float(low), float(high)


def at_positions(records: Sequence[Record]) -> dict[float, list[Record]]:
    """The records at every true position (metres), ascending."""
    return {truth: [r for r in records if r.truth == truth] for truth in sorted({r.truth for r in records})}


def _score(method: str, records: Sequence[Record], span: float | None) -> Score:
    own = of_method(records, method)
    error = errors(own)
    risk = risk_coverage(own, span)[1]
    groups = [errors(each) for each in at_positions(own).values()]
    freedom = len(own) - len(groups)
    spread = sum(float(np.sum((each - each.mean()) ** 2)) for each in groups)
    return Score(
        method=method,
        captures=len(own),
        median_error=float(np.median(np.abs(error))),
        median_relative=float(np.median(np.abs(error) / scale(own, span))),
        rmse=float(np.sqrt(np.mean(error**2))),
        bias=float(error.mean()),
        scatter=float(np.sqrt(spread / freedom)) if freedom else float("nan"),
        coverage=float(covered(own).mean()),
        width=float(np.median(widths(own))),
        kept=tuple(float(risk[max(round(share * len(own)), 1) - 1]) for share in KEPT),
        outcomes={o.name.lower(): sum(r.outcome == o.name.lower() for r in own) / len(own) for o in Outcome},
        milliseconds=1e3 * float(np.median([r.seconds for r in own])),
        ratio=paired_ratio(own, of_method(records, BASELINE)),
    )
