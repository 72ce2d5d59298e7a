"""The Cramer-Rao bound on distance from two captures of one scene: the Fisher information of `psflut.joint`'s model.

At every frequency the images (F1, F2) are complex Gaussian with covariance S a a* + diag(N1, N2). With
b = (H1 / sqrt N1, c H2 / sqrt N2) and A = |b|^2, a parameter turns b by rho = (b1 db2 - b2 db1) / A and lengthens it by
d ln A. Slepian's and Bangs' formula then gives an information of

    2 (S A)^2 / (1 + S A) Re(rho_i* rho_j)  +  (S A / (1 + S A))^2 d ln A_i d ln A_j

an independent frequency. The first is free of the scene but for its power; the second is that of a single image,
its annuli counted as the texture prior does and the scene's spectrum a nuisance under that prior. Ratio of exposures
and shift are nuisances too.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from psflut.estimation import Problem
from psflut.fourier import direction, frequency, once, slopes, transfer
from psflut.pair import Spectrum, paired
from psflut.spectrum import annuli
from psflut.texture import FREQUENCIES, TexturePrior

Floats = NDArray[np.float64]

STEP = 1e-3
"""Of the numerical derivative by distance, as a share of the span."""


def bound(first: Problem, second: Problem, even: float, theta: Floats, prior: TexturePrior, gain: float = 1.0) -> float:
    """Least standard deviation of an unbiased estimate, in the coordinate of the flat prior.

    Parameters
    ----------
    first, second : Problem
        Of which shape, tables, imager, noise and level of light are used.
    even : float
        The distance.
    theta : (J,) array
        The scene's ln spectrum in the basis of the texture prior; average over draws to marginalise.
    prior : TexturePrior
    gain : float
        Exposure of the second image over that of the first.
    """
    span = np.sort(first.table.even(first.table.span))
    step, shape, rings = STEP * float(np.ptp(span)), first.shape, annuli(first.shape, prior.sectors)
    low, high = np.clip([even - step, even + step], *span)
    response = first.imager.transfer(shape) ** 2
    b = _whitened(first, second, even, gain, response)
    slope = (_whitened(first, second, high, gain, response) - _whitened(first, second, low, gain, response)) / (
        high - low
    )
    total = np.sum(np.abs(b) ** 2, axis=0)
    radius = np.maximum(frequency(shape), FREQUENCIES[0])
    scene = np.exp(prior.basis(radius.ravel(), direction(shape).ravel()) @ theta).reshape(radius.shape)
    snr = scene * response * total
    share = snr / (1 + snr)

    turns = (
        np.stack([b[0] * slope[1] - b[1] * slope[0], *(b[0] * b[1] * each for each in (1.0, *slopes(shape)))]) / total
    )
    weight = paired(first, second, span).window.freedom / (shape[0] * shape[1]) * once(shape) * 2 * share * snr
    information = np.zeros((4 + len(theta),) * 2)
    information[:4, :4] = np.real(np.einsum("kl,ikl,jkl->ij", weight, turns.conj(), turns))

    lengths = 2 * np.real(np.stack([np.sum(b.conj() * slope, axis=0), np.abs(b[1]) ** 2])) / total
    by_place, by_gain = rings.mean(lengths * share) / rings.mean(share)
    still = np.zeros_like(by_gain)
    change = np.column_stack([by_place, by_gain, still, still, prior.basis(rings.frequency, rings.direction)])
    information += (change.T * (prior.shape(rings.effective, rings.place) * rings.mean(share) ** 2)) @ change
    information[4:, 4:] += prior.precision
    return float(np.sqrt(linalg.inv(information)[0, 0]))


def _whitened(first: Problem, second: Problem, even: float, gain: float, response: Floats) -> Spectrum:
    """(2, H, W // 2 + 1): b at a distance."""
    parts = []
    for each, factor in ((first, 1.0), (second, gain)):
        psf = each.table.at(np.clip(each.table.position(even), *each.table.span))
        parts.append(factor * transfer(psf, first.shape) / np.sqrt(each.noise.power(response, each.mean_level)))
    return np.stack(parts)
