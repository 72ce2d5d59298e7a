"""The one forward model (thesis 4.1.1): a scene at a distance becomes a noisy capture.

    g = L * (h(z) * f + shot) + read

L is the imager, h the PSF, f the scene. With ``normalise`` the thesis' set-up is followed: its f_Laplacian = L * f
is scaled by its own minimum and maximum to [0, 1]; as h sums to 1, scaling before the blur or after it is the same.

The border rule: the scene is continued by mirroring (the border pixel repeats: d c b a | a b c d), once and far
enough for h and L together, and everything is cropped to the scene's own shape at the end. Nothing is clipped.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from psflut import family
from psflut.errors import PsflutError
from psflut.imagers import Imager
from psflut.noise import Noise, parse_noise
from psflut.optics import Camera, blur_radius
from psflut.table import PSFTable

Floats = NDArray[np.floating]

LARGEST_RADIUS = 250.0
"""Of a blur that is still simulated, pixels."""

LARGEST_GAIN = 1e15
"""Photo-electrons at full scale, far beyond any sensor, that the generator of photons still counts."""


@dataclass(frozen=True)
class Setup:
    """What a set-up fixes of its captures: the ``[capture]`` of a recipe.

    Parameters
    ----------
    imager : str
        Name and settings, as `family.parse` reads them.
    normalise : bool
        Scale by the minimum and maximum of the ideal image to [0, 1] (thesis, chapter 5).
    noise : str or None
        As `noise.parse_noise` reads it.
    bits : int or None
        Quantisation to 2^bits levels between 0 and 1; None leaves it out.
    gain : float or None
        Photo-electrons at full scale; adds photon noise to a `noise`.
    filter_size : int or None
        Side in pixels of the set-up's own blurring filter, from which blind deconvolution starts flat; None is
        the table's size.
    """

    imager: str = "plain"
    normalise: bool = False
    noise: str | None = None
    bits: int | None = None
    gain: float | None = None
    filter_size: int | None = None

    def __post_init__(self) -> None:
        family.parse("psflut.imagers", self.imager)
        if self.bits is not None and not 1 <= self.bits <= 32:
            raise PsflutError(f"bits must be between 1 and 32, got {self.bits}; 8, 12 and 16 are usual")
        if self.gain is not None and not 0 < self.gain <= LARGEST_GAIN:
            raise PsflutError(f"gain must be positive and at most {LARGEST_GAIN:g}, got {self.gain}; count electrons")
        if self.filter_size is not None and self.filter_size < 1:
            raise PsflutError(f"filter_size must be at least 1 pixel, got {self.filter_size}; leave it out")
        if self.noise is not None:
            parse_noise(self.noise, np.arange(2.0))
        if self.gain is not None and self.noise is None:
            raise PsflutError("photon noise comes with read noise; give a noise beside the gain")


def ideal_image(scene: Floats, setup: Setup) -> Floats:
    """What the imager records without blur and noise: the thesis' f_Laplacian. Same shape as the scene."""
    imager = family.parse("psflut.imagers", setup.imager)
    low, high = _range(scene, imager) if setup.normalise else (0.0, 1.0)
    return np.asarray((imager.response(scene) - low) / (high - low))


def capture(
    scene: Floats,
    psf: Floats,
    noise: Noise | None,
    rng: np.random.Generator,
    *,
    imager: Imager,
    normalise: bool = False,
    bits: int | None = None,
) -> NDArray[np.float64]:
    """A capture of `scene` through `psf`; the module's docstring is the model.

    Parameters
    ----------
    scene : (H, W) array
        Linear intensity, full scale 1.
    psf : (K, K) array
        K odd, at most as large as the scene.
    noise : Noise or None
        Photon noise (Poisson of the blurred scene) is drawn before the imager and filtered by it; read noise
        after imager and normalisation, so that its sigma is in units of the image returned.
    bits : int or None
        Rounds to 2^bits levels, saturating at 0 and 1 as a converter does; refused for signed output.

    Returns
    -------
    (H, W) array
    """
    if min(scene.shape) < max(psf.shape):
        raise PsflutError(f"a scene of {scene.shape} is smaller than its PSF of {psf.shape}; give a larger one")
    low, high = _range(scene, imager) if normalise else (0.0, 1.0)
    kernel = imager.kernel()
    margin = psf.shape[0] // 2 + kernel.shape[0] // 2
    sensor = signal.oaconvolve(np.pad(scene, margin, mode="symmetric"), psf, mode="valid")
    if noise is not None and noise.gain is not None:
        sensor = rng.poisson(np.maximum(sensor, 0.0) * noise.gain) / noise.gain
    image = signal.oaconvolve(sensor, kernel, mode="valid") if kernel.size > 1 else sensor * kernel
    image = (image - low) / (high - low)
    if noise is not None:
        image = image + noise.offset + noise.read * rng.standard_normal(image.shape)
    return np.asarray(image if bits is None else _quantise(image, bits, imager.signed and not normalise))


def simulate(
    scene: Floats, source: Camera | PSFTable, distance: float, setup: Setup, seed: int
) -> tuple[NDArray[np.float64], Noise | None]:
    """A capture at `distance` (metres) with a camera or the set-up behind a table, and the noise it was given.

    Quantisation counts as read noise. The same seed gives the same bytes.
    """
    imager = family.parse("psflut.imagers", setup.imager)
    psf = psf_of(source, distance)

    def take(noise: Noise | None, bits: int | None) -> NDArray[np.float64]:
        rng = np.random.default_rng(seed)
        return capture(scene, psf, noise, rng, imager=imager, normalise=setup.normalise, bits=bits)

    noise = None
    if setup.noise is not None:
        noise = replace(parse_noise(setup.noise, take(None, None)), gain=setup.gain)
    picture = take(noise, setup.bits)
    return picture, noise.with_quantisation(setup.bits) if noise and setup.bits else noise


def psf_of(source: Camera | PSFTable, distance: float) -> Floats:
    """The PSF of an object at `distance` (metres) as a capture needs it.

    A table built from a recipe gives that recipe's model at the very distance, so that a capture never comes
    from the table that will judge it; a measured table gives its own planes, interpolated. A bare camera
    gives the pupil model without aberration, in a window large enough for its blur.
    """
    if isinstance(source, Camera):
        if not (np.isfinite(distance) and distance > 0):
            raise PsflutError(f"a distance must be positive, got {distance} m; it is counted from the lens")
        radius = abs(float(blur_radius(source, distance))) / source.pixel_pitch
        if radius > LARGEST_RADIUS:
            raise PsflutError(f"the blur at {distance} m has a radius of {radius:.0f} pixels; go nearer to the focus")
        size = 2 * int(np.ceil(1.5 * radius)) + 15
        return np.asarray(family.make("psflut.psfs", "pupil", {})(source, distance, size))
    planes = source.at(distance)  # refuses a distance outside the table
    model = source.provenance.get("model")
    if model is None or source.camera is None:
        return planes
    part = family.make("psflut.psfs", model, source.provenance["settings"])
    return np.asarray(part(source.camera, distance, source.size))


def setup_of(source: Camera | PSFTable) -> Setup:
    """The ``[capture]`` of the recipe that a table came from; else plain, with the table's imager and noise."""
    if isinstance(source, Camera):
        return Setup()
    fixed = source.provenance.get("capture")
    if fixed is not None:
        return Setup(**fixed)
    noise = source.noise
    return Setup(source.imager, noise=str(noise.read) if noise else None, gain=noise.gain if noise else None)


def _range(scene: Floats, imager: Imager) -> tuple[float, float]:
    sharp = imager.response(scene)
    low, high = float(sharp.min()), float(sharp.max())
    if not high > low:
        raise PsflutError("a scene without any contrast cannot be normalised; give one with texture")
    return low, high


def _quantise(image: Floats, bits: int, signed: bool) -> Floats:
    if signed:
        raise PsflutError("quantisation needs values between 0 and 1, but this imager is signed; normalise it")
    levels = 2**bits - 1
    return np.asarray(np.round(np.clip(image, 0.0, 1.0) * levels) / levels)
