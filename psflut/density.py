"""A posterior density of distance on a grid: median, intervals, modes.

The density lives in the coordinate in which the prior is flat (`PSFTable.even`: vergence, or the stage
coordinate) and is handed out in metres.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from psflut import tabulated
from psflut.tabulated import FAINT, FINE, Modes

Floats = NDArray[np.float64]


class Mode(NamedTuple):
    """One peak of a posterior: its median (metres) and its probability."""

    distance: float
    weight: float


@dataclass(frozen=True, eq=False)
class Density:
    """A density known by its logarithm at some nodes, a cubic spline between them.

    Parameters
    ----------
    even : (M,) array
        Nodes, in any order, in the coordinate of the flat prior.
    log_density : (M,) array
        Up to a constant.
    position : callable
        From that coordinate to metres.
    """

    even: Floats
    log_density: Floats
    position: Callable[[ArrayLike], Floats]

    @classmethod
    def tabled(cls, nodes: Floats, values: Floats, position: Callable[[ArrayLike], Floats]) -> "Density":
        """The density with those values (FINE,) at a grid's nodes, between which nothing is left to work out."""
        values = values / values.max()
        density = cls(nodes, np.log(np.maximum(values, FAINT)), position)
        vars(density).update(nodes=nodes, values=values)
        return density

    @cached_property
    def nodes(self) -> Floats:
        """(FINE,) ascending nodes in the even coordinate."""
        return np.linspace(self.even.min(), self.even.max(), FINE)

    @cached_property
    def values(self) -> Floats:
        """(FINE,) density at `nodes`, its largest value 1."""
        order = np.argsort(self.even)
        rows = tabulated.tabulate(self.even[None, order], self.log_density[None, order], np.array([len(order)]))
        return np.asarray(rows[0])

    @property
    def log_values(self) -> Floats:
        """(FINE,) logarithm of `values`, never less than that of what counts as no density at all."""
        return np.log(np.maximum(self.values, FAINT))

    @cached_property
    def cumulative(self) -> Floats:
        """(FINE,) probability below each node, by the trapezium rule."""
        return np.asarray(tabulated.cumulated(self.values[None])[0])

    def widened(self, spread: Callable[[Floats], Floats]) -> "Density":
        """The density of a coordinate that is this one plus a normal error, mirrored at the ends of the grid.

        The error's standard deviation, ``spread(even)``, may vary along the axis (`tabulated.widened`).

        Parameters
        ----------
        spread : callable
            From even coordinates (n,) to standard deviations (n,) in that coordinate.
        """
        rows = self.values[None]
        wide = tabulated.widened(rows, spread(self.nodes) / np.diff(self.nodes[:2]))
        return self if wide is rows else Density.tabled(self.nodes, wide[0], self.position)

    @property
    def mean(self) -> float:
        """Posterior mean, in the even coordinate."""
        return float(np.average(self.nodes, weights=self.values))

    def quantile(self, probability: Floats | list[float]) -> Floats:
        """Even coordinates below which that probability lies."""
        wanted = np.asarray(probability, dtype=float)
        rows = np.zeros(wanted.size, np.int64)
        return self._even(tabulated.quantiles(self.cumulative[None], rows, wanted.ravel())).reshape(wanted.shape)

    def _even(self, nodes: Floats) -> Floats:
        return np.asarray(self.nodes[0] + nodes * (self.nodes[-1] - self.nodes[0]) / (FINE - 1))

    def interval(self, level: float) -> tuple[float, float]:
        """Equal-tailed credible interval, (near, far) in metres."""
        return interval_of(self.position(self.quantile(tails(level))))

    def sample(self, rng: np.random.Generator, count: int) -> Floats:
        """Independent draws, in the even coordinate."""
        return self.quantile(rng.random(count))

    @cached_property
    def borders(self) -> Floats:
        """Even coordinates where one mode ends and the next begins, ascending, with both ends of the grid."""
        return np.asarray(self.nodes[np.append(self.parts.start, FINE - 1)])

    @cached_property
    def parts(self) -> Modes:
        """The modes in ascending order, in nodes."""
        return tabulated.modes(self.values[None], self.cumulative[None])

    def modes(self) -> tuple[Mode, ...]:
        """The modes, heaviest first."""
        return self._modes

    @cached_property
    def _modes(self) -> tuple[Mode, ...]:
        medians = self.position(self.quantile(self.parts.below + self.parts.weight / 2))
        modes = [Mode(float(z), float(w)) for z, w in zip(medians, self.parts.weight, strict=True)]
        return tuple(sorted(modes, key=lambda mode: -mode.weight))

    def edge(self) -> str | None:
        """ "near" or "far" where the density is highest at that end of the grid, else None."""
        peak = int(np.argmax(self.values))
        if 0 < peak < FINE - 1:
            return None
        ends = self.position(self.nodes[[0, -1]])
        return "near" if ends[0 if peak == 0 else 1] == ends.min() else "far"


def mirrored(even: Floats, low: float, high: float) -> Floats:
    """Coordinates that left [low, high], brought back as `Density.widened` mirrors them."""
    folded = np.mod(even - low, 2 * (high - low))
    return np.asarray(low + np.minimum(folded, 2 * (high - low) - folded))


def tails(level: float) -> list[float]:
    """Probabilities at the two ends of an equal-tailed interval."""
    return [0.5 - level / 2, 0.5 + level / 2]


def interval_of(ends: Floats) -> tuple[float, float]:
    """Two positions in ascending order."""
    return float(ends.min()), float(ends.max())
