"""From a folder of frames at known positions to a table: what `psflut calibrate` does."""

import hashlib
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.assess import Assessment
from calib.build import table_of
from calib.captures import shots
from calib.manifest import Manifest
from calib.modes import with_modes
from calib.photons import noise_of, pair_bins
from calib.planes import Planes
from calib.singles import Singles
from calib.targets import Measurement, Shot, Target
from psflut import family
from psflut.errors import PsflutError
from psflut.imagers import Imager
from psflut.noise import Noise
from psflut.optics import Camera
from psflut.table import PSFTable
from psflut.units import format_length

Floats = NDArray[np.float64]

LARGEST_SIZE = 1001
"""Of a PSF that is measured, pixels."""


@dataclass(frozen=True)
class Encoding:
    """How frames hold light: what is undone when they are read.

    Parameters
    ----------
    gamma, srgb : float, bool
        See `psflut.images.linearise`.
    dark : float or (H, W) array
        Dark level, image units.
    """

    gamma: float = 1.0
    srgb: bool = False
    dark: float | Floats = 0.0

    def shots(self, manifest: Manifest, position: float) -> list[Shot]:
        """The frames at one position (metres), decoded."""
        return shots(manifest, position, self.gamma, self.srgb, self.dark)


def calibrate(
    manifest: Manifest,
    target: Target,
    size: int,
    pixel_pitch: float,
    *,
    imager: Imager,
    camera: Camera | None = None,
    encoding: Encoding | None = None,
    assessment: Assessment | None = None,
    modes: int | None = None,
    progress: Callable[[int], object] = lambda positions: None,
    kept: Planes | None = None,
) -> PSFTable:
    """Measure the PSF at every position of a manifest and lay a smooth course through them.

    The table keeps the standard errors of its PSFs, the noise of the camera where positions were taken more than
    once (`calib.photons`), and what was used and rejected; its date is that of the calibration.

    Parameters
    ----------
    size : int
        Side of a PSF, pixels, odd.
    pixel_pitch : float
        Metres on the detector.
    imager : Imager
        What the camera's own output went through.
    assessment : Assessment
        What is looked into besides (`calib.assess`). It knows nothing of modes, which add their errors (`calib.modes`).
    modes : int or None
        Of how points differ (`calib.modes`), points being named by the manifest's rows.
    progress : callable
        Hears of every position measured.
    kept : Planes or None
        Of a build that was stopped; points by themselves (modes) are measured again.

    Raises
    ------
    PsflutError
        If a frame cannot be read, or a position shows no target; the sentence names it. If modes are asked for that
        the points cannot tell.
    """
    encoding = encoding or Encoding()
    if not 3 <= size <= LARGEST_SIZE or size % 2 == 0:
        raise PsflutError(f"the size of a PSF must be odd, from 3 to {LARGEST_SIZE} pixels, got {size}")
    if camera and manifest.kind == "distance" and min(manifest.positions) <= camera.focal_length:
        raise PsflutError(
            f"{manifest.path} has distances from {format_length(min(manifest.positions))}, within the focal length of "
            f"{format_length(camera.focal_length)}; check the unit of its column"
        )
    singles = None if modes is None else Singles.named(manifest, target, modes)
    alone: list[list[Measurement | None]] = []

    def look(shots: list[Shot]) -> None:
        if singles is not None:
            alone.append(singles.measure(shots, size, imager))
        progress(1)

    axis, measured, repeats = measure_all(manifest, target, size, imager, encoding, look, kept)
    points, left_out = singles.tables(axis, manifest.kind, alone, pixel_pitch) if singles else ([], [])
    noise, why_not = _noise(repeats, float(np.mean(encoding.dark)))
    table = replace(
        table_of(axis, manifest.kind, measured, pixel_pitch),
        camera=camera,
        imager=family.describe(imager),
        noise=noise,
        provenance={
            **_provenance(manifest, target, encoding, measured, left_out),
            "modes_from": len(points),
            "noise_unknown": why_not,
        },
    )
    table = (assessment or Assessment()).of(table, measured)
    return with_modes(table, points, singles.modes) if singles else table


def measure_all(
    manifest: Manifest,
    target: Target,
    size: int,
    imager: Imager,
    encoding: Encoding,
    look: Callable[[list[Shot]], object] = lambda shots: None,
    kept: Planes | None = None,
) -> tuple[Floats, list[Measurement], list[Floats]]:
    """Positions (N,), metres, the PSF at each, and what repeated frames say of noise; every frame is read once.

    `look` sees the shots of every position once that is measured.
    """
    measured: list[Measurement] = []
    repeats: list[Floats] = []
    for position in manifest.positions:
        frames = encoding.shots(manifest, position)
        measured.append((kept or Planes()).measure(target, frames, size, imager))
        repeats += pair_bins(list({id(shot.image): shot.image for shot in frames}.values()))  # a frame once
        look(frames)
    return np.array(manifest.positions), measured, repeats


def _noise(repeats: list[Floats], dark: float) -> tuple[Noise | None, str]:
    """The noise that repeated frames show, or None and why it stays unknown."""
    try:
        noise = noise_of(repeats, offset=0.0 if dark else None)
    except PsflutError as error:  # compressed frames, say; estimates then look for the noise themselves
        return None, str(error)
    if noise is None:
        return None, "no position was taken twice"
    return replace(noise, offset=noise.offset + dark), ""


def _provenance(
    manifest: Manifest, target: Target, encoding: Encoding, measured: list[Measurement], left_out: list[str]
) -> dict[str, Any]:
    digest = hashlib.sha256(manifest.path.read_bytes())
    for file in [*sorted({row.file for row in manifest.rows}), *target.files]:
        digest.update(file.read_bytes())
    return {
        "target": family.describe(target),
        "gamma": encoding.gamma,
        "srgb": encoding.srgb,
        "frames": len({row.frame for row in manifest.rows}),
        "captures_sha256": digest.hexdigest(),
        "used": [each.used for each in measured],
        "rejected": [reason for each in measured for reason in each.rejected] + left_out,
        "date": int(os.environ.get("SOURCE_DATE_EPOCH", time.time())),
    }
