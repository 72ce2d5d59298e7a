"""Richardson-Lucy with an unknown PSF: the thesis' baseline."""

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from psflut.fourier import continued, padded_shape, transfer
from psflut.restore.intake import checked
from psflut.restore.steps import LEAST, Path, ratio, rounding

Reals = NDArray[np.floating]
Spectrum = NDArray[np.complexfloating]


def blind_richardson_lucy(
    image: Reals, psf: Reals, iterations: int, *, acceleration: bool = True
) -> tuple[Reals, Reals]:
    """The thesis' blind restoration (4.2.6): image and PSF at once, both by accelerated Richardson-Lucy.

    After MATLAB's deconvblind. From the image itself and the starting PSF, each iteration predicts both
    (`Path`), reblurs once, and from the same predictions steps f <- f corr(h, g / (h * f)) and
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
    image, psf = checked(image, psf, positive=True)
    grid, size = padded_shape(image.shape, len(psf) // 2), len(psf)
    scene, spot, weight, least = Path(continued(image, grid)), Path(psf), _weight(image, grid), rounding(image)
    for _ in range(iterations):
        guess, blur = (path.prediction() if acceleration else path.now for path in (scene, spot))
        spectrum, otf = fft.rfft2(guess), transfer(blur / blur.sum(), grid)
        reblurred = fft.irfft2(spectrum * otf, grid)[: image.shape[0], : image.shape[1]]
        pulls = np.stack([fft.rfft2(ratio(image, reblurred, least), grid), weight])
        gain, seen = _correlated(pulls, otf, grid)
        scene = scene.moved(guess, guess * _share(gain, seen))
        gain, seen = _central(_correlated(pulls, spectrum, grid), size)
        likelier = blur * gain / seen
        spot = spot.moved(blur, likelier / likelier.sum())
    return scene.now[: image.shape[0], : image.shape[1]], spot.now


def _weight(image: Reals, grid: tuple[int, int]) -> Spectrum:
    """Spectrum of the weights: 1 inside the image, 0 beyond."""
    return np.asarray(fft.rfft2(np.ones_like(image), grid))


def _share(gain: Reals, seen: Reals) -> Reals:
    """gain / seen, and 1 where the image sees next to nothing of a scene pixel."""
    return np.divide(gain, seen, out=np.ones_like(gain), where=seen > LEAST)


def _correlated(spectrum: Spectrum, other: Spectrum, grid: tuple[int, int]) -> Reals:
    """corr(other, image) of two spectra, less what rounding leaves below zero."""
    return np.asarray(np.maximum(fft.irfft2(spectrum * np.conj(other), grid), 0))


def _central(image: Reals, size: int) -> Reals:
    """The (size, size) pixels about the origin of a circular grid, which `transfer` laid there."""
    return np.roll(image, (size // 2, size // 2), axis=(-2, -1))[..., :size, :size]
