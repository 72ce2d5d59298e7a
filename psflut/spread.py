"""How far a table's own errors move the distances that are read from it.

A table carries three errors: those of its PSFs' pixels (`psf_std`), those of its positions (`axis_std`), and what a
spline cannot know between its planes. Each is turned into a standard deviation along the axis, in the coordinate in
which the prior is flat, at every candidate; the posterior of distance is then convolved with a normal error of that
width (`Density.widened`).

Compared for the pixels' errors on 78 captures of photographs, 20 pupil PSFs with noise of 20 % of each one's peak
(median error %, 95 % intervals cover, interval score relative to distance):

======================================================================  ====  ====  =====
the errors ignored                                                      1.50  78 %  0.170
propagated to the distance, as here                                     1.45  96 %  0.125
the same, T less the power that the noise adds                          1.30  92 %  0.121
gamma shapes 1 / (1/a + share^2 var ln T), share of the scene           1.46  81 %  0.167
the same, variance summed over correlated annuli                        1.58  97 %  0.187
gamma shapes without the share; Gaussian dimensions for ln T            over 100 % error
======================================================================  ====  ====  =====

Weakening the likelihood favours distances whose T is well known over those that fit. On smoother tables T less its
noise had more gross errors (24 instead of 18 % on 20 smoothed PSFs with noise of 30 % of the peak), so it is left out.
"""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.interpolate import CubicSpline

from psflut import evidence
from psflut.fourier import transfer
from psflut.laplace import curvature
from psflut.sampling import too_far
from psflut.table import PSFTable

Floats = NDArray[np.float64]
Spread = Callable[[Floats], Floats]

PLACES, FAINT = 12, 1e-3
"""Candidates at which the pixels' errors are propagated, at most: those no less likely than so much of the best."""

MIDDLE = 0.13
"""Error in the middle between two planes, in steps, where a plane left out is not predicted at all by the others.

Measured on noiseless pupil PSFs (f/2, 16 mm, 6 um; spherical aberration of 0, 0.35 and -0.35 waves) as the shift that
the evidence would see: 0.05 to 0.13 steps rms with 5 to 8 planes over 9 pixels of blur radius, where planes left out
are missed by as much as their neighbours differ (the largest is taken); 0.01 to 0.03 with 30 planes, where they are
missed by 10 to 19 %; below 0.001 with 64, missed by 2 %."""

MORE = 1.7
"""How many times what is linear in them the pixels' errors move a distance: their own power fills the zeros of T, and a
PSF is nowhere negative. Measured as the rms error over 12 tables of 16 pupil PSFs with noise of 2, 10 and 25 % of each
one's peak, at four distances of one photograph: 1.5, 1.6 and 1.9 times, of which most is a bias to the near side. (T
less its noise's power, as stated or as neighbouring planes tell it, errs no less, and 95 % intervals cover 3 to 10 %
fewer.)"""

NOISE_SHARES = (1.94, 0.5)
"""Variance that independent noise of variance 1 a pixel adds to a plane less its prediction, and to half the
difference of its neighbours."""


def spread(
    table: PSFTable,
    bank: evidence.Bank,
    noise: Floats,
    places: Floats,
    log_density: Floats,
    theta: Floats,
) -> Spread:
    """The standard deviation of a table's own error, from even coordinates (n,) to the same coordinate (n,).

    Parameters
    ----------
    table : PSFTable
    bank : Bank
    noise : (K,) array
        Noise power by annulus.
    places : (M,) array
        Even coordinates.
    log_density : (M,) array
        There, as the patch has it; only likely places are looked at.
    theta : (M, J) array
        Coefficients of the scene's spectrum that go with each.
    """
    sd = np.zeros_like(places)
    if table.psf_std is not None:
        likely = np.flatnonzero(log_density > log_density.max() + np.log(FAINT))
        chosen = likely[:: -(-len(likely) // PLACES)]
        places, sd = places[chosen], pixels(table, bank, noise, places[chosen], theta[chosen])
    order = np.argsort(places)

    def total(even: Floats) -> Floats:
        return np.hypot(along(table, even), np.interp(even, places[order], sd[order]))

    return total


def along(table: PSFTable, even: Floats) -> Floats:
    """Error of the table's positions and of interpolation between them, which every way of reading it has."""
    return np.hypot(placement(table, even), between(table, even))


def placement(table: PSFTable, even: Floats) -> Floats:
    """Standard error of the table's positions, linear between planes; 0 where it is not known."""
    if table.axis_std is None:
        return np.zeros_like(even)
    own = table.even(table.axis)
    order, slope = np.argsort(own), own**2 if table.kind == "distance" else np.ones_like(own)
    return np.interp(even, own[order], (table.axis_std * slope)[order])


def between(table: PSFTable, even: Floats) -> Floats:
    """Error of interpolation: none at planes, `MIDDLE` steps halfway times what planes left out are missed by.

    Planes that are too far apart for diffraction (`psflut.sampling`) count as missed wholly.
    """
    own = np.sort(table.even(table.axis))
    gap = np.clip(np.searchsorted(own, even) - 1, 0, len(own) - 2)
    step = np.diff(own)[gap]
    part = np.clip((even - own[gap]) / step, 0.0, 1.0)
    far = too_far(table)[:: -1 if table.kind == "distance" else 1][gap]
    missed = np.where(far, 1.0, np.interp(even, own, _missed(table)))
    return np.asarray(MIDDLE * step * 4 * part * (1 - part) * missed)


@lru_cache(maxsize=8)
def _missed(table: PSFTable) -> Floats:
    """(N,) error of each plane predicted by all others, over half the difference of its neighbours, at most 1.

    In ascending even coordinate; noise is taken off both, and the ends have their neighbours' values.
    """
    order = np.argsort(table.even(table.axis))
    own, psf = table.even(table.axis)[order], table.psf[order]
    noise = np.zeros(len(own)) if table.psf_std is None else np.sum(_errors(table)[order] ** 2, axis=(1, 2))
    missed = np.ones(len(own))
    for k in range(1, len(own) - 1):
        others = CubicSpline(np.delete(own, k), np.delete(psf, k, axis=0), axis=0)
        error = np.sum((others(own[k]) - psf[k]) ** 2) - NOISE_SHARES[0] * noise[k]
        scale = np.sum((psf[k + 1] - psf[k - 1]) ** 2) / 4 - NOISE_SHARES[1] * noise[k]
        missed[k] = 1.0 if scale <= 0 else np.sqrt(np.clip(error / scale, 0.0, 1.0))
    missed[[0, -1]] = missed[[1, -2]]
    return missed


def pixels(table: PSFTable, bank: evidence.Bank, noise: Floats, places: Floats, theta: Floats) -> Floats:
    """Standard deviation of the likeliest place due to the pixels' errors, at each of a few places (n,).

    An error e of ln T by annulus moves the maximum of the evidence by q . e / (q . t'), with t' = d ln T / d even,
    q = W' t' and W' the annuli's weights a share^2 less what the scene's spectrum takes up. With T the tapered,
    averaged |H|^2, q . e is linear in small errors of the pixels, which are taken as independent; a pixel that is
    exactly zero was cut off and has none. Positions between planes have the errors of their neighbours.
    """
    att = np.maximum(bank.at(places), 1e-300)
    scene = evidence.scene_power(att, theta, bank)
    weight = bank.shape * (scene / (scene + noise)) ** 2
    slope = bank.slope(places) / att
    taken = np.linalg.solve(curvature(weight, bank), ((weight * slope) @ bank.basis)[..., None])[..., 0]
    q = weight * (slope - taken @ bank.basis.T)
    half = table.size // 2
    rings, shape, kept = bank.rings, bank.rings.shape, np.ix_(*[np.r_[-half : half + 1]] * 2)
    out = []
    for place, towards, along_axis in zip(places, q, slope, strict=True):
        psf, std = table.at(np.clip(table.position(place), *table.span)), pixel_std(table, float(place))
        otf = transfer(psf, shape)
        power = rings.mean(rings.smear(np.abs(otf) ** 2))
        change = np.append(towards / (rings.bins * power), 0.0)[rings.index]
        gradient = np.prod(shape) * fft.irfft2(rings.pulled(change) * otf, s=shape)[kept]
        gradient -= np.sum(gradient * psf)  # the sum of a PSF is 1 whatever its errors
        told = np.sum(towards * along_axis)  # nothing where all planes are alike
        out.append(MORE * np.sqrt(np.sum((gradient * std) ** 2)) / told if told > 0 else np.inf)
    return np.minimum(out, np.ptp(bank.even))


def _errors(table: PSFTable) -> Floats:
    """(N, K, K) standard errors of the pixels that are not cut off."""
    assert table.psf_std is not None
    return np.where(table.psf > 0, table.psf_std, 0.0)


def pixel_std(table: PSFTable, even: float) -> Floats:
    """Standard errors (K, K) of a table's pixels, between its planes; pixels that were cut off have none."""
    if table.psf_std is None:
        return np.zeros(table.psf.shape[1:])
    order = np.argsort(table.even(table.axis))
    own = table.even(table.axis)[order]
    k = int(np.clip(np.searchsorted(own, even) - 1, 0, len(own) - 2))
    part = np.clip((even - own[k]) / (own[k + 1] - own[k]), 0.0, 1.0)
    low, high = (np.where(table.psf[n] > 0, table.psf_std[n], 0.0) for n in order[k : k + 2])
    return np.asarray((1 - part) * low + part * high)
