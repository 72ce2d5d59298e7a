"""What blurred a known picture: a regularised least-squares fit whose smoothness the data choose."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft, linalg

from calib.polar import Polar

Floats = NDArray[np.float64]

ROUNDS = 40
"""At most, of learning how smooth the PSF is."""

PASSES = 3
"""Of learning where its light is."""


@dataclass(frozen=True, eq=False)
class Normal:
    """Normal equations: gram @ a = target, the power of the data, and their number less what was fitted before."""

    gram: Floats
    target: Floats
    power: float
    freedom: float

    def __add__(self, other: "Normal") -> "Normal":
        return Normal(
            self.gram + other.gram,
            self.target + other.target,
            self.power + other.power,
            self.freedom + other.freedom,
        )


def places(shape: tuple[int, int], size: int, per: int) -> tuple[Floats, Floats]:
    """(y, x) in a frame of that shape at which a picture is asked for: `per` a pixel, half a PSF beyond it."""
    y, x = (np.arange((n + size - 2) * per + 1) / per - size // 2 for n in shape)
    return y, x


def shown(scene: Floats, planes: Floats, shape: tuple[int, int], size: int, per: int) -> Floats:
    """The picture through every one of some PSFs, at the pixels of a frame: (n, H, W).

    Parameters
    ----------
    scene : (h, w) array
        At `places`, each sample the mean over a pixel around it.
    planes : (n, k, k) array
        PSFs in cells of 1 / per pixel, k = size * per or one less.
    """
    sides = [per * fft.next_fast_len(-(-(n + planes.shape[1]) // per), True) for n in scene.shape]
    # The cells of the PSF average over 1 / per pixel, which is undone. Single precision is far below any noise.
    cell = np.sinc(fft.fftfreq(sides[0]))[:, None] * np.sinc(fft.fftfreq(sides[1]))
    spectrum = fft.fft2(scene - scene.mean(), sides) / cell
    start = per * (size // 2) + planes.shape[1] // 2
    ramp = [np.exp(2j * np.pi * start * fft.fftfreq(n)) for n in sides]
    spectrum = (spectrum * ramp[0][:, None] * ramp[1]).astype(np.complex64)
    coarse = (sides[0] // per, sides[1] // per)
    out = np.empty((len(planes), *shape))
    for number in range(0, len(planes), 2):  # two real pictures in one complex transform
        pair = planes[number : number + 2]
        rows = fft.fft((pair[0] + 1j * pair[-1]).astype(np.complex64), sides[1], axis=1)
        both = fft.fft(rows, sides[0], axis=0) * spectrum
        folded = both.reshape(per, coarse[0], per, coarse[1]).sum(axis=(0, 2)) / per**2  # every per-th sample
        picture = fft.ifft2(folded)[: shape[0], : shape[1]]
        out[number], out[number + len(pair) - 1] = picture.real, picture.imag
    return out


def normal(columns: Floats, frame: Floats, free: Floats) -> Normal:
    """The normal equations of frame = a @ columns + b @ free, where the frame is not NaN, with b taken out.

    Parameters
    ----------
    columns : (n, H, W) array
    frame : (H, W) array
    free : (m, H, W) array
    """
    seen = np.isfinite(frame)
    basis = linalg.orth(free[:, seen].T)
    design, data = columns[:, seen], frame[seen]
    design = design - (design @ basis) @ basis.T
    data = data - basis @ (basis.T @ data)
    return Normal(design @ design.T, design @ data, float(data @ data), float(data.size - basis.shape[1]))


@dataclass(frozen=True, eq=False)
class Fit:
    """Coefficients a (n,), their covariance (n, n), and the variance of the noise of a pixel."""

    coefficients: Floats
    covariance: Floats
    variance: float

    def psf(self, planes: Floats) -> tuple[Floats, Floats]:
        """PSF of sum 1 and its standard error, (K, K), from the basis in pixels, (n, K, K)."""
        basis = planes.reshape(len(planes), -1).T
        total = float((basis @ self.coefficients).sum())
        psf = basis @ self.coefficients / total
        slope = (basis - psf[:, None] * basis.sum(axis=0)) / total
        variance = np.einsum("pi,ij,pj->p", slope, self.covariance, slope, optimize=True)
        shape = planes.shape[1:]
        return psf.reshape(shape), np.sqrt(np.maximum(variance, 0.0)).reshape(shape)


def solve(equations: Normal, basis: Polar) -> Fit:
    """The most probable coefficients, given that every block of the basis has a gradient of normal distribution.

    data = columns @ a + white noise, a_b ~ N(0, (weight_b bend_b)^-1). The gradient counts in units of the light at
    its radius (`Polar.light`), which is that of the fit before; the first takes it to be even. So a dark pixel is known
    to be smooth, and a lit one is not.

    Compared on printed pages at 20 distances (0.6 to 9.5 pixels of blur radius), place known, no waves: mean summed
    |error|, errors over stated ones, and log likelihood of the data. A weight by
    the radius is that of an energy over the plane.

    | prior | summed | honesty | likelihood |
    |---|---|---|---|
    | gradient | 0.0184 | 1.42 | 0 |
    | gradient / light, weighed by radius^0 | 0.0123 | 1.50 | 1075 |
    | weighed by radius: taken | 0.0111 | 1.15 | 1118 |
    | weighed by radius^2 | 0.0107 | 0.84 | 1097 |
    | heights / light, weighed by radius^0, ^1, ^2 | 0.0218, 0.0209, 0.032 | 0.71, 0.72, 0.90 | 671, 729, 623 |

    A weight for every band of the radius instead of the light gave 0.012, but errors 1.2 to 3.5 times the stated.
    """
    fit = _likeliest(equations, basis.bends(np.ones(len(basis.knots))), basis.block)
    for _ in range(PASSES):
        light = basis.light(fit.coefficients[basis.block == 0])
        fit = _likeliest(equations, basis.bends(light), basis.block)
    return fit


def _likeliest(equations: Normal, bends: Floats, block: NDArray[np.int_]) -> Fit:
    """The fit with the weights and the noise that make the data likeliest, a integrated out.

    By the fixed point of D. J. C. MacKay, Neural Computation 4, 415 (1992); a wave of which the data know nothing goes
    to zero. The covariance is that of a given the data.
    """
    variance = equations.power / equations.freedom * 0.1
    scale = np.trace(equations.gram) / len(equations.gram)
    weights = np.full(len(bends), 1e-4 * scale / variance)
    count = np.bincount(block)
    for _ in range(ROUNDS):
        prior = np.tensordot(weights, bends, 1)
        factor = linalg.cho_factor(equations.gram / variance + prior)
        covariance = linalg.cho_solve(factor, np.eye(len(prior)))
        found = covariance @ (equations.target / variance)
        known = count - weights * np.einsum("bij,ij->b", bends, covariance)
        misfit = equations.power - 2.0 * found @ equations.target + found @ equations.gram @ found
        variance = max(misfit, 1e-12 * equations.power) / (equations.freedom - known.sum())
        energy = np.einsum("bij,i,j->b", bends, found, found)
        top = 1e8 * scale / variance
        new = np.minimum(np.maximum(known, 1e-6) / np.maximum(energy, 1e-300), top)
        done = np.all(np.abs(np.log(new / weights)) < 0.01)
        weights = new
        if done:
            break
    return Fit(found, covariance, variance)
