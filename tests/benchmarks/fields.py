"""Scenes of the model itself: periodic Gaussian fields whose patches have, by annulus and sector, a given spectrum."""

from functools import cache

import numpy as np
from scipy import fft

from psflut import fourier
from psflut.ensemble import SLOWEST
from psflut.spectrum import annuli

SIDE, FALL = 256, 2.5
"""Of a field, pixels; and how its spectrum goes on below `SLOWEST`, falling towards zero frequency, where the
polynomials would run off and a field be nothing but shade."""

ROUNDS = 3


def field(theta, prior, side, rng):
    """A field, mean 1/2, of which patches (side, side) show the spectrum exp(basis theta) on average.

    The taper mixes neighbouring frequencies, so what is drawn is divided by what that makes of it, a few times over.
    """
    rings = annuli((side, side), prior.sectors)
    wanted = np.exp(prior.basis(rings.frequency, rings.direction) @ theta)
    frequency, sector, matrix, fall = grid(prior)
    spectrum = np.exp(matrix @ theta).reshape(frequency.shape) * fall
    assert rings.doubled == (SIDE, SIDE)
    for _ in range(ROUNDS):
        short = wanted / rings.leaked(spectrum)
        for number in range(prior.sectors):
            here, own = sector == number, rings.sector == number
            spectrum[here] *= np.interp(frequency[here], rings.frequency[own], short[own])
    spectrum[0, 0] = 0.0
    waves = fft.rfft2(rng.standard_normal((SIDE, SIDE))) * np.sqrt(spectrum)
    return 0.5 + fft.irfft2(waves, s=(SIDE, SIDE))


@cache
def grid(prior):
    """Of every bin its frequency and sector, what the coefficients multiply in the middle of that, and the fall."""
    frequency = fourier.frequency((SIDE, SIDE))
    sector = np.rint(fourier.direction((SIDE, SIDE)) * prior.sectors / np.pi).astype(int) % prior.sectors
    matrix = prior.basis(np.maximum(frequency, SLOWEST).ravel(), (sector * np.pi / prior.sectors).ravel())
    fall = np.minimum(np.maximum(frequency, 1 / SIDE) / SLOWEST, 1.0) ** FALL
    return frequency, sector, matrix, fall
