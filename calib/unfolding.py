"""A picture between its pixels, as far as they tell: what is finer than a pixel folds into what pixels show."""

import numpy as np
from numpy.typing import NDArray
from scipy import fft, optimize

Floats = NDArray[np.float64]

FINER = 3
"""Places a pixel, each way; odd, so that pixels are among them."""

PAD = 32
"""Pixels of mirrored border while the picture is transformed."""

COARSE = 0.03
"""Cycles a pixel below which a spectrum is not asked for its law."""

MIDDLE = 512
"""Longest side, pixels, of the part whose spectrum is asked."""

MANY = 4000
"""Frequencies, chosen at random, that are asked."""


def unfolded(picture: Floats, law: Floats) -> Floats:
    """What a picture (h, w) is expected to show at `FINER` places a pixel: (FINER (h - 1) + 1, FINER (w - 1) + 1).

    A pixel's mean at whole pixels holds the scene's frequencies f + k, for all whole k, as one sum. With the scene's
    power S, seen through a pixel, and white noise N the expected share of the frequency f + k in it is

        S(f + k) / (sum_k' S(f + k') + N),      S(f) = A |f|^-a exp(-(f / b)^2) sinc(f_x)^2 sinc(f_y)^2,

    that is kriging, or Wiener's interpolation. What the scene does beyond is uncorrelated with it, so that a PSF fitted
    to a frame of which this is the sharp scene is not biased by it (regression calibration: R. J. Carroll et al.,
    Measurement Error in Nonlinear Models, 2006, section 4): it is noise. The numbers of S and N are its `law`.

    Assumed: one law of power all over the picture, the same in all directions.
    """
    mean = picture.mean()
    sides = tuple(n + 2 * PAD for n in picture.shape)
    power = _power(law, fft.fftfreq(sides[0])[:, None], fft.fftfreq(sides[1]))
    shares = power / (power.sum(axis=(0, 1)) + np.exp(law[3]))
    spectrum = fft.fft2(np.pad(picture - mean, PAD, mode="symmetric"))
    fine = np.zeros([FINER * n for n in sides], complex)
    rows, columns = (_bands(n) for n in sides)
    for i, j in np.ndindex(FINER, FINER):
        fine[np.ix_(rows[i], columns[j])] = shares[i, j] * spectrum
    inside = tuple(slice(FINER * PAD, FINER * (PAD + n - 1) + 1) for n in picture.shape)
    return np.asarray(FINER**2 * fft.ifft2(fine).real[inside] + mean)


def law(picture: Floats) -> Floats:
    """ln A, a, ln b^-2 and ln N that make the spectrum of a picture's middle likeliest (Whittle's likelihood)."""
    top, left = ((n - min(n, MIDDLE)) // 2 for n in picture.shape)
    picture = picture[top : top + MIDDLE, left : left + MIDDLE]
    picture = picture - picture.mean()
    window = np.hanning(picture.shape[0])[:, None] * np.hanning(picture.shape[1])
    seen = np.abs(fft.rfft2(picture * window)) ** 2 * picture.size / np.sum(window**2)
    down, across = np.broadcast_arrays(fft.fftfreq(picture.shape[0])[:, None], fft.rfftfreq(picture.shape[1]))
    rng = np.random.default_rng(0)
    asked = rng.permutation(np.flatnonzero((np.hypot(down, across) > COARSE) & (across > 0)))[:MANY]
    seen, down, across = seen.ravel()[asked], down.ravel()[asked], across.ravel()[asked]

    def unlikely(law: Floats) -> float:
        model = _power(law, down, across).sum(axis=(0, 1)) + np.exp(law[3])
        return float(np.mean(np.log(model) + seen / model))

    start = [np.log(seen.mean()) - 4.0, 2.0, 3.0, np.log(np.quantile(seen, 0.05) + 1e-300)]
    return np.asarray(optimize.minimize(unlikely, start, method="Nelder-Mead", options={"maxfev": 1000}).x)


def _aliases() -> NDArray[np.int_]:
    """Whole cycles a pixel that fold onto one another at `FINER` places a pixel."""
    return np.arange(FINER) - FINER // 2


def _bands(count: int) -> list[NDArray[np.int_]]:
    """Where a line of `count` frequencies and its aliases stand among FINER times as many."""
    own = np.rint(fft.fftfreq(count, 1 / count)).astype(int)
    return [(own + k * count) % (FINER * count) for k in _aliases()]


def _power(law: Floats, down: Floats, across: Floats) -> Floats:
    """S at frequencies, cycles a pixel, and all their aliases: (FINER, FINER, ..)."""
    down, across = np.broadcast_arrays(down, across)
    shift = _aliases().reshape(-1, *[1] * down.ndim)
    v, u = (down + shift)[:, None], (across + shift)[None]
    square = v**2 + u**2 + 1e-12
    return np.asarray(
        np.exp(law[0] - 0.5 * law[1] * np.log(square) - np.exp(law[2]) * square) * (np.sinc(v) * np.sinc(u)) ** 2
    )
