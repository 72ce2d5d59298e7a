"""The thesis' neuromorphic imager: an edge detector of three by three pixels."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from psflut.errors import PsflutError
from psflut.imagers import Imager


@dataclass(frozen=True)
class Laplacian(Imager):
    """Lateral inhibition as a Laplacian (3.3.4): every pixel less the weighted mean of its neighbours.

    The kernel is 4 / (alpha + 1) times

        -alpha/4      -(1-alpha)/4   -alpha/4
        -(1-alpha)/4   1             -(1-alpha)/4
        -alpha/4      -(1-alpha)/4   -alpha/4

    It sums to 0, and its transfer tends to (2 pi)^2 (u^2 + v^2) for low frequencies u, v in cycles a pixel,
    whatever alpha. The printed equation is lost; this is MATLAB's ``fspecial("laplacian", alpha)`` with its
    sign turned, as the text asks for a positive centre. The thesis' results use alpha = 0.2, a figure 0.5.

    Parameters
    ----------
    alpha : float
        Share of the diagonal neighbours, between 0 and 1, both excluded.

    Raises
    ------
    PsflutError
        For alpha outside (0, 1).
    """

    alpha: float = 0.2

    def __post_init__(self) -> None:
        if not 0 < self.alpha < 1:
            raise PsflutError(f"alpha must lie between 0 and 1, got {self.alpha}; the thesis uses 0.2")

    def kernel(self) -> NDArray[np.float64]:
        """(3, 3) coefficients, centre positive, sum 0."""
        corner, edge = -self.alpha / 4, -(1 - self.alpha) / 4
        weights = np.array([[corner, edge, corner], [edge, 1.0, edge], [corner, edge, corner]])
        return 4 / (self.alpha + 1) * weights
