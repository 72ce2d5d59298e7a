"""The posterior of distance on the table's own grid: what the evidence methods share."""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from psflut import evidence, fourier, restore, texture
from psflut.candidates import solve
from psflut.density import Density
from psflut.errors import PsflutError
from psflut.estimation import Problem
from psflut.gross import with_gross_errors
from psflut.imagers import Imager
from psflut.laplace import Fit, curvature_at
from psflut.spread import Spread, spread
from psflut.table import PSFTable
from psflut.texture import SECTORS

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Grid:
    """A patch's evidence at every candidate, and the posterior it makes with a prior flat in vergence.

    Parameters
    ----------
    bank : Bank
        Of the table, with shapes that count as they do for this patch.
    even : (M,) array
        Distances that were looked at, in the coordinate in which the prior is flat, ascending.
    power, noise : (K,) arrays
        Of the patch and of its noise, by annulus.
    fit : Fit
    exact : Density
        The posterior that the evidence makes with a table without errors.
    spread : callable
        Of the table's own errors, `psflut.spread`.
    density : Density
        The posterior: `exact`, with gross errors (`psflut.gross`) and widened by that spread.
    misfit : float
        Deviance an annulus of the likeliest distance, see `evidence.misfit`.
    """

    bank: evidence.Bank
    even: Floats
    power: Floats
    noise: Floats
    fit: Fit
    exact: Density
    spread: Spread
    density: Density
    misfit: float

    @cached_property
    def curvature(self) -> Floats:
        """(M, J, J) minus the second derivative of the log density by the coefficients at every maximum."""
        return curvature_at(self.power, self.noise, self.bank.at(self.even), self.fit.theta, self.bank)

    def scene_at(self, even: float) -> Floats:
        """(J,) coefficients of the scene's spectrum that suit the distance next to an even coordinate best."""
        return np.asarray(self.fit.theta[np.argmin(np.abs(self.even - even))])


def grid(problem: Problem, candidates: int, sectors: int = SECTORS) -> Grid:
    """The grid posterior of a problem; equal posteriors come from equal settings, whoever asks."""
    bank = cached_bank(problem.table, problem.shape, problem.imager, candidates, sectors)
    noise = evidence.noise_power(bank, problem.noise, problem.mean_level)
    power = problem.powers(bank.rings)
    found = solve(power, noise, bank)
    width = spread(problem.table, found.bank, noise, found.even, found.fit.log_evidence, found.fit.theta)
    exact = Density(found.even, found.fit.log_evidence, problem.table.position)
    density = with_gross_errors(exact, bank.prior.gross).widened(width)
    return Grid(found.bank, found.even, power, noise, found.fit, exact, width, density, found.misfit)


def restored(problem: Problem, found: Grid, distance: float) -> Floats:
    """The ideal image (H, W) by Wiener inversion at that distance (metres).

    The scene's spectrum is the one that suits the nearest candidate best; the imager's own filtering is part
    of the ideal image and is not undone.
    """
    theta = found.scene_at(float(problem.table.even(distance)))
    shape = fourier.padded_shape(problem.shape, problem.table.size)
    # Below the patch's own annuli theta says nothing: polynomials run off to any height there.
    frequency = np.maximum(fourier.frequency(shape), found.bank.rings.frequency[0])
    basis = found.bank.prior.basis(frequency.ravel(), fourier.direction(shape).ravel())
    scene = np.exp(basis @ theta).reshape(frequency.shape)
    response = problem.imager.transfer(shape) ** 2
    noise = problem.noise.power(response, problem.mean_level)
    ratio = noise / np.maximum(scene * response, 1e-12 * noise)
    return np.asarray(restore.wiener(problem.image, problem.table.at(distance), ratio))


def check_sectors(sectors: int) -> None:
    """Refuse a setting of an estimator that is none."""
    if sectors not in (1, SECTORS):
        raise PsflutError(f"annuli are whole (sectors=1) or cut into {SECTORS} sectors, got {sectors}")


@lru_cache(maxsize=8)
def cached_bank(
    table: PSFTable, shape: tuple[int, int], imager: Imager, count: int, sectors: int = SECTORS
) -> evidence.Bank:
    """The bank of a table with the shipped texture prior, kept for the next patch of that shape."""
    return evidence.bank(table, shape, imager, texture.learnt(), count, sectors)
