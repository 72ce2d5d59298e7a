"""Blind Richardson-Lucy kept on the table: a restoration from every tabled PSF, the distance by their evidence."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from psflut import evidence, texture
from psflut.density import Density
from psflut.estimation import AbstractEstimator, Curve, Estimate, Problem, judge
from psflut.imagers import Imager
from psflut.restore import nonnegative, richardson_lucy
from psflut.spectrum import annular_power
from psflut.table import PSFTable

Floats = NDArray[np.float64]

ROUNDS = 2
"""Of weighting the annuli by what the fitted spectrum leaves above the noise."""


@dataclass(frozen=True)
class BlindRl(AbstractEstimator):
    """Scene and distance at once by Richardson-Lucy whose PSF never leaves the table.

    Parameters
    ----------
    restorations : int
        PSFs over the table's span, evenly in vergence, from which Richardson-Lucy starts.
    iterations : int
        Accelerated steps of each.
    candidates : int
        Distances at which the score is taken.
    tempering : float
        Factor on the score before it becomes a density.
    """

    restorations: int = 16
    iterations: int = 30
    candidates: int = 121
    tempering: float = 1.0

    def solve(self, problem: Problem) -> Estimate:
        """See `AbstractEstimator`."""
        coarse, fine = (
            _bank(problem.table, problem.shape, problem.imager, n) for n in (self.restorations, self.candidates)
        )
        noise = evidence.noise_power(fine, problem.noise, problem.mean_level)
        theta = _scenes(self._powers(problem), noise, coarse)
        order = np.argsort(coarse.even)
        theta = CubicSpline(coarse.even[order], theta[order])(fine.even)
        score = _score(annular_power(problem.image), noise, theta, fine)
        density = Density(fine.even, self.tempering * score, problem.table.position)
        outcome, stats = judge(density)
        modes = density.modes()
        psf = problem.table.at(modes[0].distance)
        return Estimate(
            distance=modes[0].distance,
            interval=density.interval(problem.level),
            level=problem.level,
            outcome=outcome,
            modes=modes,
            curve=Curve(problem.table.position(fine.even), score, "log evidence of the restoration"),
            stats=stats,
            detail={"restored": self._restored(problem, psf)[0].astype(np.float64), "psf": psf},
        )

    def _restored(self, problem: Problem, psf: Floats) -> tuple[NDArray[np.floating], float]:
        """The patch (H, W) restored with that PSF, and the factor by which its grey values are scaled."""
        image, scale = nonnegative(problem.image, problem.noise.read)
        return richardson_lucy(image.astype(np.float32), psf, self.iterations), scale

    def _powers(self, problem: Problem) -> Floats:
        """(M, K) power spectra of the restorations from M PSFs of the table, in the units of the patch."""
        planes = problem.table.at(problem.table.candidates(self.restorations))
        pairs = (self._restored(problem, psf) for psf in planes)
        return np.stack([annular_power(restored) / scale**2 for restored, scale in pairs])


def _scenes(power: Floats, noise: Floats, bank: evidence.Bank) -> Floats:
    """(M, J) coefficients of ln S read from the restorations' powers (M, K)."""
    response = np.maximum(bank.imager, 1e-9 * bank.imager.max())
    target = np.log(np.maximum(power, 1e-12 * noise) / response)
    scene, prior = np.exp(target), bank.prior
    for _ in range(ROUNDS):
        passed = bank.attenuation * scene
        weight = bank.shape * (passed / (passed + noise)) ** 4
        curvature = np.einsum("mk,ki,kj->mij", weight, bank.basis, bank.basis) + prior.precision
        slope = (weight * target) @ bank.basis + prior.precision @ prior.mean
        theta = np.linalg.solve(curvature, slope[..., None])[..., 0]
        scene = np.exp(theta @ bank.basis.T)
    return np.asarray(theta)


def _score(power: Floats, noise: Floats, theta: Floats, bank: evidence.Bank) -> Floats:
    """(M,) misfit, prior energy and log-determinant of the scene theta (M, J), in nats."""
    scene = bank.attenuation * np.exp(theta @ bank.basis.T)
    weight = bank.shape * (scene / (scene + noise)) ** 2
    curvature = np.einsum("mk,ki,kj->mij", weight, bank.basis, bank.basis) + bank.prior.precision
    joint = evidence.log_joint(power, bank.attenuation, noise, theta, bank)
    return np.asarray(joint - 0.5 * np.linalg.slogdet(curvature)[1])


@lru_cache(maxsize=8)
def _bank(table: PSFTable, shape: tuple[int, int], imager: Imager, count: int) -> evidence.Bank:
    return evidence.bank(table, shape, imager, texture.learnt(), count)
