"""What Richardson-Lucy does the same whether the PSF is known or not: its ratio, and how its iterations look ahead."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.floating]

LEAST = 0.01
"""Share of its light inside the image below which a scene pixel is left as it is."""


@dataclass(frozen=True)
class Path:
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

    def moved(self, guess: Reals, now: Reals) -> "Path":
        return Path(now, self.now, (now - guess, *self.steps[:1]))


def rounding(image: Reals) -> float:
    """Below it a reblurred image of that type and height holds nothing but rounding."""
    return float(np.finfo(image.dtype).eps * image.max())


def ratio(image: Reals, reblurred: Reals, least: float, filter_epsilon: float = 0.0) -> Reals:
    """image / reblurred, which is no less than `rounding`, in the place of `reblurred`."""
    dark = reblurred < filter_epsilon if reblurred.min() < filter_epsilon else None
    np.maximum(reblurred, least, out=reblurred)
    np.divide(image, reblurred, out=reblurred)
    if dark is not None:
        reblurred[dark] = 0
    return reblurred
