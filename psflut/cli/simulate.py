"""`psflut simulate`: a capture of a scene at a distance."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from psflut.cli import console
from psflut.cli.options import TABLE_HELP, Gamma, ImagerOption, NoiseOption, Overwrite, Srgb
from psflut.errors import PsflutError

if TYPE_CHECKING:
    from psflut.optics import Camera
    from psflut.table import PSFTable


def run(
    image: Annotated[Path, typer.Argument(metavar="IMAGE", help="A sharp picture: the scene.")],
    distance: Annotated[str, typer.Option(help="Object distance with a unit: '1.83 m'.")],
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
    """Simulate a capture of a scene at a distance, through a camera or the set-up of a table."""
    from dataclasses import asdict, replace

    from psflut import capture
    from psflut.files import refuse_inputs
    from psflut.images import read_image
    from psflut.table import PSFTable
    from psflut.units import parse_length
    from psflut.writing import check_tiff, write_tiff

    metres = parse_length(distance)
    if output == ideal:
        raise PsflutError(f"{output} cannot hold both the capture and the ideal image; name two files")
    for path in (output, ideal):
        if path is not None:
            check_tiff(path, overwrite)
            refuse_inputs(path, [image])
    source = _source(camera, table)
    setup = capture.setup_of(source)
    asked: dict[str, Any] = {"imager": imager, "normalise": normalise, "noise": noise, "bits": bits, "gain": gain}
    setup = replace(setup, **{key: value for key, value in asked.items() if value is not None})
    scene = read_image(image, gamma, srgb).image
    picture, drawn = capture.simulate(scene, source, metres, setup, seed)
    sigma = None if drawn is None else drawn.read
    about = {"scene": image.name, "setup": asdict(setup)}
    write_tiff(output, picture, about | {"distance_m": metres, "read_sigma": sigma, "seed": seed}, overwrite)
    if ideal is not None:
        write_tiff(ideal, capture.ideal_image(scene, setup), about, overwrite)
    if isinstance(source, PSFTable):
        console.say_what_wins(source, noise, imager)
    words = "without noise" if sigma is None else f"read noise {sigma:.4g}"
    console.say(f"{output}: {picture.shape[0]} x {picture.shape[1]} pixels at {metres:g} m, {words}")


def _source(camera: Path | None, table: str | None) -> "Camera | PSFTable":
    from psflut.camera_file import read_camera
    from psflut.store import read_table

    if (camera is None) == (table is None):
        raise PsflutError("a capture needs either --camera or --table; give one of them")
    return read_camera(camera) if camera is not None else read_table(str(table))
