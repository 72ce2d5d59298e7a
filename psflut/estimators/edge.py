"""Distance of straight edges between black and white: a printed target, a door frame, a roof line."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache, partial
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from psflut import restore, spread
from psflut.density import Density
from psflut.edges import Sampled, Search
from psflut.estimation import AbstractEstimator, Curve, Estimate, Outcome, Problem, conclude
from psflut.imagers import Imager
from psflut.table import PSFTable

Floats = NDArray[np.float64]

HIGHEST, FREQUENCIES = 1.5, 160
"""Of spatial frequency, cycles a pixel, and nodes of the integral over it: enough for 40 pixels beside an edge."""


@dataclass(frozen=True)
class Edge(AbstractEstimator):
    """Distance of a scene that is known to hold straight edges, found by `psflut.edges`.

    Beside an edge at the signed distance s, and u along it, pixels show

        low(u) + step(u) E_z(s - shift(u)) + n,

    E_z being the tabled PSF (and the imager) summed up across the edge. Levels and shift are straight lines in u, the
    shift so small that E_z is linear in it; they are the best for every distance z, and what is left is normally
    distributed with the stated noise, or with more where no distance leaves as little. All edges count together.

    A table holds PSFs by the pixel, and what is finer is guessed by a spline: where blur is less than 3 pixels in
    radius the distance errs by up to a hundredth for that, and intervals do not know it. Of the table's own errors
    those of its positions are counted and those between its planes, not those of its pixels.

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
        positions = problem.table.candidates(self.candidates)
        log, misfit = _log_likelihood(problem, edges, positions)
        exact = Density(problem.table.even(positions), log, problem.table.position)
        density = exact.widened(partial(spread.along, problem.table))
        ratio = problem.noise.read**2 / max(float(np.var(problem.image)), 1e-30)
        restored = restore.wiener(problem.image, problem.table.at(density.modes()[0].distance), ratio)
        estimate = conclude(
            problem,
            density,
            Curve(positions, log, "log likelihood"),
            stats={"edges": len(edges), "misfit": misfit},
            detail={"restored": restored},
        )
        return estimate if edges else replace(estimate, outcome=Outcome.FLAT)


def _log_likelihood(problem: Problem, edges: Sequence[Sampled], positions: Floats) -> tuple[Floats, float]:
    """ln p(samples | z) at positions (M,), the noise no less than what the best leaves; and its misfit."""
    left, freedom = np.zeros(len(positions)), 0
    for edge in edges:
        variance = problem.noise.read**2 + problem.noise.shot_variance(
            problem.mean_level if problem.imager.signed else float(edge.values.mean())
        )
        left += _left(problem.table, problem.imager, positions, edge) / variance
        freedom += len(edge.values)
    misfit = float(left.min()) / max(freedom, 1)
    return -0.5 * left / max(misfit, 1.0), misfit


def _left(table: PSFTable, imager: Imager, positions: Floats, edge: Sampled) -> Floats:
    """Power of what the best light and shift leave of an edge's samples, at every position: (M,)."""
    response = _response(table, imager, tuple(positions), edge.line.angle)
    frequency, weight = _nodes()
    wave = np.exp(2j * np.pi * frequency[:, None] * edge.distance)
    spread = 2.0 * np.real((response * weight) @ wave)
    rise = 2.0 * np.imag((response * (weight / (2.0 * np.pi * frequency))) @ wave)
    light = edge.light
    columns = [np.broadcast_to(light, (len(positions), *light.shape))]
    columns += [rise[:, :, None] * light, spread[:, :, None] * light]
    base = np.linalg.qr(np.concatenate(columns, axis=2))[0]
    return np.asarray(np.sum(edge.values**2) - np.sum(np.einsum("mnc,n->mc", base, edge.values) ** 2, axis=1))


@lru_cache(maxsize=64)
def _response(table: PSFTable, imager: Imager, positions: tuple[float, ...], angle: float) -> NDArray[np.complex128]:
    """Transfer function of PSF and imager along the normal of an edge: (M, FREQUENCIES)."""
    planes = signal.fftconvolve(table.at(positions), imager.kernel()[None], axes=(1, 2))
    across = np.arange(planes.shape[1]) - planes.shape[1] // 2
    rows, columns = _nodes()[0] * np.cos(angle), _nodes()[0] * np.sin(angle)
    seen = np.einsum("myx,fy,fx->mf", planes, _waves(rows, across), _waves(columns, across), optimize=True)
    return np.asarray(seen * _between(rows) * _between(columns))


def _waves(frequency: Floats, place: NDArray[np.int_]) -> NDArray[np.complex128]:
    return np.asarray(np.exp(-2j * np.pi * frequency[:, None] * place))


def _between(frequency: Floats) -> Floats:
    """Transfer function of the cubic spline through samples a pixel apart, beyond their Nyquist frequency too."""
    return np.asarray(np.sinc(frequency) ** 4 * 3.0 / (2.0 + np.cos(2.0 * np.pi * frequency)))


@cache
def _nodes() -> tuple[Floats, Floats]:
    """Gauss-Legendre nodes from 0 to `HIGHEST` cycles a pixel, and their weights."""
    node, weight = np.polynomial.legendre.leggauss(FREQUENCIES)
    return 0.5 * HIGHEST * (node + 1.0), 0.5 * HIGHEST * weight
