"""Scenes of the model itself: periodic Gaussian fields whose patches have, by annulus, a given spectrum."""

from functools import cache

import numpy as np
from scipy import fft

from psflut import texture
from psflut.ensemble import SLOWEST
from psflut.spectrum import annuli

SIDE, FALL = 256, 2.5
"""Of a field, pixels; and how its spectrum goes on below `SLOWEST`, falling towards zero frequency, where the
polynomials would run off and a field be nothing but shade."""

ROUNDS = 3


def field(theta, side, rng):
    """A field, mean 1/2, of which patches (side, side) show the spectrum exp(basis theta) on average.

    The taper mixes neighbouring frequencies, so what is drawn is divided by what that makes of it, a few times over.
    """
    rings, (frequency, matrix, fall) = annuli((side, side)), _grid(len(theta))
    wanted = np.exp(texture.basis(rings.frequency, len(theta)) @ theta)
    spectrum = np.exp(matrix @ theta).reshape(frequency.shape) * fall
    assert rings.doubled == (SIDE, SIDE)
    for _ in range(ROUNDS):
        spectrum = spectrum * np.interp(frequency, rings.frequency, wanted / rings.leaked(spectrum))
    spectrum[0, 0] = 0.0
    waves = fft.rfft2(rng.standard_normal((SIDE, SIDE))) * np.sqrt(spectrum)
    return 0.5 + fft.irfft2(waves, s=(SIDE, SIDE))


@cache
def _grid(terms):
    frequency = np.hypot(fft.fftfreq(SIDE)[:, None], fft.rfftfreq(SIDE))
    matrix = texture.basis(np.maximum(frequency, SLOWEST).ravel(), terms)
    fall = np.minimum(np.maximum(frequency, 1 / SIDE) / SLOWEST, 1.0) ** FALL
    return frequency, matrix, fall
