"""emcee's ensemble (Foreman-Mackey et al. 2013) over distance, scene spectrum and, where it is not known, noise.

The density is that of the grid, `psflut.evidence.log_joint`, with the scene's spectrum sampled in place of integrated.
Walkers start from the grid posterior, so every mode is populated by its weight. Moves compared in seven dimensions, by
autocorrelation time: stretch 61 to 75 steps, differential evolution 23 to 26 at the same cost a step, with snooker
moves 27 at 1.6 times the cost, kernel density 8 at five times. Used: differential evolution, and every fourth move an
independent leap to a draw from the grid posterior and, given its distance, from the normal fit of spectrum and ln sigma
(Metropolis-Hastings): 6 to 12 steps, 6 to 7 with ln sigma (42 to 46 where leaps left it alone). Leaps cross freely
between modes: across focus, 4000 steps of differential evolution alone did not converge, 500 to 3500 now do.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

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
    noise = _noise(found) if free_noise else None
    start = _start(found, noise, walkers, rng)
    if walkers < 2 * start.shape[1]:
        raise PsflutError(f"walkers must be at least twice the {start.shape[1]} dimensions, got {walkers}")
    moves = [(emcee.moves.DEMove(), 1 - LEAPS), (emcee.moves.MHMove(_leap(found, noise)), LEAPS)]
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


def _start(found: Grid, noise: "_Noise | None", walkers: int, rng: np.random.Generator) -> Floats:
    """(walkers, dimensions) draws from the grid posterior, the spectrum's fit, and that of ln sigma."""
    return _draw(found, noise, rng.random(walkers), rng.standard_normal((walkers, _terms(found) + (noise is not None))))


def _draw(found: Grid, noise: "_Noise | None", uniform: Floats, normal: Floats) -> Floats:
    """Draws of distance from the grid posterior and, given each, of theta and ln sigma from their normal fit."""
    even = found.exact.quantile(uniform)
    nearest, terms = _nearest(found, even), _terms(found)
    factor = np.linalg.cholesky(np.linalg.inv(found.curvature[nearest]))
    theta = found.fit.theta[nearest] + (factor @ normal[:, :terms, None])[..., 0]
    if noise is None:
        return np.column_stack([even, theta])
    ln_sigma = noise.mean + noise.sd * normal[:, -1]
    return np.column_stack([even, theta + ln_sigma[:, None] * noise.shift, ln_sigma])


def _leap(found: Grid, noise: "_Noise | None") -> Callable[[Floats, Any], tuple[Floats, Floats]]:
    """A proposal of `_draw` whatever the walker's place."""
    terms = _terms(found)
    log_determinant = np.linalg.slogdet(found.curvature)[1]

    def log_density(points: Floats) -> Floats:
        even, nearest = points[:, 0], _nearest(found, points[:, 0])
        offset = points[:, 1 : 1 + terms] - found.fit.theta[nearest]
        away = np.zeros(len(points))
        if noise is not None:
            offset = offset - points[:, -1:] * noise.shift
            away = ((points[:, -1] - noise.mean) / noise.sd) ** 2
        square = np.einsum("ni,nij,nj->n", offset, found.curvature[nearest], offset)
        height = np.interp(even, found.exact.nodes, found.exact.values)
        return np.asarray(np.log(np.maximum(height, 1e-300)) + 0.5 * (log_determinant[nearest] - square - away))

    def propose(points: Floats, random: Any) -> tuple[Floats, Floats]:
        moved = _draw(found, noise, random.rand(len(points)), random.randn(len(points), points.shape[1] - 1))
        return moved, log_density(points) - log_density(moved)

    return propose


class _Noise(NamedTuple):
    """Normal fit of ln sigma at the likeliest distance: mean, standard deviation, and what moves theta (J,) with it."""

    mean: float
    sd: float
    shift: Floats


def _noise(found: Grid) -> _Noise:
    """By Fisher's information of ln sigma and theta, from a step of Newton's method at ln sigma 0."""
    best, bank = int(np.argmax(found.fit.log_evidence)), found.bank
    scene = evidence.scene_power(bank.at(found.even[best]), found.fit.theta[best], bank)
    total = scene + found.noise
    share = 2 * found.noise / total
    slope = np.sum(bank.shape * share * (found.power / total - 1))
    crossed = (bank.shape * share * scene / total) @ bank.basis
    shift = -np.linalg.solve(found.curvature[best], crossed)
    information = np.sum(bank.shape * share**2) + crossed @ shift + NOISE_SPREAD**-2
    return _Noise(float(slope / information), float(information**-0.5), shift)


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
