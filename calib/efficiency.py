"""How far real scenes are from the texture prior's model: its `efficiency` and its usual `misfit`.

Scenes are not stationary Gaussian fields: their power scatters more than the model's, and intervals come out too
narrow. Each patch is judged by its own misfit where that is above the median (`psflut.evidence.discount`); for all
others a share of the effective bins counts: half way, by its logarithm, between those at which the 68 and the 95 %
intervals of distance cover what they say on simulated captures of photographs, each with a prior that was learnt
without its photograph. One number cannot serve both: real errors have heavier tails than the model's.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from psflut import evidence
from psflut.candidates import solve
from psflut.capture import capture, psf_of
from psflut.density import Density
from psflut.imagers.plain import Plain
from psflut.noise import Noise
from psflut.spectrum import annular_power, annuli
from psflut.table import PSFTable
from psflut.texture import TexturePrior, basis

Floats = NDArray[np.float64]

LEVELS = (0.68, 0.95)
SHARES = (1.0, 0.75, 0.57, 0.43, 0.33)
SIDE, NOISE, DISTANCES, PATCHES, CANDIDATES = 128, Noise(0.005), 24, 1, 200


class Trial(NamedTuple):
    """A captured patch by its annular power, its distance (metres), and which photograph it shows."""

    power: Floats
    distance: float
    photograph: int


def learn_efficiency(
    priors: Sequence[TexturePrior],
    images: Sequence[Floats],
    table: PSFTable,
    rng: np.random.Generator,
    progress: Callable[[int], object] = lambda photographs: None,
) -> tuple[float, float]:
    """The share of the bins at which intervals cover what they say, and the median misfit that goes with it.

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
        Hears of every photograph done at every share.
    """
    trials = [trial for number, image in enumerate(images) for trial in _captures(number, image, table, rng)]
    base = evidence.bank(table, (SIDE, SIDE), Plain(), priors[0], CANDIDATES)
    found = [_coverage(share, priors, trials, base, table, progress) for share in SHARES]
    *covers, misfits = np.array(found).T
    efficiency = np.exp(
        np.mean([np.interp(level, cover, np.log(SHARES)) for level, cover in zip(LEVELS, covers, strict=True)])
    )
    misfit = np.interp(-np.log(efficiency), -np.log(SHARES), misfits)
    return float(efficiency), float(misfit)


def _captures(number: int, image: Floats, table: PSFTable, rng: np.random.Generator) -> list[Trial]:
    """Captures of a photograph with a plain imager."""
    out = []
    near, far = table.span
    for distance in rng.uniform(near + 0.05 * (far - near), far - 0.05 * (far - near), DISTANCES):
        shot = capture(image, psf_of(table, distance), NOISE, rng, imager=Plain())
        for _ in range(PATCHES):
            y, x = (int(rng.integers(0, n - SIDE + 1)) for n in image.shape)
            out.append(Trial(annular_power(shot[y : y + SIDE, x : x + SIDE]), float(distance), number))
    return out


def _with(base: evidence.Bank, prior: TexturePrior) -> evidence.Bank:
    """The same bank with another prior."""
    rings = annuli((SIDE, SIDE))
    return replace(base, basis=basis(rings.frequency, len(prior.mean)), shape=prior.shape(rings.effective), prior=prior)


def _coverage(
    share: float,
    priors: Sequence[TexturePrior],
    trials: Sequence[Trial],
    base: evidence.Bank,
    table: PSFTable,
    progress: Callable[[int], object],
) -> tuple[float, ...]:
    """How many intervals of each level cover at that share of the bins, and the median misfit."""
    banks = [_with(base, replace(prior, efficiency=share, misfit=np.inf)) for prior in priors]
    noise = evidence.noise_power(base, NOISE, 0.0)
    usual = float(np.median([solve(power, noise, banks[k]).misfit for power, _, k in trials]))
    hits = []
    for power, distance, k in trials:
        found = solve(power, noise, _with(base, replace(priors[k], efficiency=share, misfit=usual)))
        density = Density(found.bank.even, found.fit.log_evidence, table.position)
        ends = np.array([density.interval(level) for level in LEVELS])
        hits.append((ends[:, 0] <= distance) & (distance <= ends[:, 1]))
        progress(k != trials[len(hits) % len(trials)].photograph)
    return *map(float, np.mean(hits, axis=0)), usual
