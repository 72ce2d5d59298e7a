"""emcee's ensemble (Foreman-Mackey et al. 2013) over distance, scene spectrum and, where it is not known, noise.

The density is that of the grid, `psflut.evidence.log_joint`, with the scene's spectrum sampled in place of integrated.
Walkers start from the grid posterior, so every mode is populated by its weight. Moves compared in seven dimensions, by
autocorrelation time: stretch 61 to 75 steps, differential evolution 23 to 26 at the same cost a step, with snooker
moves 27 at 1.6 times the cost, kernel density 8 at five times. Used: differential evolution, and every fourth move an
independent leap to a draw from the grid posterior and, given its distance, from the spectrum's normal fit
(Metropolis-Hastings): 6 to 12 steps, 27 to 33 with ln sigma, which leaps leave alone (leaps every other move: 3.5 to 7,
but 48). Leaps cross freely between modes: across focus, 4000 steps of differential evolution alone did not converge,
500 to 3500 now do.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from psflut import evidence
from psflut.errors import PsflutError
from psflut.grid import Grid

Floats = NDArray[np.float64]

NOISE_SPREAD = 0.2
"""Prior standard deviation of ln sigma, in nats, where the noise was estimated from the image."""

AUTOCORRELATION_TIMES = 50
"""A chain shorter than so many of them is not believed (emcee's advice)."""

LEAPS = 0.25
"""Share of moves that are independent leaps, see `Posterior`."""

BLOCK = 500
"""Steps between two looks at the autocorrelation time."""


@dataclass(frozen=True, eq=False)
class Chain:
    """What the walkers did.

    Parameters
    ----------
    points : (steps, walkers, dimensions) array
        The even coordinate of distance (vergence or stage), the coefficients of ln S, ln sigma where it is free.
    log_probability : (steps, walkers) array
    times : (dimensions,) array
        Autocorrelation times, steps.
    """

    points: Floats
    log_probability: Floats
    times: Floats

    @property
    def converged(self) -> bool:
        """Whether it is longer than `AUTOCORRELATION_TIMES` of them, which is when emcee's advice is to believe it."""
        return bool(len(self.points) > AUTOCORRELATION_TIMES * np.max(self.times))


def sample(found: Grid, steps: int, walkers: int, seed: int, free_noise: bool = False) -> Chain:
    """Draw from the joint posterior of a patch until the chain has converged, or for so many steps.

    Parameters
    ----------
    found : Grid
        Of the patch.
    steps : int
        Of each walker, at most.
    walkers : int
    seed : int
    free_noise : bool
        Whether ln sigma is sampled about the noise that the grid was made with.

    Raises
    ------
    PsflutError
        If there are fewer walkers than twice the dimensions.
    """
    import emcee

    rng = np.random.default_rng(seed)
    start = _start(found, walkers, free_noise, rng)
    if walkers < 2 * start.shape[1]:
        raise PsflutError(f"walkers must be at least twice the {start.shape[1]} dimensions, got {walkers}")
    moves = [(emcee.moves.DEMove(), 1 - LEAPS), (emcee.moves.MHMove(_leap(found)), LEAPS)]
    sampler = emcee.EnsembleSampler(*start.shape, log_probability(found, free_noise), moves=moves, vectorize=True)
    state = emcee.State(start, random_state=np.random.RandomState(seed).get_state())
    while sampler.iteration < steps:
        state = sampler.run_mcmc(state, min(BLOCK, steps - sampler.iteration))
        with np.errstate(invalid="ignore"):  # of a walker that has not moved
            times = sampler.get_autocorr_time(tol=0)
        chain = Chain(sampler.get_chain(), sampler.get_log_prob(), times)
        if chain.converged:
            break
    return chain


def _start(found: Grid, walkers: int, free_noise: bool, rng: np.random.Generator) -> Floats:
    """(walkers, dimensions) draws from the grid posterior and the spectrum's fit; of ln sigma, near zero."""
    noise = NOISE_SPREAD * 0.1 * rng.standard_normal((walkers, int(free_noise)))
    return np.column_stack([_draw(found, rng.random(walkers), rng.standard_normal((walkers, _terms(found)))), noise])


def _draw(found: Grid, uniform: Floats, normal: Floats) -> Floats:
    """Draws of distance from the grid posterior and, given each, of theta from its normal fit: (n, 1 + J)."""
    even = found.exact.quantile(uniform)
    nearest = _nearest(found, even)
    factor = np.linalg.cholesky(np.linalg.inv(found.curvature[nearest]))
    return np.column_stack([even, found.fit.theta[nearest] + (factor @ normal[..., None])[..., 0]])


def _leap(found: Grid) -> Callable[[Floats, Any], tuple[Floats, Floats]]:
    """A proposal of `_draw` whatever the walker's place, which leaves ln sigma as it is."""
    terms = _terms(found)
    log_determinant = np.linalg.slogdet(found.curvature)[1]

    def log_density(points: Floats) -> Floats:
        even, nearest = points[:, 0], _nearest(found, points[:, 0])
        offset = points[:, 1 : 1 + terms] - found.fit.theta[nearest]
        square = np.einsum("ni,nij,nj->n", offset, found.curvature[nearest], offset)
        height = np.interp(even, found.exact.nodes, found.exact.values)
        return np.asarray(np.log(np.maximum(height, 1e-300)) + 0.5 * (log_determinant[nearest] - square))

    def propose(points: Floats, random: Any) -> tuple[Floats, Floats]:
        moved = points.copy()
        moved[:, : 1 + terms] = _draw(found, random.rand(len(points)), random.randn(len(points), terms))
        return moved, log_density(points) - log_density(moved)

    return propose


def _nearest(found: Grid, even: Floats) -> NDArray[np.intp]:
    """The candidate next to each even coordinate."""
    return np.asarray(np.argmin(np.abs(found.even - even[:, None]), axis=1))


def _terms(found: Grid) -> int:
    """Coefficients of the spectrum."""
    return int(found.bank.basis.shape[1])


def log_probability(found: Grid, free_noise: bool) -> Callable[[Floats], Floats]:
    """ln posterior density of (n, dimensions) points, the density of the grid."""
    bank = found.bank
    low, high = bank.even.min(), bank.even.max()
    terms = _terms(found)

    def value(points: Floats) -> Floats:
        even, theta = points[:, 0], points[:, 1 : 1 + terms]
        inside = (even >= low) & (even <= high)
        scale = np.exp(2 * points[:, 1 + terms :]) if free_noise else 1.0
        with np.errstate(over="ignore", divide="ignore"):  # far points are rejected, not errors
            log = evidence.log_joint(found.power, bank.at(even), found.noise * scale, theta, bank)
        if free_noise:
            log = log - 0.5 * (points[:, -1] / NOISE_SPREAD) ** 2
        return np.where(inside & np.isfinite(log), log, -np.inf)

    return value
