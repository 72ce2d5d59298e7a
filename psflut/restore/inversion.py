"""Inversion of a known blur: least mean square error with stationary noise and scene (Wiener 1949)."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft

from psflut.errors import PsflutError
from psflut.fourier import continued, padded_shape, transfer
from psflut.restore.intake import checked

Reals = NDArray[np.floating]
Spectrum = NDArray[np.complexfloating]


def wiener_filter(otf: Spectrum, noise_to_signal: ArrayLike) -> Spectrum:
    """conj(H) / (|H|^2 + noise_to_signal), and 0 where both are 0; the arguments broadcast."""
    power = otf.real**2 + otf.imag**2 + np.asarray(noise_to_signal, dtype=otf.real.dtype)
    return np.asarray(np.conj(otf) * np.divide(1, power, out=np.zeros_like(power), where=power > 0))


def wiener(image: Reals, psf: Reals, noise_to_signal: ArrayLike) -> Reals:
    """Least mean square error restoration (Wiener 1949) of g = h * f + n, one for each PSF.

    F = mean + conj(H) G / (|H|^2 + N / S) with stationary noise of power spectrum N and a stationary scene of
    power spectrum S about its mean; the mean passes undamped.

    Parameters
    ----------
    image : (H, W) array
        Capture g; may be signed.
    psf : (..., K, K) array
        h, sum 1, centred on K // 2, K odd.
    noise_to_signal : float or array
        N / S, non-negative; an array lies on the ``rfft2`` grid of ``padded_shape(image.shape, K)``.
        To invert something else, such as an imager, see `wiener_filter`.

    Returns
    -------
    (..., H, W) array in the units of the image.

    Raises
    ------
    PsflutError
        For arrays of a wrong shape, values that are not finite, or a PSF that does not sum to 1.
    """
    image, psf = checked(image, psf)
    grid = padded_shape(image.shape, psf.shape[-1])
    scene, otf, ratio = continued(image, grid), transfer(psf, grid), np.asarray(noise_to_signal)
    if ratio.shape[-2:] not in ((), otf.shape[-2:]) or not np.all(ratio >= 0):
        raise PsflutError(
            f"noise_to_signal must be a non-negative number or array of shape {otf.shape[-2:]}, got shape "
            f"{ratio.shape}; lay it on the rfft2 grid of padded_shape"
        )
    mean = scene.mean()
    scene -= mean
    spectrum = wiener_filter(otf, ratio)
    spectrum *= fft.rfft2(scene)
    return np.asarray(fft.irfft2(spectrum, grid, overwrite_x=True)[..., : image.shape[0], : image.shape[1]] + mean)
