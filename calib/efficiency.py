"""How many of its effective bins a real scene's spectrum is worth: the `efficiency` of the texture prior.

Scenes are not stationary Gaussian fields: their power scatters more than the model's, and intervals come out too
narrow. The likelihood is tempered by a share of the bins such that 68 % intervals of distance cover 68 % on
simulated captures of the photographs. The 95 % interval then follows from the model and is a check, not a fit.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from psflut import evidence
from psflut.capture import capture, psf_of
from psflut.density import Density
from psflut.imagers.plain import Plain
from psflut.noise import Noise
from psflut.spectrum import annular_power
from psflut.table import PSFTable
from psflut.texture import TexturePrior

Floats = NDArray[np.float64]

LEVEL = 0.68
SHARES = (1.0, 0.7, 0.5, 0.35, 0.25, 0.18)
SIDE, NOISE, DISTANCES, PATCHES, CANDIDATES = 128, Noise(0.005), 14, 2, 100


def learn_efficiency(
    prior: TexturePrior,
    images: Sequence[Floats],
    table: PSFTable,
    rng: np.random.Generator,
    progress: Callable[[int], object] = lambda shares: None,
) -> float:
    """The share of the bins at which 68 % intervals cover 68 %, read off `SHARES` by interpolation.

    Parameters
    ----------
    prior : TexturePrior
        Its own efficiency is ignored.
    images : sequence of (H, W) arrays
        Sharp photographs, linear intensity.
    table : PSFTable
        Captures come from the model behind it, at random distances even in vergence.
    """
    trials = [trial for image in images for trial in _captures(image, table, rng)]
    covers = []
    for share in SHARES:
        covers.append(_coverage(replace(prior, efficiency=share), trials, table))
        progress(1)
    return float(np.exp(np.interp(LEVEL, covers, np.log(SHARES))))


def _captures(image: Floats, table: PSFTable, rng: np.random.Generator) -> list[tuple[float, Floats]]:
    """(distance, patch) of captures with a plain imager."""
    out = []
    low, high = np.sort(table.even(table.span))
    for even in rng.uniform(low, high, DISTANCES):
        distance = float(table.position(even))
        shot = capture(image, psf_of(table, distance), NOISE, rng, imager=Plain())
        for _ in range(PATCHES):
            y, x = (int(rng.integers(0, n - SIDE + 1)) for n in image.shape)
            out.append((distance, shot[y : y + SIDE, x : x + SIDE]))
    return out


def _coverage(prior: TexturePrior, trials: Sequence[tuple[float, Floats]], table: PSFTable) -> float:
    bank = evidence.bank(table, (SIDE, SIDE), Plain(), prior, CANDIDATES)
    noise = evidence.noise_power(bank, NOISE, 0.0)
    hits = 0
    for distance, patch in trials:
        fit = evidence.integrate(annular_power(patch), noise, bank)
        near, far = Density(bank.even, fit.log_evidence, table.position).interval(LEVEL)
        hits += near <= distance <= far
    return hits / len(trials)
