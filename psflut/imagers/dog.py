"""The receptive field of a ganglion cell: a difference of two Gaussians."""

from dataclasses import dataclass
from math import ceil, isfinite

import numpy as np
from numpy.typing import NDArray

from psflut.errors import PsflutError
from psflut.imagers import Imager

REACH = 4.0  # surround sigmas kept on each side; beyond them lies 6e-5 of a Gaussian


@dataclass(frozen=True)
class Dog(Imager):
    """On-centre ganglion cell, the "Mexican hat": an excitatory Gaussian less an inhibitory, wider one.

    The kernel is G(centre) - G(surround), each sampled at the pixels, cut off at 4 surround sigmas and given
    sum 1 there, so that the difference sums to 0 and a flat picture gives no response. The model is
    Rodieck's (1965), centre and surround in balance. The default ratio of the sigmas, 1.6, is that of Marr
    and Hildreth (1980): close to the Laplacian of a Gaussian, their compromise between a narrow band and
    sensitivity. The default centre, 1 pixel, is about the smallest Gaussian that pixels sample without
    aliasing (its transfer at the Nyquist frequency is 0.007).

    Parameters
    ----------
    centre, surround : float
        Standard deviations in pixels, 0 < centre < surround.

    Raises
    ------
    PsflutError
        For widths that are not positive, finite and in that order.

    References
    ----------
    R. W. Rodieck, Vision Research 5, 583 (1965).
    D. Marr and E. Hildreth, Proc. R. Soc. Lond. B 207, 187 (1980).
    """

    centre: float = 1.0
    surround: float = 1.6

    def __post_init__(self) -> None:
        if not (0 < self.centre < self.surround and isfinite(self.surround)):
            raise PsflutError(
                f"the widths must satisfy 0 < centre < surround (pixels), got {self.centre} and "
                f"{self.surround}; 1 and 1.6 are usual"
            )

    def kernel(self) -> NDArray[np.float64]:
        """(k, k) coefficients, centre positive, sum 0; k = 2 ceil(4 surround) + 1."""
        reach = ceil(REACH * self.surround)
        difference = _gaussian(self.centre, reach) - _gaussian(self.surround, reach)
        difference[reach, reach] -= difference.sum()  # what rounding left
        return difference


def _gaussian(sigma: float, reach: int) -> NDArray[np.float64]:
    """Gaussian of that sigma (pixels) sampled out to `reach` pixels, sum 1."""
    profile = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    profile /= profile.sum()
    return np.outer(profile, profile)
