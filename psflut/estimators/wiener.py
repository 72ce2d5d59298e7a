"""Non-blind inversion with the PSF of every candidate distance, judged by the evidence."""

from dataclasses import dataclass

from psflut.budget import budget
from psflut.estimation import AbstractEstimator, Curve, Estimate, Problem, conclude
from psflut.grid import check_sectors, grid, restored
from psflut.texture import SECTORS


@dataclass(frozen=True)
class Wiener(AbstractEstimator):
    """Distance by the evidence of the Wiener inversion, for all candidates at once.

    For each candidate the patch is inverted with the scene spectrum that suits it best; misfit, prior energy
    and log-determinant of the restored patch together are the log evidence of `psflut.evidence`, which needs
    no restored pixels. Only the winner's patch is restored and kept in ``detail["restored"]``: the ideal
    image, as the imager would see it without blur.

    ``stats`` gives the ``misfit`` (`evidence.misfit`) and the error ``budget`` (`psflut.budget`).

    Parameters
    ----------
    candidates : int
        Distances over the table's span, evenly in vergence, at which the optics' transfer is worked out. Splines serve
        between them: 100 moved an interval's end by up to half its sigma, 200 by 0.06.
    sectors : int
        Into which the annuli of the spectrum are cut: 4, or 1 for whole annuli, which take a third of the time, err a
        fifth more through a lens without aberrations, and fail with PSFs that are far from round (`psflut.evidence`).
    """

    candidates: int = 200
    sectors: int = SECTORS

    def __post_init__(self) -> None:
        check_sectors(self.sectors)

    def solve(self, problem: Problem) -> Estimate:
        """See `AbstractEstimator`."""
        found = grid(problem, self.candidates, self.sectors)
        distance = found.density.modes()[0].distance
        return conclude(
            problem,
            found.density,
            Curve(problem.table.position(found.even), found.fit.log_evidence, "log evidence"),
            stats={"misfit": found.misfit, "budget": budget(found, problem.table, distance)},
            detail={"restored": restored(problem, found, distance)},
        )
