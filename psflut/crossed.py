"""What two images of one scene say of distance whatever the scene is: each blurred by the other's PSF, they agree.

    g1 = h1(z) * f + n1,   g2 = c h2(z) * s * f + n2   =>   r(z) = c s * h2(z) * g1 - h1(z) * g2 = noise alone

with c the ratio of exposures and s a small shift. At the true distance r has the power spectrum
D = c^2 |H2|^2 N1 + |H1|^2 N2, at another one the scene shows through (the cross relation of blind identification:
Xu, Liu, Tong, Kailath, IEEE Trans. Signal Processing 43, 2982 (1995); for depth from defocus, the orthogonal
operators of Favaro, Soatto, IEEE PAMI 27, 406 (2005)). With the scene's power S the density of both images is, at each
frequency,

    ln p = - w |r|^2 / D  +  (what the amplitudes say, `psflut.joint`)

with w as in `psflut.pair`. c and s solve a regression of g2 on g1, both as blurred, in which g1 has noise as well: what
that adds to the normal equations is subtracted, which serves where it is not most of the image.

Nothing is assumed of the scene, not even beyond the border: r is taken where both convolutions see the image alone, and
tapered there. Assumed: the same imager, magnification and point of view (a shift of up to a pixel is fitted, with the
ratio of exposures, at every distance), the same object in both.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft

from psflut.fourier import slopes
from psflut.pair import Pair, otf

Floats = NDArray[np.float64]

SOLVES = 2
"""Times that gain and shift are fitted, each with the noise that the last gain makes."""

LOOSE = (1.0, 1.0)
"""Standard deviations of the ratio of exposures, relative to its first guess, and of a shift (pixels), before they
are fitted."""

FAINT = 1e-6
"""Noise below so much of its largest power at other frequencies is rounding."""

LARGEST_CORRECTION = 0.8
"""Share of a regressor's power that is taken for noise, at most."""


@dataclass(frozen=True, eq=False)
class Residual:
    """How two images disagree at each of M distances.

    Parameters
    ----------
    deviance : (M,) array
        Sum over independent frequencies of w |r|^2 / D at the gain and shift that suit the distance.
    log_volume : (M,) array
        ln of what the integral over gain and shift adds, but for a constant.
    gain : (M,) array
        c.
    shift : (M, 2) array
        Of the second image, down and across, pixels.
    """

    deviance: Floats
    log_volume: Floats
    gain: Floats
    shift: Floats


def residual(pair: Pair, even: ArrayLike) -> Residual:
    """That of a pair at distances (M,) in the coordinate of the flat prior."""
    rows = [_solve(pair, each) for each in np.atleast_1d(even)]
    deviance, volume, beta = (np.array(column) for column in zip(*rows, strict=True))
    return Residual(deviance, volume, beta[:, 0], beta[:, 1:3] / beta[:, :1] + pair.shift)


def told(pair: Pair, places: ArrayLike, gain: float) -> float:
    """What the deviance is expected to grow by from one of two distances to the other: 0 for equal PSFs."""
    one, two = (
        np.stack([otf(each.table, place, pair.grid) / np.sqrt(noise) for place in np.asarray(places)])
        for each, noise in zip((pair.first, pair.second), pair.noises, strict=True)
    )
    total = np.prod(np.abs(one) ** 2 + gain**2 * np.abs(two) ** 2, axis=0)
    turned = np.abs(gain * (one[0] * two[1] - two[0] * one[1])) ** 2 / np.maximum(total, np.finfo(float).tiny)
    return float(np.sum(pair.weight * pair.share / (1 - pair.share) * turned))


def _solve(pair: Pair, even: float) -> tuple[float, float, Floats]:
    """Deviance, log volume, and (c, c dy, c dx, a constant) at one distance."""
    one, two = (otf(each.table, even, pair.grid) for each in (pair.first, pair.second))
    moved, taper = pair.spectra[0] * two, pair.window.taper
    down, across = _slopes(pair.grid)
    shown = fft.irfft2(np.stack([moved, moved * down, moved * across, pair.spectra[1] * one]), s=pair.grid)
    seen = fft.rfft2(taper * np.concatenate([shown[:3], np.ones_like(shown[:1]), shown[3:]]))
    noises = (np.abs(two) ** 2 * pair.noises[0], np.abs(one) ** 2 * pair.noises[1])
    left, right = (np.maximum(pair.window.smeared(each), FAINT * each.max()) for each in noises)
    beta = np.array([pair.contrast, 0.0, 0.0, 0.0])
    ridge = np.array([LOOSE[0], LOOSE[1], LOOSE[1], 1.0]) ** -2.0 / pair.contrast**2
    for _ in range(SOLVES):
        weight = pair.weight / (beta[0] ** 2 * left + right)
        scaled = (seen * np.sqrt(weight / pair.window.energy)).astype(np.complex64).view(np.float32).reshape(5, -1)
        products = (scaled @ scaled.T).astype(float)
        normal, aim = products[:4, :4], products[:4, 4]
        noise = np.minimum(_squares(pair.grid) @ (weight * left).ravel(), LARGEST_CORRECTION * np.diag(normal))
        normal = normal + np.diag(ridge - noise)
        beta = np.linalg.solve(normal, aim + ridge * [pair.contrast, 0.0, 0.0, 0.0])
    rest = np.append(beta, -1.0) @ scaled
    return float(np.vdot(rest, rest)), float(-0.5 * np.linalg.slogdet(normal)[1]), beta


@lru_cache(maxsize=4)
def _slopes(grid: tuple[int, int]) -> NDArray[np.complex64]:
    return np.asarray(slopes(grid).astype(np.complex64))


@lru_cache(maxsize=4)
def _squares(grid: tuple[int, int]) -> Floats:
    """(4, bins) what the regressors (image, its two derivatives, a constant) make of the noise's power."""
    down, across = (np.abs(_slopes(grid)) ** 2).reshape(2, -1)
    return np.stack([np.ones_like(down), down, across, np.zeros_like(down)])
