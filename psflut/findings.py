"""What a report says of an estimate, in numbers and sentences."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from psflut import texture
from psflut.density import interval_of, tails
from psflut.estimation import Estimate
from psflut.table import PSFTable
from psflut.units import format_length

Floats = NDArray[np.float64]

LEVELS = (0.5, 0.68, 0.95)

BEYOND = 2.5
"""Misfit above which no distance of the table explains a spectrum well, see `psflut.evidence.misfit`."""

REMEDIES = {
    "photons": "more light, or the mean of several frames, would narrow it",
    "texture": "a larger patch, or one of richer texture, would narrow it",
    "table": "a table of more planes or of better measured PSFs would narrow it",
    "placement": "a target placed more exactly during calibration would narrow it",
}

PARAMETERS = ("contrast", "slope", "bend")
"""What the first coefficients of a scene's log spectrum are."""


def length(metres: float) -> str:
    """Four digits, zeros at the end too, and a unit."""
    number, unit = format_length(metres).split()
    whole = f"{float(number):#.4g}".rstrip(".")
    return f"{whole if metres else 0} {unit}"


def intervals(found: Estimate, table: PSFTable) -> dict[float, tuple[float, float]]:
    """Equal-tailed intervals (metres) by level: those of the samples, or where there are none that of the estimate."""
    if "distances" not in found.detail:
        return {found.level: found.interval}
    even = table.even(found.detail["distances"])
    return {level: interval_of(table.position(np.quantile(even, tails(level)))) for level in LEVELS}


def coefficients(found: Estimate) -> Floats:
    """(n, J) samples of the coefficients of ln S."""
    points, names = found.detail["chain"], found.detail["names"]
    return np.asarray(points.reshape(-1, len(names))[:, [name.startswith("theta") for name in names]])


def prior(table: PSFTable) -> tuple[Floats, Floats]:
    """Positions (metres) over a table and the density (1 / metre) of a prior flat in its even coordinate."""
    positions = table.candidates(200)
    even = table.even(table.span)
    slope = positions**-2 if table.kind == "distance" else np.ones_like(positions)
    return positions, slope / np.ptp(even)


def prior_spectrum() -> tuple[Floats, Floats]:
    """Mean and standard deviation (J,) of the coefficients of ln S in photographs."""
    learnt = texture.learnt()
    return learnt.mean, np.sqrt(np.diag(learnt.covariance))


def pairs(samples: Floats, points: Floats, names: list[str], along: str) -> tuple[Floats, list[str]]:
    """(n, D) samples of the parameters that a reader looks at, and what they are called."""
    columns, labels = [samples], [along]
    for k, label in enumerate(PARAMETERS):
        columns.append(points[:, :, names.index(f"theta_{k}")].ravel())
        labels.append(label)
    if names[-1] == "ln_sigma":
        columns.append(points[:, :, -1].ravel())
        labels.append("ln noise")
    return np.column_stack(columns), labels


def sentences(found: Estimate, table: PSFTable) -> dict[str, str]:
    """A sentence on each topic of which the estimate tells something."""
    said = {}
    if "distances" in found.detail:
        said["gain"] = _gain(found, table)
        said["chain"] = _chain(found)
    if "prediction" in found.detail:
        said["misfit"] = _criticism(found)
    if "budget" in found.stats:
        said["budget"] = _budget(found)
    return said


def _gain(found: Estimate, table: PSFTable) -> str:
    even = table.even(found.detail["distances"])
    narrower = 0.95 * np.ptp(table.even(table.span)) / np.ptp(np.quantile(even, tails(0.95)))
    coordinate = "1 / distance" if table.kind == "distance" else "the stage coordinate"
    return (
        f"Before the patch was seen, every place between {length(table.span[0])} and {length(table.span[1])} was as "
        f"likely as any other (flat in {coordinate}); the patch makes the 95 % interval {narrower:.3g} times narrower."
    )


def _chain(found: Estimate) -> str:
    steps, walkers, _ = found.detail["chain"].shape
    time = found.stats["autocorrelation_time"]
    judged = "long enough" if steps > 50 * time else "too short: below 50"
    return (
        f"{walkers} walkers took {steps} steps, {steps / time:.0f} autocorrelation times of the slowest parameter "
        f"({judged}), worth {found.stats['effective_samples']:.0f} independent draws of distance."
    )


def _criticism(found: Estimate) -> str:
    misfit, seen = found.stats["misfit"], found.detail["prediction"]
    low, high = np.quantile(seen.replicated, [0.025, 0.975], axis=0)
    outside = np.mean((seen.power < low) | (seen.power > high))
    told = (
        f"misfit {misfit:.2f}, three in four photographs stay below {seen.usual:.2f}; {outside:.0%} of the annuli lie "
        "outside the band of 95 %"
    )
    if misfit > BEYOND:
        return (
            f"No distance of the table explains this spectrum well ({told}): the object may lie beyond the table, be "
            "periodic, or be seen by another camera, so do not rely on the interval."
        )
    if misfit > 2 * seen.usual:
        return f"The spectrum scatters more than is usual ({told}), and the interval has been widened for it."
    return f"The model explains the spectrum as well as that of most photographs ({told})."


def _budget(found: Estimate) -> str:
    largest = max(found.stats["budget"], key=found.stats["budget"].__getitem__)
    remedy = f": {REMEDIES[largest]}" if largest in REMEDIES else ""
    return f"Most of the uncertainty comes from {largest}{remedy}. The parts add up in squares."


def descriptions(estimates: Mapping[str, Estimate], intervals: Mapping[float, tuple[float, float]]) -> dict[str, str]:
    """What each figure of a report shows, for those who cannot see it."""
    found = estimates["posterior"]
    near, far = (length(end) for end in intervals[max(intervals)])
    methods = ", ".join(f"{name} {length(each.distance)}" for name, each in estimates.items())
    parts = ", ".join(
        f"{name} {format_length(float(f'{sd:.2g}'))}" for name, sd in found.stats.get("budget", {}).items()
    )
    return {
        "posterior": f"Density of distance, heaviest mode at {length(found.distance)}, 95 % from {near} to {far}.",
        "priors": "Prior and posterior density of distance over the whole table, and prior and posterior of the "
        "coefficients of the scene's log spectrum.",
        "spectrum": "Observed power against spatial frequency, the predicted power with a band that holds 95 % of "
        "replicas, the noise, and the ratio of observed to predicted.",
        "corner": "Densities of every pair of distance and the first coefficients of the scene's spectrum.",
        "chain": "Distance of some walkers against step, and the autocorrelation of distance against lag.",
        "budget": f"Standard deviations by origin: {parts}.",
        "methods": f"Distance and interval by method: {methods}.",
    }
