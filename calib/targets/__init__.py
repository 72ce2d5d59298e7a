"""Targets: what stands before the camera during a calibration, one a file. Frames in, a measured PSF out."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from psflut.imagers import Imager

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Shot:
    """A frame of the target at one position.

    Parameters
    ----------
    image : (H, W) array
        Linear intensity, full scale 1, less the dark level where that is known; saturated pixels are NaN.
    position : float
        Object distance or stage coordinate, metres.
    name : str
        For messages: the file, and its page.
    centre : (y, x) or None
        Pixel of the target's centre, where the manifest gives it.
    """

    image: Floats
    position: float
    name: str
    centre: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class Measurement:
    """What a target says of the PSF at one position.

    Parameters
    ----------
    psf, std : (K, K) arrays
        The PSF, sum 1, centred on K // 2, not clipped at zero, and its standard error.
    used : int
        Points, edges or pictures that went into it.
    rejected : tuple of str
        Why others did not.
    hidden : (K, K) array or None
        What of the standard error is no noise: what the target's own smoothness hides, which positions beside each
        other share. None: nothing of it.
    """

    psf: Floats
    std: Floats
    used: int
    rejected: tuple[str, ...] = ()
    hidden: Floats | None = None


class Target(ABC):
    """A target; its fields are its settings."""

    @property
    def files(self) -> tuple[Path, ...]:
        """What it reads beside the frames: a calibration's checksum covers them."""
        return ()

    @abstractmethod
    def measure(self, shots: Sequence[Shot], size: int, imager: Imager) -> Measurement:
        """The PSF, `size` pixels a side, from all shots at one position.

        The imager's own filter (L * h * f is what it shows) is taken out of the PSF.

        Raises
        ------
        PsflutError
            If no target is found, or every one is rejected; the sentence says why.
        """
