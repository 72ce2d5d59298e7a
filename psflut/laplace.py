"""The scene integrated out of the evidence by Laplace's method, for many distances together.

    ln p(P | z) = max over theta of [ ln p(P | z, theta) + ln p(theta) ] - 1/2 ln det(curvature there)

up to what does not depend on z. With a thousand effective bins the posterior of theta is so nearly normal that emcee,
which samples the same density, gives the same distances. The maximum is found by Newton's method (`psflut.newton`).
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from psflut.evidence import Bank, scene_power

if TYPE_CHECKING:
    from psflut.newton import Model

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Fit:
    """The evidence of one patch, and the scene's spectrum that goes best with each distance.

    Parameters
    ----------
    log_evidence : (M,) array
        ln p(P | z), up to a constant that does not depend on z.
    theta : (M, J) array
        Coefficients of ln S at the maximum.
    """

    log_evidence: Floats
    theta: Floats


def integrate(power: Floats, noise: Floats, bank: Bank) -> Fit:
    """The evidence of a power under a noise power, (K,) each, at every distance of the bank."""
    from psflut import newton

    rows = bank.attenuation.shape
    theta, log_evidence = np.tile(first_guess(power[None], noise[None], bank), (rows[0], 1)), np.empty(rows[0])
    power, noise, shape = (np.array(np.broadcast_to(each, rows)) for each in (power, noise, bank.shape))
    newton.climb_all(power, noise, shape, model(bank, bank.attenuation), theta, log_evidence)
    return Fit(log_evidence, theta)


def first_guess(power: Floats, noise: Floats, bank: Bank) -> Floats:
    """The prior's mean for every patch (B, K), with the contrast that it would have at the bank's first distance:
    total power beyond the noise over that of the mean spectrum. (B, J)."""
    expected = bank.attenuation[0] @ np.exp(bank.basis @ bank.prior.mean)
    beyond = np.maximum(np.sum(power - noise, axis=-1), 0.1 * np.sum(noise, axis=-1))
    theta = np.tile(bank.prior.mean, (len(power), 1))
    theta[:, 0] += np.log(beyond / expected)
    return theta


def model(bank: Bank, attenuation: Floats) -> "Model":
    """What the compiled search needs of a bank, with the attenuation (M, K) of its distances."""
    from psflut import newton

    rows, columns = np.tril_indices(bank.basis.shape[1])
    functions = np.ascontiguousarray(bank.basis.T)
    shape = np.array(np.broadcast_to(bank.shape, len(functions[0])))
    mean, precision = np.array(bank.prior.mean), np.array(bank.prior.precision)
    return newton.Model(np.array(attenuation), shape, functions, functions[rows] * functions[columns], mean, precision)


@lru_cache(maxsize=8)
def fine_model(bank: Bank) -> "tuple[Floats, Model]":
    """Even coordinates (PLACES + 1,), ascending, and the model of a bank at them; kept for the next patch."""
    from psflut import newton

    even = np.linspace(bank.even.min(), bank.even.max(), newton.PLACES + 1)
    return even, model(bank, bank.at(even))


def curvature(weight: Floats, bank: Bank) -> Floats:
    """Curvature of a log density in theta, B' diag(weight) B + inverse prior covariance: (M, K) -> (M, J, J)."""
    return np.asarray(np.einsum("mk,ki,kj->mij", weight, bank.basis, bank.basis, optimize=True) + bank.prior.precision)


def curvature_at(power: Floats, noise: Floats, attenuation: Floats, theta: Floats, bank: Bank) -> Floats:
    """Minus the second derivative of `evidence.log_joint` by theta (M, J), with attenuation (M, K): (M, J, J)."""
    scene = scene_power(attenuation, theta, bank)
    mean = scene + noise
    share, ratio = scene / mean, power / mean
    return curvature(bank.shape * share * (share * ratio - (1 - share) * (ratio - 1)), bank)
