"""What scenes look like: a prior on the power spectrum of a sharp patch.

    ln S(f) = sum_j theta_j P_j(x),  x = ln f scaled to [-1, 1],  theta ~ normal(mean, covariance)

P_j are the Legendre polynomials: theta_0 is the contrast, theta_1 the slope of the power law that natural scenes
follow, the others bend it. The contrast is left free (a wide normal, independent of the rest), so that gain does not
move a distance. More numbers say how far real patches are from this: beyond the smooth curve the power of an annulus
scatters by ``roughness``, together with its neighbours (`TOGETHER`); ``misfit`` is the scatter that three quarters of
all scenes keep below, and those with more count for less (`psflut.evidence.discount`); a ``gross`` share of scenes
misleads without showing it (`psflut.gross`).

The numbers are learnt by `calib.textures`; ``texture.json`` holds them with where they come from.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

FREQUENCIES = (0.008, 0.7072)
"""Cycles a pixel that are mapped to x = -1 and 1."""

TOGETHER = 0.03
"""Width, relative to frequency, over which the power of real scenes scatters together. The larger a patch, the more of
its annuli that is, so they tell less than as many independent ones. Residuals of kodak keep their covariance over 2 to
6 annuli of patches of 64 to 256 pixels (half of it over 0.07 of the frequency); polynomials and what oscillates in a
transfer function take up some of it. With 0, 0.02, 0.03, 0.04 and 0.1 the model's own 95 % intervals of distance cover
94, 95, 95, 95 and 96 % of 1152 captures from 64 pixels, 91, 94, 93, 94 and 96 % from 128, 85, 95, 94, 95 and 98 % from
256."""

EVERY = ((1, np.inf),)
"""A `TexturePrior.misfit` that leaves no scene out."""


@dataclass(frozen=True, eq=False)
class TexturePrior:
    """The prior on ln S of a patch, in image units squared; the module's docstring is the model.

    Parameters
    ----------
    mean : (J,) array
    covariance : (J, J) array
    roughness : float
        Standard deviation of ln power around the smooth curve, in nats.
    misfit : sequence of (int, float)
        Numbers of annuli, ascending, and that quantile of `psflut.evidence.misfit` over captures of photographs with
        patches of so many.
    gross : float
        Share of scenes whose distances err several times as much as the model says.
    provenance : mapping
    """

    mean: Floats
    covariance: Floats
    roughness: float
    misfit: Sequence[tuple[int, float]]
    gross: float
    provenance: Mapping[str, Any] = field(default_factory=dict)

    @cached_property
    def precision(self) -> Floats:
        """(J, J) inverse of the covariance."""
        return np.asarray(np.linalg.inv(self.covariance), dtype=np.float64)

    def shape(self, effective: Floats, place: Floats) -> Floats:
        """Shape of the gamma distribution of annuli of so many effective bins, at frequencies in bins of the patch: one
        over the relative variance of their mean power."""
        return 1.0 / (1.0 / effective + self.unevenness(place))

    def unevenness(self, place: Floats) -> Floats:
        """Relative variance of the scene's power beyond the smooth curve, at frequencies in bins of the patch.

        Of one annulus it is roughness^2, but m neighbours that scatter together tell of the curve as one does.
        """
        return np.asarray(np.maximum(TOGETHER * place, 1.0) * self.roughness**2)

    def usual(self, annuli: int) -> float:
        """The usual misfit of patches of so many annuli: linear in the logarithm of their number."""
        counts, misfits = zip(*self.misfit, strict=True)
        return float(np.interp(np.log(annuli), np.log(counts), misfits))

    def draw(self, frequency: Floats, rng: np.random.Generator, count: int) -> Floats:
        """`count` spectra S at those frequencies (cycles a pixel): (count, K)."""
        theta = rng.multivariate_normal(self.mean, self.covariance, size=count)
        return np.asarray(np.exp(theta @ basis(frequency, len(self.mean)).T))


def basis(frequency: ArrayLike, count: int) -> Floats:
    """The first `count` Legendre polynomials of scaled ln frequency: (K,) -> (K, count)."""
    low, high = np.log(FREQUENCIES)
    x = 2.0 * (np.log(np.asarray(frequency, dtype=float)) - low) / (high - low) - 1.0
    return np.asarray(legendre.legvander(x, count - 1))


@cache
def learnt() -> TexturePrior:
    """The prior that ships with psflut."""
    numbers = json.loads(files("psflut").joinpath("texture.json").read_text(encoding="utf-8"))
    return TexturePrior(
        mean=np.array(numbers["mean"]),
        covariance=np.array(numbers["covariance"]),
        roughness=numbers["roughness"],
        misfit=tuple((int(count), float(value)) for count, value in numbers["misfit"]),
        gross=numbers["gross"],
        provenance=numbers["provenance"],
    )
