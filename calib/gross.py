"""How far real scenes are from the texture prior's model: the usual `misfit`, and the share of `gross` errors.

Scenes are not stationary Gaussian fields: their power scatters more than the model's, and intervals come out too
narrow. Each patch is judged by its own misfit where that is above the usual (`psflut.evidence.discount`); for what
shows in no misfit, a share of all is taken to err several times as much (`psflut.gross`): that at which 95 % intervals
of distance cover 95 % on simulated captures of photographs, patches of three sizes together, each with a prior that was
learnt without its photograph.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from psflut import evidence
from psflut.candidates import Solution, solve_all
from psflut.capture import capture, psf_of
from psflut.density import Density
from psflut.gross import with_gross_errors
from psflut.imagers.plain import Plain
from psflut.noise import Noise
from psflut.spectrum import annuli
from psflut.table import PSFTable
from psflut.texture import EVERY, TexturePrior

Floats = NDArray[np.float64]
Usual = Sequence[tuple[int, float]]

LEVEL, SHARES = 0.95, (0.0, 0.02, 0.04, 0.06, 0.08, 0.1, 0.15, 0.2)
SIDES, NOISE, DISTANCES, CANDIDATES = (64, 128, 256), Noise(0.005), 96, 200

USUAL = 0.75
"""Share of captures whose misfit counts as usual; `psflut.gross` compares it. It was chosen on draws of captures other
than that of `tests/benchmarks/test_honesty.py`, which judges; the photographs are the same."""

ROUNDS = 2 * len(SIDES)
"""How often every photograph is gone through."""


class Trials(NamedTuple):
    """Captured patches of a photograph (n, side, side), the largest of `SIDES`, and their distances (n,), metres."""

    patches: Floats
    distance: Floats


def learn_gross(
    priors: Sequence[TexturePrior],
    images: Sequence[Floats],
    table: PSFTable,
    rng: np.random.Generator,
    progress: Callable[[int], object] = lambda photographs: None,
    sectors: int = 1,
) -> tuple[Usual, float]:
    """The usual misfit by number of annuli, and the share of gross errors with which intervals cover what they say.

    Parameters
    ----------
    priors : sequence of TexturePrior
        For each image, learnt from the others.
    images : sequence of (H, W) arrays
        Sharp photographs, linear intensity.
    table : PSFTable
        Captures come from the model behind it, at random distances even in metres over the middle nine tenths of its
        span: blur tells least of far ones, which even steps of vergence would make few.
    progress : callable
        Hears of every photograph done.
    sectors : int
        Into which annuli are cut.
    """
    trials = [_captures(image, table, rng) for image in images]

    def solved(side: int, usual: Usual) -> list[tuple[Solution, float]]:
        out: list[tuple[Solution, float]] = []
        base = evidence.bank(table, (side, side), Plain(), priors[0], CANDIDATES, sectors)
        cut = (max(SIDES) - side) // 2
        noise = np.tile(evidence.noise_power(base, NOISE, 0.0), (DISTANCES, 1))
        for prior, trial in zip(priors, trials, strict=True):
            bank = base.under(replace(prior.over(sectors), misfit=usual))
            powers = base.rings.power(trial.patches[:, cut : cut + side, cut : cut + side])
            out += zip(solve_all(powers, noise, bank), trial.distance, strict=True)
            progress(1)
        return out

    misfit: list[tuple[int, float]] = []
    for side in SIDES:
        seen = np.quantile([found.misfit for found, _ in solved(side, EVERY)], USUAL)
        misfit.append((annuli((side, side)).count, float(seen)))
    found = [each for side in SIDES for each in solved(side, misfit)]
    exact = [(Density(each.even, each.fit.log_evidence, table.position), z) for each, z in found]
    covers = [np.mean([_covers(with_gross_errors(density, share), z) for density, z in exact]) for share in SHARES]
    return misfit, float(np.interp(LEVEL, covers, SHARES))


def _covers(density: Density, distance: float) -> bool:
    near, far = density.interval(LEVEL)
    return near <= distance <= far


def _captures(image: Floats, table: PSFTable, rng: np.random.Generator) -> Trials:
    """Captures of a photograph with a plain imager, a patch of each."""
    near, far = table.span
    distances = rng.uniform(near + 0.05 * (far - near), far - 0.05 * (far - near), DISTANCES)
    patches, side = [], max(SIDES)
    for distance in distances:
        shot = capture(image, psf_of(table, distance), NOISE, rng, imager=Plain())
        y, x = (int(rng.integers(0, n - side + 1)) for n in image.shape)
        patches.append(shot[y : y + side, x : x + side])
    return Trials(np.stack(patches), distances)
