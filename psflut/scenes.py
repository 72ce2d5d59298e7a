"""Captures of scenes whose distance varies from pixel to pixel: truth for maps of distance.

A scene is a sharp picture f and a distance for every pixel. Layers, evenly spread in vergence, share every pixel
between the two nearest to it, W_k its share of layer k, and each spreads its light by its own PSF h_k:

    g = sum_k V_k (h_k * W_k f) / sum_k V_k (h_k * W_k)        V_k = 1 - sum_j h_j * W_j over layers nearer by `GAP`

V_k is the share of the lens that looks past nearer objects. One plane is `psflut.capture.capture` exactly, and a
slanted or curved surface has everywhere the PSF of its own distance.

Occlusion is simple: the blurred rim of a near object covers what lies behind it by its own share of the lens, as in a
camera; but of the background that it hides a camera would see a little past its rim, from within. That is not known,
and the near object fills its place. Laying layers over each other from the farthest to the nearest, the usual way,
was tried first: on slanted surfaces each layer's rim hides the next one's, which halves the blur and reads as twice
the distance.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from psflut import capture, family
from psflut.capture import Setup, psf_of
from psflut.errors import PsflutError
from psflut.noise import Noise, parse_noise
from psflut.optics import Camera
from psflut.table import PSFTable

Floats = NDArray[np.float64]

LAYERS = 128
"""Of a scene: from 1 to 4 m through f/2, 16 mm, 6 um a step is 0.07 pixels of blur radius."""

GAP = 0.1
"""Vergence (1/m) by which a surface must be nearer to hide another, and not be its continuation."""


def simulate(
    scene: NDArray[np.floating], distance: NDArray[np.floating], source: Camera | PSFTable, setup: Setup, seed: int
) -> tuple[Floats, Noise | None]:
    """A capture of a scene with depth, and the noise it was given; the same seed gives the same bytes.

    Parameters
    ----------
    scene : (H, W) array
        Linear intensity, full scale 1.
    distance : (H, W) array
        Metres from the lens.
    source : Camera or PSFTable
        As `capture.psf_of` takes it: a table that a recipe made gives its model's PSFs, not its own.
    setup : Setup
        Without ``normalise``, which scales by a sharp image.

    Raises
    ------
    PsflutError
        If the arrays differ in shape, a distance is not positive and finite, or lies outside the table.
    """
    if setup.normalise:
        raise PsflutError("a scene with depth is captured as it is, got a set-up that normalises; turn that off")
    imager, sensor = family.parse("psflut.imagers", setup.imager), blurred(scene, distance, source)
    noise = None if setup.noise is None else parse_noise(setup.noise, imager.response(sensor))
    if noise is not None:
        noise = Noise(noise.read, setup.gain, noise.offset)
    rng = np.random.default_rng(seed)
    picture = capture.capture(sensor, np.ones((1, 1)), noise, rng, imager=imager, bits=setup.bits)
    return picture, noise.with_quantisation(setup.bits) if noise and setup.bits else noise


def blurred(
    scene: NDArray[np.floating], distance: NDArray[np.floating], source: Camera | PSFTable, layers: int = LAYERS
) -> Floats:
    """What reaches the detector of a scene with depth, (H, W), without noise; the module's docstring is the model."""
    if scene.shape != distance.shape or not (np.all(np.isfinite(distance)) and np.min(distance) > 0):
        raise PsflutError(
            f"a scene of {scene.shape} needs a positive, finite distance for every pixel, got {distance.shape} from "
            f"{np.min(distance):g} to {np.max(distance):g} m"
        )
    vergence = 1.0 / distance
    nodes = np.unique(np.linspace(vergence.max(), vergence.min(), layers))[::-1]
    step = np.ptp(nodes) / max(len(nodes) - 1, 1)
    psfs = [psf_of(source, float(1.0 / node)) for node in nodes]
    margin = max(len(psf) for psf in psfs) // 2
    picture, vergence = (np.pad(array, margin, mode="symmetric") for array in (scene, vergence))
    light, lens, hidden = (np.zeros_like(picture) for _ in range(3))
    near: deque[tuple[float, Floats]] = deque()
    for node, psf in zip(nodes, psfs, strict=True):
        share = np.maximum(1 - np.abs(vergence - node) / step, 0.0) if step else np.ones_like(picture)
        own, cover = (signal.oaconvolve(array, psf, mode="same") for array in (share * picture, share))
        while near and near[0][0] >= node + GAP:
            hidden += near.popleft()[1]
        light += np.maximum(1 - hidden, 0.0) * own
        lens += np.maximum(1 - hidden, 0.0) * cover
        near.append((node, cover))
    return np.asarray((light / lens)[margin : -margin or None, margin : -margin or None])


def motorcycle(near: float = 1.0, far: float = 4.0) -> tuple[Floats, Floats]:
    """scikit-image's motorcycle (Middlebury 2014): linear intensity (500, 741), and every pixel's distance, metres.

    Vergence is taken linear in disparity, as it is in a stereo rig, from `near` to `far`. Where disparity is not known
    the farther of the two neighbours in the row goes on, as what only one camera sees lies behind.
    """
    from skimage import data

    from psflut.images import LUMINANCE, linearise

    picture, _, disparity = data.stereo_motorcycle()
    known, columns = np.isfinite(disparity), np.arange(disparity.shape[1])
    left = np.maximum.accumulate(np.where(known, columns, 0), axis=1)
    right = np.minimum.accumulate(np.where(known, columns, columns[-1])[:, ::-1], axis=1)[:, ::-1]
    sides = [np.take_along_axis(disparity, side, axis=1) for side in (left, right)]
    filled = np.minimum(*(np.where(np.isfinite(side), side, np.inf) for side in sides)).astype(np.float64)
    share = (filled - filled.min()) / np.ptp(filled)
    return linearise(picture / 255.0, srgb=True) @ LUMINANCE, 1.0 / (1.0 / far + share * (1.0 / near - 1.0 / far))
