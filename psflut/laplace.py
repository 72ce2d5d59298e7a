"""The scene integrated out of the evidence by Laplace's method, for many patches and distances together.

    ln p(P | z) = max over theta of [ ln p(P | z, theta) + ln p(theta) ] - 1/2 ln det(curvature there)

up to what does not depend on z. With a thousand effective bins the posterior of theta is so nearly normal that emcee,
which samples the same density, gives the same distances. The maximum is found by Newton's method with the exact
curvature, held to be positive: with ten coefficients it takes 11 steps from the prior's mean, Fisher's information in
its place 80, and 2 from a neighbour's maximum.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from psflut.evidence import Bank, log_likelihood, log_prior, scene_power

Floats = NDArray[np.float64]

NEWTON_STEPS, TOLERANCE = 100, 1e-2
"""The search ends where a step gains less than this many nats, which are counted."""

HOPELESS = 60.0
"""Or where it is so many nats below the patch's best, and ten times what the step promises would not mend that."""

LEAST_CURVATURE, LONGEST_STEP = 0.2, 3.0
"""Of a Newton step: share of Fisher's information, and nats of ln S at any annulus; the quadratic model reaches no
further."""

BLOCK = 128
"""Rows worked on together: what they need stays in the cache."""


@dataclass(frozen=True, eq=False)
class Fit:
    """The evidence of one patch, and the scene's spectrum that goes best with each distance.

    Parameters
    ----------
    log_evidence : (M,) array
        ln p(P | z), up to a constant that does not depend on z.
    theta : (M, J) array
        Coefficients of ln S at the maximum.
    curvature : (M, J, J) array
        Minus the second derivative of the log density there.
    """

    log_evidence: Floats
    theta: Floats
    curvature: Floats


def integrate(
    power: Floats,
    noise: Floats,
    bank: Bank,
    start: Floats | None = None,
    patch: NDArray[np.intp] | None = None,
) -> Fit:
    """The evidence of powers under noise powers at every distance of the bank.

    Parameters
    ----------
    power, noise : (K,) or (M, K) arrays
        Of one patch, or of the patch that each row of the bank is for.
    bank : Bank
    start : (M, J) array or None
        A guess of theta.
    patch : (M,) array or None
        Numbers of the rows' patches; distances are hopeless beside the best of their patch, and left where that is
        seen.
    """
    rows = np.arange(len(bank.attenuation))
    patch = np.zeros_like(rows) if patch is None else patch
    search = _Search(power, noise, bank, patch, _first_guess(power, noise, bank) if start is None else start)
    for left in reversed(range(NEWTON_STEPS)):
        if not rows.size:
            break
        blocks = np.array_split(rows, -(-len(rows) // BLOCK))
        rows = np.concatenate([search.advance(block, last=left == 0) for block in blocks])
    return search.fit()


class _Search:
    """Newton's method for every row of a bank, with short steps."""

    def __init__(self, power: Floats, noise: Floats, bank: Bank, patch: NDArray[np.intp], start: Floats) -> None:
        shape = bank.attenuation.shape
        self.power, self.noise, self.shape = (np.broadcast_to(a, shape) for a in (power, noise, bank.shape))
        self.bank, self.patch, self.theta = bank, patch, start.copy()
        self.best = np.full(patch.max(initial=0) + 1, -np.inf)
        self.peak, self.curvature = np.empty(len(start)), np.empty((*start.shape, start.shape[1]))

    def advance(self, rows: NDArray[np.intp], last: bool) -> NDArray[np.intp]:
        """One step for these rows; returns those that need more."""
        bank, here, patch = self.bank, self.theta[rows], self.patch[rows]
        scene = scene_power(bank.attenuation[rows], here, bank)
        mean = scene + self.noise[rows]
        value = log_likelihood(self.power[rows], mean, self.shape[rows]) + log_prior(here, bank.prior)
        slope, weight, least = _derivatives(self.power[rows], scene, mean, self.shape[rows])
        slope = slope @ bank.basis - (here - bank.prior.mean) @ bank.prior.precision
        step = np.linalg.solve(curvature(np.maximum(weight, least), bank), slope[..., None])[..., 0]
        longest = np.abs(step @ bank.basis.T).max(axis=1, keepdims=True)
        self.theta[rows] += step * (LONGEST_STEP / np.maximum(longest, LONGEST_STEP))
        gain = np.sum(step * slope, axis=1)
        np.maximum.at(self.best, patch, value)
        more = (gain > TOLERANCE) & (value + 10 * gain > self.best[patch] - HOPELESS) & (not last)
        self.peak[rows[~more]] = (value + gain / 2)[~more]
        self.curvature[rows[~more]] = curvature(weight[~more], bank)
        return np.asarray(rows[more])

    def fit(self) -> Fit:
        """What was found."""
        return Fit(self.peak - 0.5 * np.linalg.slogdet(self.curvature)[1], self.theta, self.curvature)


def curvature(weight: Floats, bank: Bank) -> Floats:
    """Curvature of a log density in theta, B' diag(weight) B + inverse prior covariance: (M, K) -> (M, J, J)."""
    terms = bank.basis.shape[1]
    return (weight @ bank.products).reshape(-1, terms, terms) + bank.prior.precision


def _derivatives(power: Floats, scene: Floats, mean: Floats, shape: Floats) -> tuple[Floats, Floats, Floats]:
    """Of the log likelihood by ln S of every annulus: the first, minus the second, and the least to take for that."""
    share, ratio = scene / mean, power / mean
    information = shape * share
    slope = information * (ratio - 1)
    return slope, information * share * ratio - (1 - share) * slope, LEAST_CURVATURE * information * share


def _first_guess(power: Floats, noise: Floats, bank: Bank) -> Floats:
    """The prior's mean for every row, with the contrast that its patch would have: total power beyond the noise over
    that of the mean spectrum."""
    expected = bank.attenuation @ np.exp(bank.basis @ bank.prior.mean)
    beyond = np.maximum(np.sum(power - noise, axis=-1), 0.1 * np.sum(noise, axis=-1))
    theta = np.tile(bank.prior.mean, (len(expected), 1))
    theta[:, 0] += np.log(beyond / expected)
    return theta
