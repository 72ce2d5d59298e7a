"""`psflut calibrate`: a table from real captures."""

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from psflut import family
from psflut.cli import console
from psflut.cli.options import Gamma, Overwrite, Srgb, TableOutput
from psflut.errors import PsflutError

if TYPE_CHECKING:
    from calib.targets import Target


def run(
    captures: Annotated[Path, typer.Argument(metavar="CAPTURES.csv", help="The manifest beside the frames.")],
    target: Annotated[str, typer.Option(help="point, edge or pattern; settings behind colons: point:pinhole=2.")],
    output: TableOutput,
    camera: Annotated[Path | None, typer.Option(help="A camera file, which names the pixel pitch.")] = None,
    pixel_pitch: Annotated[str | None, typer.Option(help="With a unit, where there is no camera file: '6 um'.")] = None,
    size: Annotated[int, typer.Option(help="Side of a PSF in pixels, odd.")] = 31,
    imager: Annotated[str, typer.Option(help="What the frames went through: plain, laplacian:0.2, dog.")] = "plain",
    dark: Annotated[str, typer.Option(help="Dark level in image units, or an image taken without light.")] = "0",
    gamma: Gamma = 1.0,
    srgb: Srgb = False,
    reference: Annotated[
        Path | None,
        typer.Option(help="Of a pattern: a sharp frame, encoded as the others are, or noise:A4:0."),
    ] = None,
    figure: Annotated[Path | None, typer.Option(help="Also draw a contact sheet of the PSFs: FILE.png.")] = None,
    placement: Annotated[
        str | None, typer.Option(help="Standard error of a position: '0.1 mm'. Default: from held-out errors.")
    ] = None,
    model: Annotated[
        str | None, typer.Option(help="pupil: also fit wave optics, and say which explains the frames better.")
    ] = None,
    planes: Annotated[
        int | None,
        typer.Option(help="With --model: so many planes, filled by it, or it and the frames, where that is best."),
    ] = None,
    modes: Annotated[
        int | None, typer.Option(help="Also keep so many modes of how points differ; rows name them by x and y.")
    ] = None,
    check_figure: Annotated[Path | None, typer.Option(help="Also draw good and blind ranges: FILE.png.")] = None,
    overwrite: Overwrite = False,
) -> None:
    """Measure a table from real captures at known positions."""
    from tqdm import tqdm

    from calib.assess import Assessment
    from calib.calibrate import Encoding
    from calib.calibrate import calibrate as measure
    from calib.captures import read_dark
    from calib.manifest import read_manifest
    from calib.planes import beside
    from psflut.camera_file import read_camera
    from psflut.store import check_target, write_table
    from psflut.summary import summarise, words
    from psflut.units import parse_length, parse_pitch

    lens = None if camera is None else read_camera(camera)
    if (lens is None) == (pixel_pitch is None):
        raise PsflutError("a table needs its pixel pitch: give either --camera or --pixel-pitch")
    pitch = lens.pixel_pitch if lens else parse_pitch(pixel_pitch)
    part, filtering = family.parse("calib.targets", target), family.parse("psflut.imagers", imager)
    part = _with_reference(part, reference, gamma, srgb)
    if model not in (None, "pupil"):
        raise PsflutError(f"the model that can be fitted is pupil, got {model!r}; give that")
    assessment = Assessment(None if placement is None else parse_length(placement), model is not None, planes)
    check_target(output, overwrite)
    if figure is not None and figure == check_figure:
        raise PsflutError(f"{figure} cannot hold both figures; name two files")
    for drawing in (figure, check_figure):
        if drawing is not None:
            from psflut import plots

            plots.check_figure(drawing, overwrite)
    manifest = read_manifest(captures, least_positions=3)
    encoding = Encoding(gamma, srgb, read_dark(dark, gamma, srgb))
    with beside(output) as kept:
        with tqdm(total=len(manifest.positions), unit="position", disable=None) as bar:
            table = measure(
                manifest,
                part,
                size,
                pitch,
                imager=filtering,
                camera=lens,
                encoding=encoding,
                assessment=assessment,
                modes=modes,
                progress=bar.update,
                kept=kept,
            )
        write_table(table, output, overwrite)
    if figure is not None:
        from psflut.plots import psfs, save

        save(psfs(table), figure, overwrite)
    if check_figure is not None:
        from psflut.plots import ranges, save

        save(ranges(table), check_figure, overwrite)
    console.print_rows(words(summarise(table)))


def _with_reference(target: "Target", reference: Path | None, gamma: float, srgb: bool) -> "Target":
    """The target that compares frames with a reference, or as it is where it needs none."""
    from calib.targets.pattern import Pattern

    if not isinstance(target, Pattern):
        if reference is not None:
            raise PsflutError(f"{family.describe(target)} takes no --reference; that belongs to --target pattern")
        return target
    if reference is not None:
        target = dataclasses.replace(target, reference=str(reference), gamma=gamma, srgb=srgb)
    target.picture()
    return target
