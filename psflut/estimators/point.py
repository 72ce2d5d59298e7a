"""Distance of a lone bright point: star, bead, lamp."""

from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from psflut import pointfit, spread
from psflut.density import Density
from psflut.estimation import AbstractEstimator, Curve, Estimate, Outcome, Problem, conclude, nothing_to_see
from psflut.imagers import Imager
from psflut.table import PSFTable

Floats = NDArray[np.float64]

COARSE = 12
"""Candidates with which a point is looked for."""

FOUND_SIGMAS = 6.0
"""A point stands out of the noise by so many standard deviations of its flux; chance gives 4 to 5 in a patch."""


@dataclass(frozen=True)
class Point(AbstractEstimator):
    """Distance of a scene that is known to be a point: of unknown flux, place and background.

    The brightest point of the patch is looked for with a matched filter, and a window a little larger than the
    table's PSF is cut around it; `psflut.pointfit` compares it with the PSF of every candidate. Other light in the
    window is taken for blur: ``stats["misfit"]``, 1 for a point, says when the scene is none.

    Parameters
    ----------
    candidates : int
        Distances over the table's span, evenly in vergence.
    """

    candidates: int = 100
    knows: ClassVar[str] = "a point"
    sees_flat: ClassVar[bool] = True

    def solve(self, problem: Problem) -> Estimate:
        """See `AbstractEstimator`. ``stats`` has the point's place (pixels of the patch), flux, and SNR."""
        bank = pointfit.bank(problem.table, problem.imager, self.candidates)
        place, snr = _find(problem)
        if snr < FOUND_SIGMAS:
            return nothing_to_see(problem)
        window = _window(problem.image, place, bank.width)
        found = pointfit.fit(window, bank, problem.noise, problem.imager.signed)
        exact = Density(bank.even, found.log_evidence, problem.table.position)
        density = exact.widened(partial(spread.along, problem.table))
        best = int(np.argmin(np.abs(bank.even - problem.table.even(density.modes()[0].distance))))
        middle = place + found.place
        estimate = conclude(
            problem,
            density,
            Curve(problem.table.position(bank.even), found.log_evidence, "log evidence"),
            stats={
                "misfit": found.misfit,
                "y": float(middle[0]),
                "x": float(middle[1]),
                "flux": float(found.flux[best]),
                "snr": snr,
            },
            detail={"restored": _drawn(problem.shape, middle, found.flux[best], found.level[best])},
        )
        return replace(estimate, outcome=Outcome.SATURATED) if np.any(window == 1.0) else estimate


@lru_cache(maxsize=8)
def _transfers(table: PSFTable, imager: Imager, shape: tuple[int, int]) -> NDArray[np.complexfloating]:
    """What a point shows at the coarse candidates: L * h on the grid of a patch, kept for the next one."""
    return np.asarray(table.otf(shape, table.candidates(COARSE)) * imager.transfer(shape))


def _find(problem: Problem) -> tuple[NDArray[np.intp], float]:
    """Pixel of the point that explains most of the patch, and how many standard deviations it stands out."""
    shown = _transfers(problem.table, problem.imager, problem.shape)
    spectrum = fft.rfft2(problem.image - problem.image.mean())
    energy = np.sum(fft.irfft2(shown, problem.shape) ** 2, axis=(1, 2)) - shown[:, 0, 0].real ** 2 / problem.image.size
    score = fft.irfft2(spectrum * shown.conj(), problem.shape) / np.sqrt(energy)[:, None, None]
    _, y, x = np.unravel_index(np.argmax(score), score.shape)
    response = float(np.mean(problem.imager.transfer(problem.shape) ** 2))
    variance = problem.noise.read**2 + response * problem.noise.shot_variance(problem.mean_level)
    return np.array([y, x]), float(score.max() / np.sqrt(variance))


def _window(image: NDArray[np.floating], place: NDArray[np.intp], width: int) -> Floats:
    """The pixels around a place, NaN outside the patch."""
    padded = np.pad(image, width // 2, constant_values=np.nan)
    return padded[place[0] : place[0] + width, place[1] : place[1] + width]


def _drawn(shape: tuple[int, int], place: Floats, flux: float, level: float) -> Floats:
    """The sharp scene (H, W): a level, and the flux shared by the pixels around its place."""
    y, x = (np.maximum(1 - np.abs(np.arange(n) - c), 0) for n, c in zip(shape, place, strict=True))
    return np.asarray(level + flux * np.outer(y, x))
