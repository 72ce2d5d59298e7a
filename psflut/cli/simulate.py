"""`psflut simulate`: a capture of a scene at a distance, or with a distance for every pixel."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from psflut.cli import console
from psflut.cli.options import TABLE_HELP, Gamma, ImagerOption, NoiseOption, Overwrite, Srgb
from psflut.errors import PsflutError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from psflut.optics import Camera
    from psflut.table import PSFTable


def run(
    image: Annotated[Path, typer.Argument(metavar="IMAGE", help="A sharp picture: the scene.")],
    distance: Annotated[
        str,
        typer.Option(
            help="Object distance with a unit: '1.83 m'; or a .tif or .npy of every pixel's, metres as floats."
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="The capture: a float32 TIFF.")],
    camera: Annotated[Path | None, typer.Option(help="A camera file: TOML with [camera].")] = None,
    table: Annotated[str | None, typer.Option(help=TABLE_HELP)] = None,
    noise: NoiseOption = None,
    gain: Annotated[float | None, typer.Option(help="Photo-electrons at full scale: adds shot noise.")] = None,
    imager: ImagerOption = None,
    normalise: Annotated[
        bool | None,
        typer.Option(help="Scale by the ideal image's minimum and maximum. Default: as the table."),
    ] = None,
    bits: Annotated[int | None, typer.Option(help="Quantise to 2^BITS levels, 1 to 32.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the noise: the same seed gives the same bytes.")] = 0,
    ideal: Annotated[Path | None, typer.Option(help="Also write the ideal image: no blur, no noise.")] = None,
    gamma: Gamma = 1.0,
    srgb: Srgb = False,
    overwrite: Overwrite = False,
) -> None:
    """Simulate a capture of a scene at a distance, or with depth, through a camera or the set-up of a table."""
    from dataclasses import asdict, replace

    from psflut import capture, scenes
    from psflut.files import refuse_inputs
    from psflut.images import read_image
    from psflut.table import PSFTable
    from psflut.units import format_length
    from psflut.writing import check_tiff, write_tiff

    metres = _metres(distance)
    if output == ideal:
        raise PsflutError(f"{output} cannot hold both the capture and the ideal image; name two files")
    for path in (output, ideal):
        if path is not None:
            check_tiff(path, overwrite)
            refuse_inputs(path, [image, Path(distance)])
    source = _source(camera, table)
    setup = capture.setup_of(source)
    asked: dict[str, Any] = {"imager": imager, "normalise": normalise, "noise": noise, "bits": bits, "gain": gain}
    setup = replace(setup, **{key: value for key, value in asked.items() if value is not None})
    scene = read_image(image, gamma, srgb).image
    if isinstance(metres, float):
        picture, drawn = capture.simulate(scene, source, metres, setup, seed)
        where: dict[str, Any] = {"distance_m": metres}
        at = f"at {format_length(metres)}"
    else:
        picture, drawn = scenes.simulate(scene, metres, source, setup, seed)
        where = {"distances": Path(distance).name}
        at = f"from {format_length(metres.min())} to {format_length(metres.max())}"
    sigma = None if drawn is None else drawn.read
    about = {"scene": image.name, "setup": asdict(setup)}
    write_tiff(output, picture, about | where | {"read_sigma": sigma, "seed": seed}, overwrite)
    if ideal is not None:
        write_tiff(ideal, capture.ideal_image(scene, setup), about, overwrite)
    if isinstance(source, PSFTable):
        console.say_what_wins(source, noise, imager)
    words = "without noise" if sigma is None else f"read noise {sigma:.4g}"
    console.say(f"{output}: {picture.shape[0]} x {picture.shape[1]} pixels {at}, {words}")


def _metres(text: str) -> "float | NDArray[np.float64]":
    """A distance, or the map (H, W) in the file of that name."""
    from psflut.frames import frames
    from psflut.units import parse_length

    if Path(text).suffix.lower() not in (".tif", ".tiff", ".npy"):
        return parse_length(text)
    planes = frames([text])
    if len(planes.names) > 1:
        raise PsflutError(f"{text} holds {len(planes.names)} pages; give the distances of one scene")
    picture = planes.lines(0, 0, planes.shape[0])
    if picture.saturated is not None:
        raise PsflutError(f"{text} holds whole numbers; write the distances in metres, as floats")
    return picture.image


def _source(camera: Path | None, table: str | None) -> "Camera | PSFTable":
    from psflut.camera_file import read_camera
    from psflut.store import read_table

    if (camera is None) == (table is None):
        raise PsflutError("a capture needs either --camera or --table; give one of them")
    return read_camera(camera) if camera is not None else read_table(str(table))
