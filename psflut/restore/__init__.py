"""Restoration with a known or an unknown PSF: array in, array out.

Border rule: convolution is circular on a grid larger than the image, and the result is cropped. Beyond its
border `wiener` takes the image to go on mirrored, the two sides fading into each other (`continued`).
Richardson-Lucy takes that only for a start: there the scene reaches half a PSF beyond the border and is
judged by the pixels inside alone (Bertero and Boccacci 2005; MATLAB's WEIGHT). Against truth
both err less along the border than plain mirroring or a circular image, which ring, or zeros, which darken.

Arithmetic is float32 for a float32 image, else float64. Nothing is clipped but Richardson-Lucy's
estimates, at zero. Frequencies are those of ``scipy.fft.rfft2``.
"""

from psflut.restore.blind import blind_richardson_lucy
from psflut.restore.intake import nonnegative
from psflut.restore.inversion import wiener, wiener_filter
from psflut.restore.lucy import richardson_lucy

__all__ = ["blind_richardson_lucy", "nonnegative", "richardson_lucy", "wiener", "wiener_filter"]
