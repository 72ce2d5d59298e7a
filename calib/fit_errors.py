"""How much a model's misfit of measured PSFs weighs: pixels that err as one count as one."""

import numpy as np
from numpy.typing import NDArray

from calib.radial import rings

Floats = NDArray[np.float64]

MODEL_ERROR = 0.01
"""Of a PSF's peak, that is let pass as the model's own: no plane may rule the fit by its small noise."""


def fit_errors(psf: Floats, std: Floats) -> Floats:
    """What a fit counts as one standard error of PSFs (N, K, K), pixel by pixel.

    What errors of pixels at one distance from the centre share (a wrong edge, say) makes these pixels count as one
    number and not as many. The share is what is missing of the stated errors in the difference between a PSF and its
    mirror images; it is one number for all planes, the median over their rings.
    """
    ring, folds = rings(psf.shape[1]).ravel(), (psf, psf[:, ::-1], psf[:, :, ::-1], psf[:, ::-1, ::-1])
    uneven = psf - sum(each + each.transpose(0, 2, 1) for each in folds) / 8.0
    stated, own = (np.stack([np.bincount(ring, plane.ravel()) for plane in each**2]) for each in (std, uneven))
    pixels = np.bincount(ring)
    known = (stated > 0) & (pixels > 1)
    shared = np.clip(1.0 - np.median(own[known] / stated[known]) * 8.0 / 7.0, 0.0, 1.0) if known.any() else 0.0
    counted = (stated * (shared + (1.0 - shared) / pixels))[:, ring].reshape(psf.shape)
    return np.asarray(np.sqrt(counted + (MODEL_ERROR * psf.max(axis=(1, 2), keepdims=True)) ** 2))
