"""Distance of straight edges between black and white: a printed target, a door frame, a roof line."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from psflut import edgefit, restore
from psflut.edges import Search
from psflut.estimation import AbstractEstimator, Curve, Estimate, Outcome, Problem, conclude


@dataclass(frozen=True)
class Edge(AbstractEstimator):
    """Distance of a scene that is known to hold straight edges, found by `psflut.edges`.

    Beside an edge at the signed distance s, and u along it, pixels show

        low(u) + step(u) E_z(s - shift(u)) + n,

    E_z being the tabled PSF (and the imager) summed up across the edge. Levels and shift are straight lines in u, the
    shift so small that E_z is linear in it; they are the best for every distance z. What is left is noise as stated, or
    more where parts of the edges contradict each other (`psflut.edgefit`). All edges count together.

    A table holds PSFs by the pixel, and what is finer is guessed by a spline: where blur is less than 3 pixels in
    radius the distance errs by up to a hundredth for that, and intervals do not know it. The table's own errors are
    counted: of its positions, between its planes, and of its pixels, taken as independent.

    No texture prior is needed, so that an edge says several times as much as its surroundings do. A patch without
    a straight edge is FLAT. ``stats`` holds the number of edges and ``misfit``, the power of what is left over
    that of the noise: far above 1 where the scene is no edge, or the table not that of this camera.

    Parameters
    ----------
    candidates : int
        Distances over the table's span, evenly in vergence.
    """

    candidates: int = 200
    knows: ClassVar[str] = "straight edges between black and white"

    def solve(self, problem: Problem) -> Estimate:
        """See `AbstractEstimator`."""
        edges, _ = Search().edges(np.asarray(problem.image), problem.table.size, problem.imager)
        table = problem.table
        found = edgefit.fit(edges, table, problem.imager, problem.noise, problem.mean_level, self.candidates)
        positions = table.candidates(self.candidates)
        density = found.density(table)
        ratio = problem.noise.read**2 / max(float(np.var(problem.image)), 1e-30)
        restored = restore.wiener(problem.image, table.at(density.modes()[0].distance), ratio)
        estimate = conclude(
            problem,
            density,
            Curve(positions, found.log_likelihood(found.squares), "log likelihood"),
            stats={"edges": len(edges), "misfit": found.misfit},
            detail={"restored": restored},
        )
        return estimate if edges else replace(estimate, outcome=Outcome.FLAT)
