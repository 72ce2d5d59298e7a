"""The thesis' measure of focus (4.2.10): the power that an image holds once its borders are tapered.

A blurred picture of edges holds less power than a sharp one. White noise adds power of its own, which does
not fall with blur; `noise_power` is its expected share, to be subtracted.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import signal

from psflut.errors import PsflutError


def gaussian_window(shape: tuple[int, int], sd: float) -> NDArray[np.float64]:
    """Separable Gaussian taper, highest (about 1) at the middle of the image.

    Parameters
    ----------
    shape : (H, W)
        Of the image, in pixels.
    sd : float
        Standard deviation in fractions of each side: sd * H down, sd * W across.

    Raises
    ------
    PsflutError
        If sd is not positive.
    """
    if not sd > 0:
        raise PsflutError(f"the sd of a window must be a positive fraction of its side, got {sd}; 0.35 is usual")
    down, across = (np.exp(-0.5 * ((np.arange(n) - (n - 1) / 2) / (sd * n)) ** 2) for n in shape)
    return np.outer(down, across)


def focus_measure(image: NDArray[np.floating], window: NDArray[np.floating]) -> NDArray[np.float64]:
    """Total power of the spectrum of the tapered image (4.2.10), its mean removed.

    Phi = sum |DFT{w (g - m)}|^2 / (H W) = sum (w (g - m))^2, by Parseval, so no transform is taken.
    The mean is weighted by the window, m = sum(w g) / sum(w): then the tapered image sums to 0 and
    the spectrum has nothing at zero frequency, where blur changes nothing.

    Parameters
    ----------
    image : (..., H, W) array
        One image or several.
    window : (H, W) array
        Taper w.

    Returns
    -------
    (...) array in the square of the image's units.
    """
    g = np.asarray(image, dtype=float)
    mean = (g * window).sum(axis=(-2, -1), keepdims=True) / window.sum()
    return np.asarray(np.square(window * (g - mean)).sum(axis=(-2, -1)))


def noise_power(window: NDArray[np.floating], sigma: float, kernel: ArrayLike = 1.0) -> float:
    """What noise alone is expected to add to `focus_measure`.

    White noise of standard deviation sigma, filtered by `kernel`, has the autocovariance sigma^2 rho with
    rho = kernel correlated with itself. With (rho * w) their convolution, the expectation is exactly

        sigma^2 [ rho(0) sum w^2 - 2 sum w^2 (rho * w) / sum w + sum w^2 sum w (rho * w) / (sum w)^2 ],

    the last two terms being the power that the removal of the mean takes along.

    Parameters
    ----------
    window : (H, W) array
        Taper w of `focus_measure`.
    sigma : float
        Standard deviation of the noise before the filter, in the image's units.
    kernel : (k, k) array
        Filter that the noise went through; by default none. The noise is assumed to go on beyond the border.

    Returns
    -------
    Expected Phi, in the square of the image's units.
    """
    filtered = np.atleast_2d(np.asarray(kernel, dtype=float))
    rho = signal.correlate(filtered, filtered)
    taper, power = window / window.sum(), np.square(window)
    spread = signal.fftconvolve(taper, rho, mode="full")
    top, left = filtered.shape[0] - 1, filtered.shape[1] - 1
    spread = spread[top : top + window.shape[0], left : left + window.shape[1]]
    total = np.square(filtered).sum() * power.sum() - 2 * (power * spread).sum()
    return float(sigma**2 * (total + power.sum() * (taper * spread).sum()))
