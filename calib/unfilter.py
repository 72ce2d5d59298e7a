"""Takes a known filter out of a measured PSF: the imager's own, or a target's finite size."""

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

Floats = NDArray[np.float64]

ROUNDS = 4
"""Of learning the prior; more take faint surroundings away altogether, with too small an error."""


def unfilter(shown: Floats, variance: Floats, kernel: Floats, size: int) -> tuple[Floats, Floats]:
    """The PSF h of p = kernel * h + noise, sum 1, and its standard error, by regularised least squares.

    Assumed: h is 0 outside its window of `size` pixels, independent noise, and a prior h ~ N(0, t(r)^2) whose
    variance in every ring of radius r (pixels) is learnt from p by a few rounds of expectation maximisation. A
    kernel of sum 0 hides the mean of h; the darkness outside the window tells it, and the sum is then made 1.
    The standard error is the posterior's, with twice the shrinkage that the fit would do to its own result.
    Errors are smooth and shared by many pixels: through a Laplacian they were 0.5 to 2 times what is stated.

    Parameters
    ----------
    shown, variance : (W, W) arrays
        p, and the variance of its noise; W odd, at least `size`.
    kernel : (W, W) array
        Centred.
    size : int
        Odd.

    Returns
    -------
    (size, size) arrays
    """
    matrix = _convolution(kernel, size)
    weighted = matrix.T / variance.ravel()
    normal, right = weighted @ matrix, weighted @ shown.ravel()
    line = np.arange(size) - size // 2
    ring = np.rint(np.hypot(line[:, None], line)).astype(int).ravel()
    prior = np.full(ring.max() + 1, np.sum(shown**2) / np.sum(kernel**2))
    for _ in range(ROUNDS):
        factor = linalg.cho_factor(normal + np.diag(1 / prior[ring]))
        covariance = linalg.cho_solve(factor, np.eye(size**2))
        found = covariance @ right
        prior = np.bincount(ring, found**2 + np.diag(covariance)) / np.bincount(ring)
        prior = np.maximum(prior, 1e-6 * prior.max())
    total, spread = found.sum(), covariance.sum(axis=1)
    psf, again = found / total, covariance @ (normal @ found)
    error = (np.diag(covariance) - 2 * psf * spread + psf**2 * spread.sum()) / total**2
    error += (2 * (again - psf * again.sum()) / total) ** 2
    return psf.reshape(size, size), np.sqrt(np.maximum(error, 0.0)).reshape(size, size)


def _convolution(kernel: Floats, size: int) -> Floats:
    """(W^2, size^2) matrix that convolves a window of `size` pixels with a kernel; what leaves W is lost."""
    width = len(kernel)
    half = size // 2
    padded = np.pad(kernel, half)
    places = [(y, x) for y in range(size) for x in range(size)]
    columns = [
        padded[size - 1 - y : size - 1 - y + width, size - 1 - x : size - 1 - x + width].ravel() for y, x in places
    ]
    return np.stack(columns, axis=1)
