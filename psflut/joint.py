"""The posterior of distance from two captures of one scene, each with its own table.

Both images together are, at every frequency, complex Gaussian with covariance S a a* + diag(N1, N2), a = (H1, c H2).
Its density splits in two (`psflut.crossed` has the formula): how far the images disagree once each is blurred by the
other's PSF, and the power of their fused spectrum, of mean S A + 1, which is judged as a single image's is
(`psflut.evidence`), with the scene's spectrum integrated out under the texture prior. The first knows nothing of
scenes and does nearly all the work wherever the two PSFs differ; the second is what is left where they do not.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from psflut import fused
from psflut.candidates import solve
from psflut.crossed import Residual, residual, told
from psflut.density import Density, tails
from psflut.errors import PsflutError
from psflut.estimation import Problem
from psflut.evidence import noise_power
from psflut.grid import cached_bank
from psflut.gross import with_gross_errors
from psflut.pair import Pair, over_noise, paired
from psflut.spread import between, placement
from psflut.table import PSFTable
from psflut.units import format_length

Floats = NDArray[np.float64]

DEPTH, ENOUGH, ROUNDS, PARTS = 20.0, 12, 7, 4
"""Steps between distances are cut in `PARTS` until `ENOUGH` of them are no more than `DEPTH` nats below the best."""

COARSE = 3
"""How many times fewer distances the residual, which is smooth in distance, is first looked at."""

STILL, CENTRINGS, FARTHEST = 0.05, 3, 2.0
"""The shift about which the residual is linearised is sought until it moves by less than so many pixels, at most so
many times; and the largest, pixels."""

SURE, WORTH = 0.68, 8.0
"""The residual counts where its deviance should differ by so much between the ends of the interval that the fused power
spectrum gives. Below that (two settings that blur alike) its own fluctuations of a few nats would pass for information:
of 48 photographs taken twice at one setting 95 % intervals covered 83 % with it."""

BEYOND = 10.0
"""Standard deviations of its deviance by which it contradicts; of one setting taken twice it moves by one."""

NODES, MARGIN = 2048, 8.0
"""Of the density; and how many of the tables' own errors it reaches beyond the likely distances."""


@dataclass(frozen=True, eq=False)
class Joint:
    """What two captures say.

    Parameters
    ----------
    even : (M,) array
        Distances looked at, ascending, in the coordinate of the flat prior.
    log_evidence : (M,) array
    density : Density
        The posterior, widened by the tables' own errors.
    misfit : float
        Power of the residual over that of noise at the likeliest distance; 1 where the model holds. A larger one
        widens the posterior by its root.
    gain, shift : float, (2,) array
        Exposure of the second image over that of the first; its shift down and across, pixels.
    restored : (H, W) array
        The ideal image at the likeliest distance, from both.
    """

    even: Floats
    log_evidence: Floats
    density: Density
    misfit: float
    gain: float
    shift: Floats
    restored: Floats


def overlap(first: PSFTable, second: PSFTable) -> tuple[float, float]:
    """First and last position (metres) that both tables span.

    Raises
    ------
    PsflutError
        If there are none, or the tables are not of one pixel pitch and kind of axis.
    """
    if first.kind != second.kind or not np.isclose(first.pixel_pitch, second.pixel_pitch, rtol=1e-3):
        raise PsflutError(
            "both tables must have one kind of axis and one pixel pitch, got "
            f"{first.kind} at {format_length(first.pixel_pitch)} and {second.kind} at "
            f"{format_length(second.pixel_pitch)}; bin or calibrate them alike"
        )
    low, high = max(first.span[0], second.span[0]), min(first.span[1], second.span[1])
    if not low < high:
        spans = (" to ".join(map(format_length, each.span)) for each in (first, second))
        raise PsflutError(
            f"the two tables must have distances in common, got {' and '.join(spans)}; extend one of them"
        )
    return low, high


def join(first: Problem, second: Problem, candidates: int) -> Joint:
    """The posterior of two captures of one shape, over the distances that both tables span.

    The clearer one comes first, because its noise pulls the ratio of exposures (`psflut.crossed`). On the thesis'
    camera with noise variance 1e-3, where captures hold more noise than scene, the ratio to the known scene came out as
    0.2 to 1 instead of 1 with the capture first, and 95 % intervals covered 81 % of 36 captures; as here 0.9 to 1.1,
    and 97 %.
    """
    if np.sum(over_noise(second)) > np.sum(over_noise(first)):
        turned = join(second, first, candidates)
        return replace(turned, gain=1 / turned.gain, shift=-turned.shift)
    low, high = np.sort(first.table.even(overlap(first.table, second.table)))
    coarse = np.linspace(low, high, max(candidates // COARSE, 5))
    pair, found = _centred(paired(first, second, coarse), coarse)
    amplitude = _amplitude(pair, np.linspace(low, high, candidates), coarse, found)

    gain = float(found.gain[np.argmin(found.deviance)])
    dense = np.linspace(low, high, NODES)
    alone = Density(dense, amplitude(dense), first.table.position)
    differ = told(pair, alone.quantile(tails(SURE)), gain) > WORTH or _contradicted(pair, found, alone)

    def rows(even: Floats, found: Residual) -> Floats:
        log = amplitude(even) + (found.log_volume - found.deviance if differ else 0.0)
        return np.stack([even, log, found.deviance])

    even, log, deviance = _refined(rows(coarse, found), lambda added: rows(added, residual(pair, added)))
    best = int(np.argmax(log))
    misfit = float(deviance[best] / pair.count)
    log = log + (deviance * (1 - 1 / max(misfit, 1.0)) if differ else 0.0)
    at_best = residual(pair, even[best])
    gain, density = float(at_best.gain[0]), _density(first, second, even, log)
    return Joint(even, log, density, misfit, gain, at_best.shift[0], fused.restored(pair, even[best], gain))


def _contradicted(pair: Pair, found: Residual, alone: Density) -> bool:
    """Whether the images disagree, far beyond fluctuations, wherever the fused power spectrum alone has the distance.

    It may err grossly and be sure of it: three of 470 scenes of the model, near in one image and far in the other.
    """
    there, least = residual(pair, alone.quantile([*tails(SURE), 0.5])).deviance.min(), found.deviance.min()
    return bool(there - least > BEYOND * np.sqrt(2.0 * pair.count) * max(least / pair.count, 1.0))


def _refined(rows: Floats, look: Callable[[Floats], Floats]) -> Floats:
    """The rows (distance, log density, deviance) with more of them where the density is, in order of distance.

    Peaks may be narrower than the first steps, so around each of them is looked, twice, before those too far below the
    best are left alone.
    """
    for k in range(ROUNDS):
        even, log, _ = rows
        likely = log > log.max() - DEPTH
        if k < 2:
            likely |= log >= np.maximum(np.append(log[1:], -np.inf), np.append(-np.inf, log[:-1]))
        elif np.sum(likely) >= ENOUGH:
            break
        gaps = np.flatnonzero(likely[:-1] | likely[1:])
        added = even[gaps, None] + np.diff(even)[gaps, None] * np.arange(1, PARTS) / PARTS
        rows = np.concatenate([rows, look(added.ravel())], axis=1)
        rows = rows[:, np.argsort(rows[0])]
    return rows


def _centred(pair: Pair, even: Floats) -> tuple[Pair, Residual]:
    """The pair linearised about the shift that it shows, and its residuals."""
    found = residual(pair, even)
    for _ in range(CENTRINGS):
        best = int(np.argmin(found.deviance))
        if np.max(np.abs(found.shift[best] - pair.shift)) < STILL:
            break
        closer = pair
        for _ in range(CENTRINGS):
            closer = closer.recentred(np.clip(residual(closer, even[best]).shift[0], -FARTHEST, FARTHEST))
        pair, found = closer, residual(closer, even)
    return pair, found


def _amplitude(pair: Pair, even: Floats, places: Floats, found: Residual) -> CubicSpline:
    """ln p of the power spectrum of the images as fused where they agree best, against distance."""
    best = int(np.argmin(found.deviance))
    gain = float(found.gain[best])
    one, two = (cached_bank(each.table, each.shape, each.imager, len(even)) for each in (pair.first, pair.second))
    power = fused.power(pair, float(places[best]), gain, one.rings)
    parts = [
        share * bank.at(even) * bank.white / noise_power(bank, each.noise, each.mean_level)
        for share, bank, each in ((1.0, one, pair.first), (gain**2, two, pair.second))
    ]
    both = replace(one, even=even, attenuation=parts[0] + parts[1])
    solved = solve(power, one.white, both)
    alone = Density(solved.even, solved.fit.log_evidence, pair.first.table.position)
    density = with_gross_errors(alone, solved.bank.prior.gross)
    return CubicSpline(density.nodes, density.log_values)


def _density(first: Problem, second: Problem, even: Floats, log: Floats) -> Density:
    """The posterior about the likely distances, and so far beyond as the tables' errors may move it."""

    def spread(places: Floats) -> Floats:
        parts = [f(each.table, places) for f in (placement, between) for each in (first, second)]
        return np.asarray(np.linalg.norm(parts, axis=0))

    likely = np.flatnonzero(log > log.max() - DEPTH)
    ends = even[np.clip([likely[0] - 1, likely[-1] + 1], 0, len(even) - 1)]
    beyond = MARGIN * spread(even[[np.argmax(log)]])[0]
    nodes = np.linspace(max(ends[0] - beyond, even[0]), min(ends[1] + beyond, even[-1]), NODES)
    floor = log.max() - 3 * DEPTH
    spline = CubicSpline(even, np.maximum(log, floor))(nodes)
    values = np.where((nodes >= ends[0]) & (nodes <= ends[1]), np.maximum(spline, floor), floor)
    return Density(nodes, values, first.table.position).widened(spread)
