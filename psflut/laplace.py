"""The scene integrated out of the evidence by Laplace's method, for many distances together.

    ln p(P | z) = max over theta of [ ln p(P | z, theta) + ln p(theta) ] - 1/2 ln det(curvature there)

up to what does not depend on z. With a thousand effective bins the posterior of theta is so nearly normal that emcee,
which samples the same density, gives the same distances. The maximum is found by Newton's method
(`psflut.kernels.climbing`).
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from psflut.evidence import Bank, scene_power

if TYPE_CHECKING:
    from psflut.kernels.lanes import Model

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
    from psflut.kernels import climbing, lanes

    places, own = np.arange(len(bank.attenuation)), model(bank, bank.attenuation)
    theta, log_evidence = first_guess(power[None], noise[None], bank, bank.attenuation), np.empty((1, len(places)))
    summits = lanes.Summits(places[None], theta, log_evidence, np.full(1, -np.inf))
    patches = lanes.Patches(*(np.array(each[None]) for each in (power, noise, own.shape)))
    climbing.climb(places, patches, summits, own, lanes.room(own))
    return Fit(log_evidence[0], theta[0])


def first_guess(power: Floats, noise: Floats, bank: Bank, attenuation: Floats) -> Floats:
    """The prior's mean for patches (B, K), with the contrast that each would have at distances of that attenuation
    (M, K): total power beyond the noise over that of the mean spectrum. (B, M, J)."""
    expected = attenuation @ np.exp(bank.basis @ bank.prior.mean)
    beyond = np.maximum(np.sum(power - noise, axis=-1), 0.1 * np.sum(noise, axis=-1))
    theta = np.tile(bank.prior.mean, (len(power), len(attenuation), 1))
    theta[..., 0] += np.log(beyond[:, None] / expected)
    return theta


def model(bank: Bank, attenuation: Floats) -> "Model":
    """What the compiled search needs of a bank, with the attenuation (M, K) of its distances."""
    from psflut.kernels.lanes import Model

    rows, columns = np.triu_indices(bank.basis.shape[1])
    basis = np.array(bank.basis.T, order="C")
    mean, precision = np.array(bank.prior.mean), np.array(bank.prior.precision)
    shape = np.array(np.broadcast_to(bank.shape, len(bank.basis)))
    functions = np.array(basis.T, order="C")
    products, packed = functions[:, rows] * functions[:, columns], precision[rows, columns]
    return Model(np.array(attenuation, order="C"), shape, basis, functions, products, mean, precision, packed)


@lru_cache(maxsize=8)
def fine_model(bank: Bank) -> "tuple[Floats, Model]":
    """Even coordinates (PLACES + 1,), ascending, and the model of a bank at them; kept for the next patch."""
    from psflut.kernels.exploring import PLACES

    even = np.linspace(bank.even.min(), bank.even.max(), PLACES + 1)
    return even, model(bank, bank.at(even))


def curvature(weight: Floats, bank: Bank) -> Floats:
    """Curvature of a log density in theta, B' diag(weight) B + inverse prior covariance: (M, K) -> (M, J, J)."""
    return np.asarray(np.einsum("mk,ki,kj->mij", weight, bank.basis, bank.basis, optimize=True) + bank.prior.precision)


def curvature_at(power: Floats, noise: Floats, attenuation: Floats, theta: Floats, bank: Bank) -> Floats:
    """Minus the second derivative of `evidence.log_joint` by theta (M, J), with attenuation (M, K): (M, J, J).

    Where it is not positive, beside a summit that was not climbed to the top, annuli that bend upwards are left out.
    """
    scene = scene_power(attenuation, theta, bank)
    mean = scene + noise
    share, ratio = scene / mean, power / mean
    weight = bank.shape * share * (share * ratio - (1 - share) * (ratio - 1))
    found = curvature(weight, bank)
    bent = np.linalg.eigvalsh(found)[:, 0] <= 0
    found[bent] = curvature(np.maximum(weight[bent], 0.0), bank)
    return found
