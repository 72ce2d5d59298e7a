"""The posterior of distance and scene spectrum, sampled by emcee."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from psflut.budget import budget
from psflut.chain import Chain, sample
from psflut.density import Density, Mode, interval_of, mirrored, tails
from psflut.errors import PsflutError
from psflut.estimation import AbstractEstimator, Curve, Estimate, Outcome, Problem, judge
from psflut.grid import Grid, check_sectors, grid, restored
from psflut.gross import moved
from psflut.predictive import predict
from psflut.texture import SECTORS

Floats = NDArray[np.float64]

MOST_WALKERS, MOST_DRAWS = 10_000, 10_000_000
"""They are kept in memory: so many draws of 20 numbers take 1.6 GB."""


@dataclass(frozen=True)
class Posterior(AbstractEstimator):
    """Distance by posterior sampling with emcee's ensemble (Foreman-Mackey et al. 2013).

    The density is that of the grid (`psflut.evidence.log_joint`) with the scene spectrum not integrated
    but sampled: vergence, the coefficients of ln S, and, only where the noise had to be estimated from the
    image, ln sigma about that estimate. Walkers start from the grid posterior, so every mode is
    populated by its weight. `psflut.chain` says how they move.

    ``detail`` keeps ``chain`` (steps, walkers, dimensions), ``names`` of the dimensions, the ``distances`` drawn
    (metres), moved by gross errors (`psflut.gross`) and the table's own (`psflut.spread`) as interval and modes are
    but the chain is not, ``log_probability`` (steps, walkers), ``restored``, and the ``prediction`` of the patch's
    spectrum (`psflut.predictive`). ``stats`` gives the autocorrelation time and
    the effective sample size.

    Parameters
    ----------
    steps : int
        Of each walker, at most: the chain ends once it is 50 autocorrelation times long.
    walkers : int
        Even, at least twice the dimensions, of which there are 20, 21 with ln sigma.
    seed : int
    candidates : int
        Of the grid that starts the walkers.
    sectors : int
        As that of `psflut.estimators.wiener`.
    """

    steps: int = 4000
    walkers: int = 42
    seed: int = 0
    candidates: int = 200
    sectors: int = SECTORS

    def __post_init__(self) -> None:
        check_sectors(self.sectors)
        if self.steps < 1 or self.walkers < 2 or self.walkers % 2 or self.seed < 0:
            raise PsflutError(
                "posterior needs at least one step, an even number of walkers and a seed that is not negative, "
                f"got {self.steps}, {self.walkers} and {self.seed}"
            )
        if self.walkers > MOST_WALKERS or self.walkers * self.steps > MOST_DRAWS:
            raise PsflutError(
                f"posterior keeps at most {MOST_DRAWS:,} draws of {MOST_WALKERS:,} walkers, got {self.steps:,} steps "
                f"of {self.walkers:,}; take fewer"
            )

    def solve(self, problem: Problem) -> Estimate:
        """See `AbstractEstimator`."""
        found = grid(problem, self.candidates, self.sectors)
        free = problem.noise_source == "image"
        chain = sample(found, self.steps, self.walkers, self.seed, free)
        return self._estimate(problem, found, chain)

    def _estimate(self, problem: Problem, found: Grid, chain: Chain) -> Estimate:
        drawn = chain.points[:, :, 0].ravel()
        even = _with_errors(drawn, found, np.random.default_rng(self.seed))
        modes = _modes(even, found.density)
        outcome, stats = judge(found.density)
        if not chain.converged:
            outcome = Outcome.NOT_CONVERGED
        names = ["vergence" if problem.table.kind == "distance" else "stage"]
        names += found.bank.prior.names
        return Estimate(
            distance=modes[0].distance,
            interval=interval_of(problem.table.position(np.quantile(even, tails(problem.level)))),
            level=problem.level,
            outcome=outcome,
            modes=modes,
            curve=Curve(problem.table.position(found.even), found.fit.log_evidence, "log evidence"),
            stats=stats
            | {
                "misfit": found.misfit,
                "budget": budget(found, problem.table, modes[0].distance),
                "autocorrelation_time": float(np.max(chain.times)),
                "effective_samples": float(even.size / chain.times[0]),
                "standard_deviation": float(drawn.std()),
            },
            detail={
                "chain": chain.points,
                "distances": problem.table.position(even),
                "names": [*names, "ln_sigma"][: chain.points.shape[2]],
                "log_probability": chain.log_probability,
                "restored": restored(problem, found, modes[0].distance),
                "prediction": predict(problem, found, chain, self.seed),
            },
        )


def _with_errors(even: Floats, found: Grid, rng: np.random.Generator) -> Floats:
    """Draws of distance that gross errors and the table's own have moved, as they moved the grid's density."""
    low, high = found.bank.even.min(), found.bank.even.max()
    even = mirrored(moved(even, found.exact, found.bank.prior.gross, rng), low, high)
    return mirrored(even + found.spread(even) * rng.standard_normal(even.shape), low, high)


def _modes(even: Floats, density: Density) -> tuple[Mode, ...]:
    """Medians and weights of the samples between the grid posterior's valleys, heaviest first."""
    borders = density.borders
    parts = np.clip(np.searchsorted(borders, even) - 1, 0, len(borders) - 2)
    modes = [
        Mode(float(density.position(np.median(even[parts == k]))), float(np.mean(parts == k))) for k in np.unique(parts)
    ]
    return tuple(sorted(modes, key=lambda mode: -mode.weight))
