"""Noise of a capture, in image units: full scale is 1."""

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft

from psflut.errors import PsflutError
from psflut.fourier import frequency

THESIS_READINGS = ("variance", "relative")
"""The thesis adds noise with "variance 0.1 % of the image gray levels", which can be read in two ways."""

LEAST, MOST = 1e-30, 1e30
"""Of a read sigma and a gain: their squares and sums of those are still numbers."""


@dataclass(frozen=True)
class Noise:
    """Independent noise of a pixel: variance = read^2 + (signal - offset) / gain.

    Parameters
    ----------
    read : float
        Standard deviation of the signal-independent part, in image units; it includes quantisation.
    gain : float or None
        Photo-electrons at full scale; None leaves shot noise out.
    offset : float
        Level of a dark pixel, in image units.

    Raises
    ------
    PsflutError
        If read or gain is not between `LEAST` and `MOST`.
    """

    read: float
    gain: float | None = None
    offset: float = 0.0

    def __post_init__(self) -> None:
        for name, value in (("noise", self.read), ("gain", 1.0 if self.gain is None else self.gain)):
            if not LEAST < value < MOST:
                raise PsflutError(
                    f"{name} must be positive, from {LEAST:g} to {MOST:g}, got {value:g}; image units run from 0 to 1"
                )

    def shot_variance(self, signal: ArrayLike) -> NDArray[np.float64]:
        """Variance of the photon noise at a level (image units), or at several."""
        beyond = np.maximum(np.subtract(signal, self.offset), 0.0)
        return np.asarray(0.0 * beyond if self.gain is None else beyond / self.gain)

    def power(
        self, response: NDArray[np.float64], signal: ArrayLike, white: NDArray[np.float64] | float = 1.0
    ) -> NDArray[np.float64]:
        """Mean power at frequencies where the imager has the squared response |L|^2: only photon noise is coloured.

        Of several signals (...), one after the other: (..., *response.shape).

        `white` is what white noise of variance 1 has there, if not 1 (`psflut.spectrum.Annuli.white`).
        """
        return np.asarray(self.read**2 * white + np.multiply.outer(self.shot_variance(signal), response))

    def with_quantisation(self, bits: int) -> "Noise":
        """The same with the rounding to 2^bits levels added, a uniform error of variance step^2 / 12."""
        step = 1.0 / (2**bits - 1)
        return dataclasses.replace(self, read=float(np.hypot(self.read, step / np.sqrt(12.0))))


def thesis_noise(reading: str, level: float, capture: NDArray[np.floating]) -> Noise:
    """White noise of the thesis' "0.1 %" (level = 1e-3) in one of its two readings.

    ``variance``: the variance is `level` times the full grey range squared (1 in image units).
    ``relative``: the variance is `level` times the variance of the noiseless capture.
    """
    if reading not in THESIS_READINGS:
        raise PsflutError(f"unknown reading {reading!r} of the noise; choose one of {', '.join(THESIS_READINGS)}")
    scale = 1.0 if reading == "variance" else float(np.var(capture))
    return Noise(read=float(np.sqrt(max(level * scale, 0.0))))


def parse_noise(text: str, capture: NDArray[np.floating]) -> Noise:
    """Noise from ``"0.005"`` (read sigma), ``"variance:1e-3"`` or ``"relative:1e-3"`` (`thesis_noise`)."""
    reading, colon, number = text.rpartition(":")
    try:
        value = float(number)
    except ValueError:
        raise PsflutError(
            f"noise is a read sigma such as 0.005, or variance:1e-3 or relative:1e-3, got {text!r}"
        ) from None
    if not (np.isfinite(value) and value > 0):
        raise PsflutError(f"noise must be positive and finite, got {text!r}; image units run from 0 to 1")
    return thesis_noise(reading, value, capture) if colon else Noise(read=value)


def estimate_noise(image: NDArray[np.floating], quantum: float = 0.0) -> Noise:
    """White noise of an image from its highest spatial frequencies; never below its quantisation.

    Assumes that beyond half a cycle a pixel (the corners of the spectrum) scene and optics leave nothing:
    a sharp, finely textured image gives too large a value. The power of white noise is exponentially
    distributed, so its median is ln 2 times its mean.

    Parameters
    ----------
    image : (H, W) array
    quantum : float
        Step between neighbouring levels, image units; 0 where it is not known.
    """
    height, width = image.shape
    window = np.outer(np.hanning(height + 2)[1:-1], np.hanning(width + 2)[1:-1])
    power = np.abs(fft.rfft2(window * (image - image.mean()))) ** 2 / np.sum(window**2)
    corner = frequency((height, width)) > 0.5
    sigma = np.sqrt(np.median(power[corner]) / np.log(2.0))
    floor = max(quantum / np.sqrt(12.0), 1e-6 * float(np.abs(image).max()), 1e-12)
    return Noise(read=float(max(sigma, floor)))
