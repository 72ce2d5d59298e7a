"""What a posterior sample predicts of the patch's own spectrum: the check of the model against what was seen."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from psflut import evidence
from psflut.chain import Chain
from psflut.estimation import Problem
from psflut.grid import Grid
from psflut.spectrum import annuli

Floats = NDArray[np.float64]

DRAWS = 200
"""Points of the chain that are asked, evenly over its steps and walkers."""


class Prediction(NamedTuple):
    """Powers by annulus, image units squared.

    Parameters
    ----------
    frequency : (K,) array
        Cycles a pixel.
    power, noise : (K,) arrays
        Of the patch, and the mean of its noise.
    shape : (K,) array
        Gamma shapes: in how many effective bins' worth of scatter an annulus is believed.
    mean : (n, K) array
        V = S |L|^2 T + N at points of the chain.
    replicated : (n, K) array
        Powers drawn from gamma distributions of those means: what another such patch could have shown.
    usual : float
        Misfit that three in four photographs stay below (`TexturePrior.usual`).
    """

    frequency: Floats
    power: Floats
    noise: Floats
    shape: Floats
    mean: Floats
    replicated: Floats
    usual: float


def predict(problem: Problem, found: Grid, chain: Chain, seed: int) -> Prediction:
    """What `DRAWS` points of a chain predict of a patch."""
    points = chain.points.reshape(-1, chain.points.shape[2])
    points = points[np.linspace(0, len(points) - 1, DRAWS).astype(int)]
    terms = found.bank.basis.shape[1]
    scale = np.exp(2 * points[:, 1 + terms :]) if points.shape[1] > 1 + terms else 1.0
    scene = evidence.scene_power(found.bank.at(points[:, 0]), points[:, 1 : 1 + terms], found.bank)
    mean, shape = scene + found.noise * scale, np.broadcast_to(found.bank.shape, found.power.shape)
    drawn = np.random.default_rng(seed).gamma(shape, mean / shape)
    whole = found.bank.rings.whole
    power, noise, mean, drawn = (whole(each) for each in (found.power, found.noise, mean, drawn))
    counted = np.asarray(np.bincount(found.bank.rings.ring, shape), dtype=float)
    usual = found.bank.prior.usual(found.bank.rings.count)
    return Prediction(annuli(problem.shape).frequency, power, noise, counted, mean, drawn, usual)
