"""A lone point against every candidate distance: flux, place and background are fitted, and integrated over."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from psflut.imagers import Imager
from psflut.noise import Noise
from psflut.subpixel import finer
from psflut.table import PSFTable

Floats = NDArray[np.float64]
Images = NDArray[np.float32]

FACTOR = 4
"""Samples a pixel at which PSFs are held; between them they are interpolated by cubic convolution."""

SLACK = 3
"""Pixels that a point may lie off the middle of its window, and one more."""

EVERY = 4
"""Of the candidates, those with which the place is looked for."""

ROUNDS = 3
"""Of fits in which the place, and then the variance, follow."""


@dataclass(frozen=True, eq=False)
class Bank:
    """What a point shows at M candidates, sampled `FACTOR` times a pixel.

    Parameters
    ----------
    even : (M,) array
        Candidates in the coordinate of the flat prior, ascending.
    width : int
        W, side of the window in pixels: the PSF and some dark around it.
    shown : (M, F, F) array
        L * h; F = FACTOR (W + 2 SLACK).
    light, doubt : (M, W, W) arrays
        L^2 * h, which photon noise follows, and L^2 * psf_std^2, in whole pixels. No light where L is 1: it is what is
        shown.
    modes : (J, M, F, F) array
        L * the modes of the table, sampled as `shown` is.
    """

    even: Floats
    width: int
    shown: Images
    light: Images | None
    doubt: Images
    modes: Images

    def part(self, which: slice) -> "Bank":
        """Some of the candidates."""
        light = None if self.light is None else self.light[which]
        return Bank(self.even[which], self.width, self.shown[which], light, self.doubt[which], self.modes[:, which])


@dataclass(frozen=True, eq=False)
class Fit:
    """Of M candidates: log evidence up to a constant, flux, and level of the background.

    ``place`` is that of the best candidate, (y, x) in pixels from the window's middle; ``misfit`` its squared residual
    in units of the variance, 1 where all is as modelled.
    """

    log_evidence: Floats
    flux: Floats
    level: Floats
    place: Floats
    misfit: float


@lru_cache(maxsize=4)
def bank(table: PSFTable, imager: Imager, count: int) -> Bank:
    """The bank of a table, kept for the next point."""
    even = np.sort(table.even(table.candidates(count)))
    positions = np.clip(table.position(even), *table.span)
    planes, kernel = table.at(positions), imager.kernel()
    width = table.size + 2 * max(4, table.size // 6)
    fine, *modes = (
        _filtered(finer(each, FACTOR, width + 2 * SLACK), kernel) for each in (planes, *table.modes_at(positions))
    )
    border = [(0, 0), *[((width - table.size) // 2,) * 2] * 2]

    def spread(variance: Floats) -> Images:
        padded = np.pad(variance.astype(np.float32), border)
        return np.asarray(ndimage.convolve(padded, kernel[None] ** 2, mode="constant"), np.float32)

    light = spread(planes) if kernel.size > 1 else None
    return Bank(even, width, fine, light, spread(_doubt(table, even)), np.array(modes).reshape(-1, *fine.shape))


def fit(window: Floats, bank: Bank, noise: Noise, signed: bool) -> Fit:
    """Fit g(x) = b + a (L * h_z)(x - c) to a window, for every candidate z; h_z is the PSF and its modes.

    The modes' factors have a standard normal prior and are integrated over with the rest.
    Noise is Gaussian, its variance read^2 + (L^2 * light) / gain + a^2 (L^2 * psf_std^2) as the best candidate has it,
    one for all: with a variance of its own, a wrong candidate can explain a point away as noise. The light of the
    background is b less the dark level; a signed imager hides it, and the quieter half of the window tells its noise.
    Flat priors of b, c and ln a are integrated over by Laplace's formula. Where even the best candidate leaves more
    than the variance explains, the variance is multiplied by its misfit, so that what the model does not know widens
    intervals.

    Place and variance are found with every `EVERY`-th candidate; from there each goes its own linear step.

    Parameters
    ----------
    window : (W, W) array
        Around the point's pixel; NaN where there is nothing.
    """
    known = np.isfinite(window)
    g, place = window[known].astype(np.float32), np.zeros(2)
    hidden = (1.4826 * np.median(np.abs(g - np.median(g)))) ** 2 if signed else 0.0
    variance = np.full(len(g), max(noise.read**2, hidden), np.float32)
    some = bank.part(slice(None, None, EVERY))
    for _ in range(ROUNDS):
        found = _at(g, known, some, place, variance)
        best = int(np.argmax(found.log_evidence))
        place = np.clip(found.place, 1 - SLACK, SLACK - 1)
        some = some.part(slice(best, best + 1))
        variance = _variance(found.flux[best], found.level[best], some, place, known, noise, signed)
        variance = np.maximum(variance, np.float32(hidden))
    return _at(g, known, bank, place, variance)


def _variance(
    flux: float, level: float, bank: Bank, place: Floats, known: NDArray[np.bool_], noise: Noise, signed: bool
) -> Images:
    """(n,) of the pixels, if the only candidate of a bank is the right one."""
    light = bank.light[0] if bank.light is not None else np.maximum(_values(bank.shown, place, bank.width)[0][0], 0)
    ground = 0.0 if signed else max(level - noise.offset, 0.0)
    shot = (ground + flux * light) / (noise.gain or np.inf)
    return np.asarray((noise.read**2 + shot + flux**2 * bank.doubt[0])[known], np.float32)


def _at(g: Images, known: NDArray[np.bool_], bank: Bank, place: Floats, variance: Images) -> Fit:
    """The fit of all candidates, linear in the step from that place. Single precision is a millionth of the light."""
    columns, terms = _columns(bank, place, known), len(bank.modes)
    weighted = columns / variance
    information = (weighted @ columns.transpose(0, 2, 1)).astype(float)
    told = (weighted @ g).astype(float)
    alone = np.linalg.inv(information[:, :4, :4])
    flux = np.einsum("mj,mj->m", alone[:, 0], told[:, :4])  # without modes, whose spread is a share of it
    flux = np.maximum(flux, np.sqrt(alone[:, 0, 0]))  # light is positive; ln a has to begin somewhere
    prior = np.zeros_like(told)
    prior[:, 4:] = flux[:, None] ** -2
    information += prior[:, None] * np.eye(4 + terms)
    theta = np.linalg.solve(information, told[..., None])[..., 0]
    theta[:, 0] = np.maximum(theta[:, 0], np.sqrt(alone[:, 0, 0]))
    left = g - (theta[:, None].astype(np.float32) @ columns)[:, 0]
    squares = np.sum(left**2 / variance, axis=1, dtype=float) + np.sum(prior * theta**2, axis=1)
    best = int(np.argmin(squares))
    misfit = float(squares[best] / max(len(g) - 5, 1))
    occam = 0.5 * np.linalg.slogdet(information)[1] + 3 * np.log(theta[:, 0]) + terms * np.log(flux)
    log = -0.5 * squares / max(misfit, 1.0) - occam
    return Fit(log, theta[:, 0], theta[:, 1], place + theta[best, 2:4] / theta[best, 0], misfit)


def _columns(bank: Bank, place: Floats, known: NDArray[np.bool_]) -> Images:
    """(M, 4 + J, n) what flux, level, flux times a step down and right, and modes do to pixels, by the unit."""
    value, down, right = (part[:, known] for part in _values(bank.shown, place, bank.width))
    modes = (_values(mode, place, bank.width)[0][:, known] for mode in bank.modes)
    return np.stack([value, np.ones_like(value), down, right, *modes], axis=1)


def _values(fine: Images, place: Floats, width: int) -> tuple[Images, Images, Images]:
    """Pixels (M, W, W) of what is finely sampled, moved to a place, and their slopes in y and x of that place."""
    start = FACTOR * (SLACK - place)
    first = np.floor(start).astype(int)
    (up, down), (left, right) = (_cubic(t) for t in start - first)
    rows = [fine[:, first[0] + k - 1 :: FACTOR][:, :width] for k in range(4)]
    moved, sloped = (sum(w * row for w, row in zip(weights, rows, strict=True)) for weights in (up, down))
    columns = [slice(first[1] + k - 1, first[1] + k - 1 + FACTOR * width, FACTOR) for k in range(4)]

    def across(image: Images, weights: Images) -> Images:
        return np.asarray(sum(w * image[:, :, part] for w, part in zip(weights, columns, strict=True)))

    slope = np.float32(-FACTOR)
    return across(moved, left), slope * across(sloped, left), slope * across(moved, right)


def _cubic(t: float) -> tuple[Images, Images]:
    """Weights of four neighbours in cubic convolution (Keys 1981) at t behind the second, and their slopes."""
    value = [-t + 2 * t**2 - t**3, 2 - 5 * t**2 + 3 * t**3, t + 4 * t**2 - 3 * t**3, t**3 - t**2]
    slope = [-1 + 4 * t - 3 * t**2, -10 * t + 9 * t**2, 1 + 8 * t - 9 * t**2, 3 * t**2 - 2 * t]
    return np.array(value, np.float32) * np.float32(0.5), np.array(slope, np.float32) * np.float32(0.5)


def _filtered(fine: Images, kernel: Floats) -> Images:
    """A kernel of whole pixels applied to what is finely sampled."""
    if kernel.size == 1:
        return fine * np.float32(kernel.item())
    half = len(kernel) // 2
    wide = np.zeros_like(fine)
    for (i, j), weight in np.ndenumerate(kernel):
        wide += np.float32(weight) * np.roll(fine, (FACTOR * (i - half), FACTOR * (j - half)), axis=(1, 2))
    return wide


def _doubt(table: PSFTable, even: Floats) -> Floats:
    """Variance of the table's PSFs (M, K, K), linear between its planes."""
    if table.psf_std is None:
        return np.zeros((len(even), table.size, table.size))
    order = np.argsort(table.even(table.axis))
    nodes, values = table.even(table.axis)[order], table.psf_std[order] ** 2
    above = np.clip(np.searchsorted(nodes, even), 1, len(nodes) - 1)
    share = ((even - nodes[above - 1]) / (nodes[above] - nodes[above - 1]))[:, None, None]
    return np.asarray((1 - share) * values[above - 1] + share * values[above])
