"""Patches of known distance from scikit-image's photographs, none of which the texture prior has seen."""

from dataclasses import dataclass

import numpy as np

from psflut import capture
from psflut.noise import Noise
from psflut.photographs import SHIPPED
from psflut.photographs import shipped as sharp


@dataclass(frozen=True, eq=False)
class Patch:
    """A square patch of a capture, and the truth."""

    photograph: str
    distance: float
    image: np.ndarray
    noise: Noise


def patches(table, distances, per_capture=1, side=128, noise="0.005", seed=0):
    """Patches at random places of captures of every photograph at every distance (metres)."""
    rng = np.random.default_rng(seed)
    out = []
    for name in SHIPPED:
        scene = sharp(name)
        for distance in distances:
            setup = capture.Setup(noise=noise)
            image, drawn = capture.simulate(scene, table, distance, setup, int(rng.integers(2**31)))
            for _ in range(per_capture):
                y, x = (int(rng.integers(0, n - side + 1)) for n in image.shape)
                out.append(Patch(name, distance, image[y : y + side, x : x + side], drawn))
    return out
