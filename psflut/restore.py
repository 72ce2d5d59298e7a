"""Restoration with a known or an unknown PSF: array in, array out.

Border rule: convolution is circular on a grid larger than the image, and the result is cropped. Beyond its
border `wiener` takes the image to go on mirrored, the two sides fading into each other (`continued`).
Richardson-Lucy takes that only for a start: there the scene reaches half a PSF beyond the border and is
judged by the pixels inside alone (Bertero and Boccacci 2005; MATLAB's WEIGHT). Against truth
both err less along the border than plain mirroring or a circular image, which ring, or zeros, which darken.

Arithmetic is float32 for a float32 image, else float64. Nothing is clipped but Richardson-Lucy's
estimates, at zero. Frequencies are those of ``scipy.fft.rfft2``.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft, signal

from psflut.errors import PsflutError
from psflut.fourier import continued, padded_shape, transfer
from psflut.reblur import blur

Reals = NDArray[np.floating]
Spectrum = NDArray[np.complexfloating]

NOISE_SIGMAS = 6.0  # below zero, from which an image is signed rather than noisy
LEAST = 0.01  # share of its light inside the image below which a scene pixel is left as it is


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
    image, psf = _checked(image, psf)
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


def richardson_lucy(
    image: Reals,
    psf: Reals,
    iterations: int,
    *,
    start: Reals | None = None,
    acceleration: bool = True,
    filter_epsilon: float = 0.0,
) -> Reals:
    """Maximum likelihood restoration under Poisson noise with a known PSF (Richardson 1972, Lucy 1974).

    f <- f corr(h, g / (h * f)) (4.2.6), divided by the share of each scene pixel's light that falls inside
    the image. With `acceleration` each step starts from a prediction (`_Path`). Few iterations regularise.

    Parameters
    ----------
    image : (H, W) array
        Capture g, non-negative: map a signed one by its minimum and maximum to [0, 1] before.
    psf : (K, K) array
        h, non-negative, sum 1, centred on K // 2, K odd.
    iterations : int
        Number of steps.
    start : (H, W) array, optional
        First estimate, non-negative; flat by default.
    filter_epsilon : float
        Where h * f is below it, g / (h * f) counts as 0, as in scikit-image.

    Returns
    -------
    (H, W) non-negative array in the units of the image.

    Raises
    ------
    PsflutError
        For arrays of a wrong shape, values that are not finite or negative, or a PSF that does not sum to 1.
    """
    image, psf = _checked(image, psf, positive=True)
    first = np.full_like(image, image.mean()) if start is None else np.asarray(start, image.dtype)
    first, _ = _checked(first, psf, positive=True)
    reblur = blur(psf, (image.shape[0], image.shape[1]))
    seen = reblur.pulled(np.ones_like(image))
    share, unseen = 1 / np.maximum(seen, LEAST), np.flatnonzero(seen <= LEAST)
    path = _Path(reblur.laid(first))
    for _ in range(iterations):  # in place: new arrays of this size cost half a transform each
        guess = path.prediction() if acceleration else path.now
        now = reblur.pulled(_ratio(image, reblur.seen(guess), filter_epsilon))
        now *= share
        now.put(unseen, 1)
        now *= guess
        path = path.moved(guess, now) if acceleration else _Path(now)
    return reblur.cut(path.now)


def blind_richardson_lucy(
    image: Reals, psf: Reals, iterations: int, *, acceleration: bool = True
) -> tuple[Reals, Reals]:
    """The thesis' blind restoration (4.2.6): image and PSF at once, both by accelerated Richardson-Lucy.

    After MATLAB's deconvblind. From the image itself and the starting PSF, each iteration predicts both
    (`_Path`), reblurs once, and from the same predictions steps f <- f corr(h, g / (h * f)) and
    h <- h corr(f, g / (h * f)), each divided as in `richardson_lucy`; h keeps its size and sum.
    Its zeros stay zeros, so a flat start is the open one. The solution is not unique: **the size of the
    start largely decides it**. (deconvblind is circular, and correlates with the estimates before
    prediction: neither moves the baseline's distances by 1 cm.)

    Parameters
    ----------
    image : (H, W) array
        Capture g, non-negative: map a signed one by its minimum and maximum to [0, 1] before.
    psf : (K, K) array
        Starting h, non-negative, sum 1, K odd.
    iterations : int
        Number of steps; the thesis takes 20.

    Returns
    -------
    restored : (H, W) non-negative array in the units of the image
    psf : (K, K) non-negative array, sum 1

    Raises
    ------
    PsflutError
        As `richardson_lucy`.
    """
    image, psf = _checked(image, psf, positive=True)
    grid, size = padded_shape(image.shape, len(psf) // 2), len(psf)
    scene, spot, weight = _Path(continued(image, grid)), _Path(psf), _weight(image, grid)
    for _ in range(iterations):
        guess, blur = (path.prediction() if acceleration else path.now for path in (scene, spot))
        spectrum, otf = fft.rfft2(guess), transfer(blur / blur.sum(), grid)
        reblurred = fft.irfft2(spectrum * otf, grid)[: image.shape[0], : image.shape[1]]
        ratio = np.stack([fft.rfft2(_ratio(image, reblurred), grid), weight])
        gain, seen = _correlated(ratio, otf, grid)
        scene = scene.moved(guess, guess * _share(gain, seen))
        gain, seen = _central(_correlated(ratio, spectrum, grid), size)
        likelier = blur * gain / seen
        spot = spot.moved(blur, likelier / likelier.sum())
    return scene.now[: image.shape[0], : image.shape[1]], spot.now


def blurred(image: Reals, psf: Reals) -> Reals:
    """h * f for an image (H, W) and a PSF (K, K), mirrored beyond its border as captures are."""
    mirrored = np.pad(image, len(psf) // 2, mode="symmetric")
    return np.asarray(signal.oaconvolve(mirrored, psf.astype(image.dtype, copy=False), mode="valid"))


def nonnegative(image: Reals, sigma: float) -> tuple[Reals, float]:
    """An image as Richardson-Lucy can take it, and the factor by which its grey values were scaled.

    A signed image, below zero by more than `NOISE_SIGMAS` noise sigma, is mapped by its own minimum and maximum to
    [0, 1], as the thesis' set-up maps its Laplacian; blur commutes with that, because a PSF sums to 1. What
    noise alone took below zero is set to zero, as deconvblind does.
    """
    low, high = float(image.min()), float(image.max())
    if low < -NOISE_SIGMAS * sigma:
        return (image - low) / (high - low), 1.0 / (high - low)
    return np.maximum(image, 0.0), 1.0


@dataclass(frozen=True)
class _Path:
    """Where an iteration stands, and what it needs to look ahead.

    With the steps g_k = x_k+1 - y_k from each prediction, y_k+1 = max(x_k+1 + a (x_k+1 - x_k), 0) where
    a = <g_k, g_k-1> / <g_k-1, g_k-1> within [0, 1]; without two steps, y = x.
    D. S. C. Biggs and M. Andrews, Applied Optics 36, 1766 (1997).
    """

    now: Reals
    before: Reals | None = None
    steps: tuple[Reals, ...] = ()  # newest first, at most two

    def prediction(self) -> Reals:
        if self.before is None or len(self.steps) < 2:
            return self.now
        agreement, length = (float(np.vdot(step, self.steps[1])) for step in self.steps)
        pace = min(max(agreement / length, 0.0), 1.0) if length > 0 else 0.0
        return np.asarray(np.maximum(self.now + pace * (self.now - self.before), 0))

    def moved(self, guess: Reals, now: Reals) -> "_Path":
        return _Path(now, self.now, (now - guess, *self.steps[:1]))


def _weight(image: Reals, grid: tuple[int, int]) -> Spectrum:
    """Spectrum of the weights: 1 inside the image, 0 beyond."""
    return np.asarray(fft.rfft2(np.ones_like(image), grid))


def _ratio(image: Reals, reblurred: Reals, filter_epsilon: float = 0.0) -> Reals:
    """image / reblurred in the place of `reblurred`; no division by mere rounding."""
    dark = reblurred < filter_epsilon if reblurred.min() < filter_epsilon else None
    np.maximum(reblurred, np.finfo(image.dtype).eps * image.max(), out=reblurred)
    np.divide(image, reblurred, out=reblurred)
    if dark is not None:
        reblurred[dark] = 0
    return reblurred


def _share(gain: Reals, seen: Reals) -> Reals:
    """gain / seen, and 1 where the image sees next to nothing of a scene pixel."""
    return np.divide(gain, seen, out=np.ones_like(gain), where=seen > LEAST)


def _correlated(spectrum: Spectrum, other: Spectrum, grid: tuple[int, int]) -> Reals:
    """corr(other, image) of two spectra, less what rounding leaves below zero."""
    return np.asarray(np.maximum(fft.irfft2(spectrum * np.conj(other), grid), 0))


def _central(image: Reals, size: int) -> Reals:
    """The (size, size) pixels about the origin of a circular grid, which `transfer` laid there."""
    return np.roll(image, (size // 2, size // 2), axis=(-2, -1))[..., :size, :size]


def _checked(image: Reals, psf: Reals, positive: bool = False) -> tuple[Reals, Reals]:
    """Image and PSF in the precision of the work, once they are seen to be sound."""
    kind = np.float32 if np.asarray(image).dtype == np.float32 else np.float64
    image, psf = np.asarray(image, dtype=kind), np.asarray(psf, dtype=kind)
    if image.ndim != 2 or psf.ndim < 2 or not (0 < psf.shape[-2] == psf.shape[-1] <= min(image.shape)):
        raise PsflutError(
            f"expected an image (H, W) and a PSF (K, K) no larger, got {image.shape} and {psf.shape}; crop it"
        )
    if psf.shape[-1] % 2 == 0:
        raise PsflutError(f"the side of a PSF must be odd, to have a middle, got {psf.shape}; pad or crop it")
    if not (np.all(np.isfinite(image)) and np.all(np.isfinite(psf))):
        raise PsflutError("image and PSF must be finite, got NaN or infinity; mask or mend those pixels")
    if np.any(np.abs(psf.sum(axis=(-2, -1)) - 1) > 1e-3):
        raise PsflutError(f"the PSF must sum to 1, got {psf.sum(axis=(-2, -1))}; divide it by its sum")
    if positive and (image.min() < 0 or psf.min() < 0 or image.max() == 0):
        raise PsflutError(
            f"Richardson-Lucy needs a PSF and an image that are not negative, nor all dark, got minima "
            f"{psf.min():.3g} and {image.min():.3g}; map a signed image by its minimum and maximum to [0, 1]"
        )
    return image, psf
