"""The posterior of distance and scene spectrum, sampled by emcee."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from psflut import evidence
from psflut.density import Density, Mode, interval_of, mirrored, tails
from psflut.errors import PsflutError
from psflut.estimation import AbstractEstimator, Curve, Estimate, Outcome, Problem, judge
from psflut.grid import Grid, grid, restored

Floats = NDArray[np.float64]

NOISE_SPREAD = 0.2
"""Prior standard deviation of ln sigma, in nats, where the noise was estimated from the image."""

AUTOCORRELATION_TIMES = 50
"""A chain shorter than so many of them is not believed (emcee's advice)."""

LEAPS = 0.25
"""Share of moves that are independent leaps, see `Posterior`."""

BLOCK = 500
"""Steps between two looks at the autocorrelation time."""


@dataclass(frozen=True)
class Posterior(AbstractEstimator):
    """Distance by posterior sampling with emcee's ensemble (Foreman-Mackey et al. 2013).

    The density is that of the grid (`psflut.evidence.log_joint`) with the scene spectrum not integrated
    but sampled: vergence, the coefficients of ln S, and, only where the noise had to be estimated from the
    image, ln sigma about that estimate. Walkers start from the grid posterior, so every mode is
    populated by its weight. Moves compared in seven dimensions, by autocorrelation time: stretch 61 to 75 steps,
    differential evolution 23 to 26 at the same cost a step, with snooker moves 27 at 1.6 times the cost, kernel
    density 8 at five times. Used: differential evolution, and every fourth move an independent leap to a draw from
    the grid posterior and, given its distance, from the spectrum's normal fit (Metropolis-Hastings): 6 to 12 steps,
    27 to 33 with ln sigma, which leaps leave alone (leaps every other move: 3.5 to 7, but 48). Leaps cross freely
    between modes: across focus, 4000 steps of differential evolution alone did not converge, 500 to 3500 now do.

    ``detail`` keeps ``chain`` (steps, walkers, dimensions), ``names`` of the dimensions, the ``distances`` drawn
    (metres), moved by the table's own errors (`psflut.spread`) as interval and modes are but the chain is not,
    ``log_probability`` (steps, walkers), and ``restored``. ``stats`` gives the autocorrelation time and
    the effective sample size.

    Parameters
    ----------
    steps : int
        Of each walker, at most: the chain ends once it is 50 autocorrelation times long.
    walkers : int
        Even, at least twice the dimensions.
    seed : int
    candidates : int
        Of the grid that starts the walkers.
    """

    steps: int = 4000
    walkers: int = 32
    seed: int = 0
    candidates: int = 100

    def __post_init__(self) -> None:
        if self.steps < 1 or self.walkers < 2 or self.walkers % 2 or self.seed < 0:
            raise PsflutError(
                "posterior needs at least one step, an even number of walkers and a seed that is not negative, "
                f"got {self.steps}, {self.walkers} and {self.seed}"
            )

    def solve(self, problem: Problem) -> Estimate:
        """See `AbstractEstimator`."""
        import emcee

        found = grid(problem, self.candidates)
        rng = np.random.default_rng(self.seed)
        free_noise = problem.noise_source == "image"
        start = _start(found, self.walkers, free_noise, rng)
        if self.walkers < 2 * start.shape[1]:
            raise PsflutError(f"walkers must be at least twice the {start.shape[1]} dimensions, got {self.walkers}")
        moves = [(emcee.moves.DEMove(), 1 - LEAPS), (emcee.moves.MHMove(_leap(found)), LEAPS)]
        sampler = emcee.EnsembleSampler(*start.shape, _log_probability(found, free_noise), moves=moves, vectorize=True)
        state = emcee.State(start, random_state=np.random.RandomState(self.seed).get_state())
        while sampler.iteration < self.steps:
            state = sampler.run_mcmc(state, min(BLOCK, self.steps - sampler.iteration))
            times = sampler.get_autocorr_time(tol=0)
            if sampler.iteration > AUTOCORRELATION_TIMES * np.max(times):
                break
        return self._estimate(problem, found, sampler.get_chain(), sampler.get_log_prob(), times)

    def _estimate(
        self, problem: Problem, found: Grid, chain: Floats, log_probability: Floats, times: Floats
    ) -> Estimate:
        drawn = chain[:, :, 0].ravel()
        even = _with_errors_of_the_table(drawn, found, np.random.default_rng(self.seed))
        modes = _modes(even, found.density)
        outcome, stats = judge(found.density)
        longest = float(np.max(times))
        if not len(chain) > AUTOCORRELATION_TIMES * longest:
            outcome = Outcome.NOT_CONVERGED
        names = ["vergence" if problem.table.kind == "distance" else "stage"]
        names += [f"theta_{j}" for j in range(found.bank.basis.shape[1])]
        return Estimate(
            distance=modes[0].distance,
            interval=interval_of(problem.table.position(np.quantile(even, tails(problem.level)))),
            level=problem.level,
            outcome=outcome,
            modes=modes,
            curve=Curve(problem.table.position(found.bank.even), found.fit.log_evidence, "log evidence"),
            stats=stats
            | {
                "misfit": found.misfit,
                "autocorrelation_time": longest,
                "effective_samples": float(even.size / times[0]),
                "standard_deviation": float(drawn.std()),
            },
            detail={
                "chain": chain,
                "distances": problem.table.position(even),
                "names": [*names, "ln_sigma"][: chain.shape[2]],
                "log_probability": log_probability,
                "restored": restored(problem, found, modes[0].distance),
            },
        )


def _with_errors_of_the_table(even: Floats, found: Grid, rng: np.random.Generator) -> Floats:
    """Draws of distance that the table's own errors have moved, as `Density.widened` moves the grid's."""
    moved = even + found.spread(even) * rng.standard_normal(even.shape)
    return mirrored(moved, found.bank.even.min(), found.bank.even.max())


def _start(found: Grid, walkers: int, free_noise: bool, rng: np.random.Generator) -> Floats:
    """(walkers, dimensions) draws from the grid posterior and the spectrum's fit; of ln sigma, near zero."""
    noise = NOISE_SPREAD * 0.1 * rng.standard_normal((walkers, int(free_noise)))
    return np.column_stack([_draw(found, rng.random(walkers), rng.standard_normal((walkers, _terms(found)))), noise])


def _draw(found: Grid, uniform: Floats, normal: Floats) -> Floats:
    """Draws of distance from the grid posterior and, given each, of theta from its normal fit: (n, 1 + J)."""
    even = found.exact.quantile(uniform)
    nearest = _nearest(found, even)
    factor = np.linalg.cholesky(np.linalg.inv(found.fit.curvature[nearest]))
    return np.column_stack([even, found.fit.theta[nearest] + (factor @ normal[..., None])[..., 0]])


def _leap(found: Grid) -> Callable[[Floats, Any], tuple[Floats, Floats]]:
    """A proposal of `_draw` whatever the walker's place, which leaves ln sigma as it is."""
    terms = _terms(found)
    log_determinant = np.linalg.slogdet(found.fit.curvature)[1]

    def log_density(points: Floats) -> Floats:
        even, nearest = points[:, 0], _nearest(found, points[:, 0])
        offset = points[:, 1 : 1 + terms] - found.fit.theta[nearest]
        square = np.einsum("ni,nij,nj->n", offset, found.fit.curvature[nearest], offset)
        height = np.interp(even, found.exact.nodes, found.exact.values)
        return np.asarray(np.log(np.maximum(height, 1e-300)) + 0.5 * (log_determinant[nearest] - square))

    def propose(points: Floats, random: Any) -> tuple[Floats, Floats]:
        moved = points.copy()
        moved[:, : 1 + terms] = _draw(found, random.rand(len(points)), random.randn(len(points), terms))
        return moved, log_density(points) - log_density(moved)

    return propose


def _nearest(found: Grid, even: Floats) -> NDArray[np.intp]:
    """The candidate next to each even coordinate."""
    return np.asarray(np.argmin(np.abs(found.bank.even - even[:, None]), axis=1))


def _terms(found: Grid) -> int:
    """Coefficients of the spectrum."""
    return int(found.bank.basis.shape[1])


def _log_probability(found: Grid, free_noise: bool) -> Callable[[Floats], Floats]:
    """ln posterior density of (n, dimensions) points, the density of the grid."""
    bank = found.bank
    low, high = bank.even.min(), bank.even.max()
    terms = _terms(found)

    def log_probability(points: Floats) -> Floats:
        even, theta = points[:, 0], points[:, 1 : 1 + terms]
        inside = (even >= low) & (even <= high)
        scale = np.exp(2 * points[:, 1 + terms :]) if free_noise else 1.0
        with np.errstate(over="ignore", divide="ignore"):  # far points are rejected, not errors
            value = evidence.log_joint(found.power, bank.at(even), found.noise * scale, theta, bank)
        if free_noise:
            value = value - 0.5 * (points[:, -1] / NOISE_SPREAD) ** 2
        return np.where(inside & np.isfinite(value), value, -np.inf)

    return log_probability


def _modes(even: Floats, density: Density) -> tuple[Mode, ...]:
    """Medians and weights of the samples between the grid posterior's valleys, heaviest first."""
    borders = density.borders
    parts = np.clip(np.searchsorted(borders, even) - 1, 0, len(borders) - 2)
    modes = [
        Mode(float(density.position(np.median(even[parts == k]))), float(np.mean(parts == k))) for k in np.unique(parts)
    ]
    return tuple(sorted(modes, key=lambda mode: -mode.weight))
