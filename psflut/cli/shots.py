"""The captures that `psflut compare` asks for: simulated, or real frames of a manifest."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from psflut.cli import console
from psflut.errors import PsflutError

if TYPE_CHECKING:
    from calib.manifest_row import Row
    from psflut.shots import Measured, Shot, Simulated
    from psflut.table import PSFTable

NOISE = "0.005"
"""Of simulated captures where neither option nor table says: read sigma, full scale 1."""

MOST = 1_000_000
"""Captures: weeks of work, and what is kept of them in memory."""


class Encoding(NamedTuple):
    """How image files encode intensity, as `images.read_image` takes it."""

    gamma: float
    srgb: bool


def simulated(
    table: "PSFTable",
    images: str | None,
    distances: int,
    runs: int,
    size: int,
    noise: str | None,
    imager: str | None,
    seed: int,
    encoding: Encoding,
) -> "Simulated":
    """Captures of photographs by the set-up behind the table, what options name in its place."""
    import numpy as np

    from psflut import capture
    from psflut.noise import parse_noise
    from psflut.photographs import choose
    from psflut.shots import Simulated, between

    if distances * runs > MOST:
        raise PsflutError(f"a comparison has at most {MOST:,} captures, got {distances:,} x {runs:,}; take fewer")
    setup = capture.setup_of(table)
    setup = replace(setup, noise=noise or setup.noise or NOISE, imager=imager or setup.imager)
    if table.provenance.get("model") is None:
        console.say("the table was measured, no model made it: captures come from its own PSFs, which flatters methods")
    parse_noise(setup.noise or NOISE, np.arange(2.0))  # refuses now what every capture would refuse
    photographs = choose(images, size, *encoding)
    return Simulated(table, setup, photographs, between(table, distances), runs, size, seed)


def measured(
    table: "PSFTable",
    captures: Path,
    camera: Path | None,
    size: int,
    noise: str | None,
    imager: str | None,
    encoding: Encoding,
) -> "Measured":
    """A patch of every frame of a manifest: round its target's centre where that is given, else of the middle.

    Raises
    ------
    PsflutError
        If the frames do not fit the table: another axis, positions outside it, another pixel pitch, too few pixels.
    """
    from calib.manifest import read_manifest
    from psflut.camera_file import read_camera
    from psflut.shots import Measured
    from psflut.units import format_length

    manifest = read_manifest(captures)
    if manifest.kind != table.kind:
        raise PsflutError(f"{captures} gives a {manifest.kind}, the table's axis is a {table.kind}; give that")
    pitch = table.pixel_pitch if camera is None else read_camera(camera).pixel_pitch
    if abs(pitch / table.pixel_pitch - 1.0) > 1e-6:
        raise PsflutError(
            f"the frames have pixels of {format_length(pitch)}, the table of {format_length(table.pixel_pitch)}; "
            "give the table of their camera"
        )
    if not table.size <= size <= min(manifest.shape):
        raise PsflutError(
            f"patches of {size} pixels must fit the frames of {manifest.shape[0]} x {manifest.shape[1]} pixels and "
            f"hold the table's PSF of {table.size}; give another --size"
        )
    table.at(manifest.positions)  # refuses those that are outside the table
    shots = {position: tuple(r for r in manifest.rows if r.position == position) for position in manifest.positions}
    every = (tuple(_shot(row, size, noise, imager, encoding) for row in rows) for rows in shots.values())
    return Measured(manifest.positions, tuple(every))


def _shot(row: "Row", size: int, noise: str | None, imager: str | None, encoding: Encoding) -> "Shot":
    from psflut.estimation import Observation
    from psflut.images import read_image
    from psflut.noise import parse_noise
    from psflut.shots import Shot

    picture = read_image(row.file, *encoding, row.page)
    middle = row.centre or tuple(0.5 * (n - 1) for n in picture.image.shape)
    y, x = (
        min(max(round(at - 0.5 * (size - 1)), 0), n - size) for at, n in zip(middle, picture.image.shape, strict=True)
    )
    patch = picture.image[y : y + size, x : x + size]
    known = None if noise is None else parse_noise(noise, patch)
    return Shot(Observation(patch, known, imager, quantum=picture.quantum), row.position, row.name, (y, x))
