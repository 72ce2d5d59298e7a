"""What scenes look like: a prior on the power spectrum of a sharp patch.

    ln S(f) = sum_j theta_j P_j(x),  x = ln f scaled to [-1, 1],  theta ~ normal(mean, covariance)

P_j are the Legendre polynomials: theta_0 is the contrast, theta_1 the slope of the power law that natural scenes
follow, the others bend it. The contrast is left free (a wide normal, independent of the rest), so that gain does not
move a distance. More numbers say how far real patches are from this: beyond the smooth curve the power of an annulus
scatters by ``roughness``, together with its neighbours (`TOGETHER`); ``misfit`` is the scatter that three quarters of
all scenes keep below, and those with more count for less (`psflut.evidence.discount`); a ``gross`` share of scenes
misleads without showing it (`psflut.gross`).

Where annuli are cut into sectors, directions phi of the spectrum differ,

    ln S(f, phi) = sum_j P_j(x) (theta_j + alpha_j cos 2 phi + beta_j sin 2 phi + gamma_j cos 4 phi),

alpha, beta, gamma of fewer terms and of mean zero, alpha and beta of one covariance: a camera may be held either way.

The numbers are learnt by `calib.textures`; ``texture.json`` holds them with where they come from.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray
from scipy import linalg

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

SECTORS = 4
"""Into which annuli may be cut: fewer do not tell astigmatism at 45 degrees, more tell little of small patches."""

ALIKE = 1.5
"""Sectors of an annulus that scatter together. With 1, 1.5, 2 and 3, and the share of gross errors that 95 % intervals
then ask for, 68 % intervals cover 68, 69, 72 and 76 % of patches of 128 pixels, 71, 75, 77 and 81 % of 256; interval
scores differ by chance alone (draws of 1152 captures, other than those that judge)."""

WAVES = ("theta", "alpha", "beta", "gamma")
"""Names of the coefficients, wave by wave around the circle."""

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
    turned : TexturePrior or None
        The prior over sectors, of the J + 3 T coefficients theta, alpha, beta, gamma.
    turns : int
        T of a prior over sectors, else 0.
    provenance : mapping
    """

    mean: Floats
    covariance: Floats
    roughness: float
    misfit: Sequence[tuple[int, float]]
    gross: float
    turned: "TexturePrior | None" = None
    turns: int = 0
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def over(self, sectors: int) -> "TexturePrior":
        """The prior for annuli that are cut into so many sectors, or whole."""
        if sectors == self.sectors:
            return self
        assert self.turned is not None
        return self.turned

    @property
    def sectors(self) -> int:
        """Into which annuli are cut that it is for."""
        return SECTORS if self.turns else 1

    @property
    def terms(self) -> int:
        """J, Legendre polynomials of theta."""
        return len(self.mean) - (len(WAVES) - 1) * self.turns

    @property
    def names(self) -> list[str]:
        """Of the coefficients: theta_0 and so on."""
        return [f"{WAVES[wave]}_{order}" for wave, order in zip(*places(self.terms, self.turns), strict=True)]

    @property
    def first(self) -> NDArray[np.intp]:
        """Number of the first coefficient of every wave; in the end J."""
        return np.cumsum([0, self.terms, self.turns, self.turns, self.turns])

    def basis(self, frequency: ArrayLike, direction: ArrayLike) -> Floats:
        """What the coefficients multiply in ln S at frequencies (K,), cycles a pixel, and directions, radians."""
        return around(frequency, direction, self.terms, self.turns)

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

        Of one annulus it is roughness^2, but m neighbours that scatter together tell of the curve as one does; so do
        `ALIKE` of the sectors of an annulus.
        """
        alike = ALIKE if self.turns else 1.0
        return np.asarray(np.maximum(TOGETHER * alike * place, 1.0) * self.roughness**2)

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
    return np.asarray(legendre.legvander(scaled(frequency), count - 1))


def scaled(frequency: ArrayLike) -> Floats:
    """x of frequencies (K,), cycles a pixel."""
    low, high = np.log(FREQUENCIES)
    return np.asarray(2.0 * (np.log(np.asarray(frequency, dtype=float)) - low) / (high - low) - 1.0)


def turning(prior: TexturePrior, two: Floats, four: Floats, roughness: float) -> TexturePrior:
    """The prior over sectors of a prior on spectra: covariances (T, T) of alpha and beta, and of gamma."""
    mean = np.append(prior.mean, np.zeros(3 * len(two)))
    covariance = linalg.block_diag(prior.covariance, two, two, four)
    return replace(prior, mean=mean, covariance=covariance, roughness=roughness, turned=None, turns=len(two))


def around(frequency: ArrayLike, direction: ArrayLike, terms: int, turns: int) -> Floats:
    """What the coefficients multiply at frequencies (K,), cycles a pixel, and directions, radians:
    (K, terms + 3 turns)."""
    wave, order = places(terms, turns)
    return basis(frequency, terms)[:, order] * waves(direction)[:, wave]


def places(terms: int, turns: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Of every coefficient, its place in `WAVES` and the order of its polynomial, (terms + 3 turns,) each."""
    counts = (terms, turns, turns, turns)
    return np.repeat(np.arange(len(WAVES)), counts), np.concatenate([np.arange(count) for count in counts])


def waves(direction: ArrayLike) -> Floats:
    """What multiplies theta, alpha, beta and gamma in directions (K,), radians: (K, 4)."""
    angle = np.asarray(direction, dtype=float)
    return np.stack([np.ones_like(angle), np.cos(2 * angle), np.sin(2 * angle), np.cos(4 * angle)], axis=1)


@cache
def learnt() -> TexturePrior:
    """The prior that ships with psflut."""
    numbers = json.loads(files("psflut").joinpath("texture.json").read_text(encoding="utf-8"))
    prior = TexturePrior(
        mean=np.array(numbers["mean"]),
        covariance=np.array(numbers["covariance"]),
        roughness=numbers["roughness"],
        misfit=_pairs(numbers["misfit"]),
        gross=numbers["gross"],
        provenance=numbers["provenance"],
    )
    sectors = numbers["sectors"]
    turned = turning(prior, np.array(sectors["two"]), np.array(sectors["four"]), sectors["roughness"])
    return replace(prior, turned=replace(turned, misfit=_pairs(sectors["misfit"]), gross=sectors["gross"]))


def _pairs(misfit: Sequence[Sequence[float]]) -> tuple[tuple[int, float], ...]:
    return tuple((int(count), float(value)) for count, value in misfit)
