"""An ordinary detector."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from psflut.imagers import Imager


@dataclass(frozen=True)
class Plain(Imager):
    """Each pixel reports the light that falls on it: L = 1."""

    def kernel(self) -> NDArray[np.float64]:
        """One coefficient, 1."""
        return np.ones((1, 1))
