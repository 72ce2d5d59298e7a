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
from scipy import fft

Floats = NDArray[np.float64]

FINE = 4096
"""Nodes of the grid that integrals are taken on."""

WIDTHS, FAINT = 9, 1e-15
"""Normal kernels between whose widths those of a convolution are mixed; what counts as no density at all."""

VALLEY, LOWEST_PEAK = 0.5, 1e-3
"""A peak is a mode of its own if the density falls below half of it before a higher peak, and if it is not
lower than a thousandth of the highest."""


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
        from psflut import curves

        order, log = np.argsort(self.even), np.empty(FINE)
        curves.spline(self.even[order], self.log_density[order], log)
        return np.asarray(np.exp(log - log.max()))

    @property
    def log_values(self) -> Floats:
        """(FINE,) logarithm of `values`, never less than that of what counts as no density at all."""
        return np.log(np.maximum(self.values, FAINT))

    @cached_property
    def cumulative(self) -> Floats:
        """(FINE,) probability below each node, by the trapezium rule."""
        sums = np.concatenate([[0.0], np.cumsum(0.5 * (self.values[1:] + self.values[:-1]))])
        return np.asarray(sums / sums[-1])

    def widened(self, spread: Callable[[Floats], Floats]) -> "Density":
        """The density of a coordinate that is this one plus a normal error, mirrored at the ends of the grid.

        The error's standard deviation, ``spread(even)``, may vary along the axis: each part of the density is
        convolved with the two nearest of `WIDTHS` kernels, mixed so that its variance is exact. An error below the step
        of the fine grid changes nothing.

        Parameters
        ----------
        spread : callable
            From even coordinates (n,) to standard deviations (n,) in that coordinate.
        """
        step = np.diff(self.nodes[:2])
        variance = np.minimum(spread(self.nodes), np.ptp(self.nodes)) ** 2
        if variance.max() < step**2:
            return self
        widths = np.linspace(0.0, np.sqrt(variance.max()), WIDTHS)
        shares = np.stack([np.interp(variance, widths**2, unit) for unit in np.eye(WIDTHS)])
        waves = np.pi * np.arange(FINE) / (FINE * step)  # of the cosines, which mirror at the ends
        kernels = np.exp(-0.5 * (waves * widths[:, None]) ** 2)
        total = fft.idct(np.sum(kernels * fft.dct(shares * self.values), axis=0))
        return Density.tabled(self.nodes, np.maximum(total, 0.0), self.position)

    @property
    def mean(self) -> float:
        """Posterior mean, in the even coordinate."""
        return float(np.average(self.nodes, weights=self.values))

    def quantile(self, probability: Floats | list[float]) -> Floats:
        """Even coordinates below which that probability lies."""
        return np.asarray(np.interp(np.asarray(probability), self.cumulative, self.nodes))

    def interval(self, level: float) -> tuple[float, float]:
        """Equal-tailed credible interval, (near, far) in metres."""
        return interval_of(self.position(self.quantile(tails(level))))

    def sample(self, rng: np.random.Generator, count: int) -> Floats:
        """Independent draws, in the even coordinate."""
        return self.quantile(rng.random(count))

    @cached_property
    def borders(self) -> Floats:
        """Even coordinates where one mode ends and the next begins, ascending, with both ends of the grid."""
        from psflut import curves

        return np.asarray(self.nodes[curves.borders(self.values, LOWEST_PEAK, VALLEY)])

    def modes(self) -> tuple[Mode, ...]:
        """The modes, heaviest first."""
        return self._modes

    @cached_property
    def _modes(self) -> tuple[Mode, ...]:
        shares = np.interp(self.borders, self.nodes, self.cumulative)
        medians = self.position(self.quantile(0.5 * (shares[1:] + shares[:-1])))
        modes = [Mode(float(z), float(w)) for z, w in zip(medians, np.diff(shares), strict=True)]
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
