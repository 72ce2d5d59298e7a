"""The command line: options in, calls, words out. No science here.

Results go to stdout (``--json``: one JSON object a line and nothing else), messages and progress to stderr.
Exit 0: done; 2: refused with one sentence; 130: interrupted.
"""

import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.exceptions import TyperException

from psflut import console, family
from psflut.errors import PsflutError

if TYPE_CHECKING:
    from psflut.estimation import Estimate, Observation
    from psflut.images import Picture
    from psflut.optics import Camera
    from psflut.table import PSFTable

app = typer.Typer(
    help="Distance from blur: tables of point spread functions, and estimators with honest error bars.",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

METHODS = ", ".join(family.names("psflut.estimators"))
TABLE_HELP = "A table's path, or the name of one that ships, such as lab16mm."
TableOption = Annotated[str, typer.Option("--table", help=TABLE_HELP)]
Gamma = Annotated[float, typer.Option(help="Undo an encoding: linear = value ** GAMMA.")]
Srgb = Annotated[bool, typer.Option("--srgb", help="Undo the sRGB encoding, as of most photographs.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace what exists.")]
NoiseOption = Annotated[
    str | None,
    typer.Option(
        help="Read sigma, full scale is 1: 0.005; or variance:1e-3, relative:1e-3. Default: the table's, if any."
    ),
]
ImagerOption = Annotated[str | None, typer.Option(help="plain, laplacian:0.2 or dog. Default: the table's.")]
Json = Annotated[bool, typer.Option("--json", help="One JSON object a line on stdout, nothing else there.")]


def main() -> None:
    """Run, and turn what the caller can mend into one sentence on stderr and exit 2."""
    try:
        code = app(prog_name="psflut", standalone_mode=False)
        sys.stdout.flush()
    except (PsflutError, TyperException, OSError) as error:
        if isinstance(error, BrokenPipeError):  # the reader of our output has left: nothing more is written
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            sys.exit(1)
        console.say(f"psflut: {console.sentence(error)}")
        sys.exit(2)
    except (KeyboardInterrupt, typer.Abort):
        console.say("psflut: interrupted")
        sys.exit(130)
    sys.exit(code if isinstance(code, int) else 0)


@app.callback(invoke_without_command=True)
def _root(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
) -> None:
    if version:
        from psflut import __version__

        print(__version__)
        raise typer.Exit
    if context.invoked_subcommand is None:
        print(context.get_help())


@app.command()
def demo(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the figures.")] = Path("psflut-demo"),
) -> None:
    """The whole story on a photograph: captures, every estimator side by side, figures."""
    from tqdm import tqdm

    from psflut import demo as story

    rows = list(tqdm(story.run(output), total=story.STEPS, unit="estimate", disable=None))
    console.print_rows([story.HEADINGS, *rows])
    console.say(f"figures and results.csv are in {output}")


@app.command()
def build(
    recipe: Annotated[Path, typer.Argument(metavar="RECIPE", help="A TOML file with [camera] and [table].")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The table: NAME.zarr or NAME.zarr.zip.")],
    overwrite: Overwrite = False,
) -> None:
    """Build a table from an optical model, by a recipe."""
    from tqdm import tqdm

    from calib.recipe import build as build_table
    from calib.recipe import read_recipe
    from psflut.store import check_target, write_table

    plan = read_recipe(recipe)
    check_target(output, overwrite)
    with tqdm(total=len(plan.distances), unit="plane", disable=None) as bar, console.about(str(recipe)):
        table = build_table(plan, bar.update)
    write_table(table, output, overwrite)
    console.say(f"{output}: {len(table.axis)} planes of {table.size} x {table.size} pixels")


@app.command()
def calibrate(
    captures: Annotated[Path, typer.Argument(metavar="CAPTURES.csv", help="The manifest beside the frames.")],
    target: Annotated[str, typer.Option(help="point or edge; settings behind colons: point:pinhole=2.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The table: NAME.zarr or NAME.zarr.zip.")],
    camera: Annotated[Path | None, typer.Option(help="A camera file, which names the pixel pitch.")] = None,
    pixel_pitch: Annotated[str | None, typer.Option(help="With a unit, where there is no camera file: '6 um'.")] = None,
    size: Annotated[int, typer.Option(help="Side of a PSF in pixels, odd.")] = 31,
    imager: Annotated[str, typer.Option(help="What the frames went through: plain, laplacian:0.2, dog.")] = "plain",
    dark: Annotated[str, typer.Option(help="Dark level in image units, or an image taken without light.")] = "0",
    gamma: Gamma = 1.0,
    srgb: Srgb = False,
    figure: Annotated[Path | None, typer.Option(help="Also draw a contact sheet of the PSFs: FILE.png.")] = None,
    overwrite: Overwrite = False,
) -> None:
    """Measure a table from real captures at known positions."""
    from tqdm import tqdm

    from calib.calibrate import Encoding
    from calib.calibrate import calibrate as measure
    from calib.captures import read_dark
    from calib.manifest import read_manifest
    from psflut.camera_file import read_camera
    from psflut.files import refuse_overwrite
    from psflut.store import check_target, write_table
    from psflut.summary import summarise, words
    from psflut.units import parse_length

    lens = None if camera is None else read_camera(camera)
    if (lens is None) == (pixel_pitch is None):
        raise PsflutError("a table needs its pixel pitch: give either --camera or --pixel-pitch")
    pitch = lens.pixel_pitch if lens else parse_length(pixel_pitch)
    part, filtering = family.parse("calib.targets", target), family.parse("psflut.imagers", imager)
    check_target(output, overwrite)
    if figure is not None:
        refuse_overwrite(figure, overwrite)
    manifest = read_manifest(captures, least_positions=3)
    encoding = Encoding(gamma, srgb, read_dark(dark, gamma, srgb))
    with tqdm(total=len(manifest.positions), unit="position", disable=None) as bar:
        table = measure(
            manifest, part, size, pitch, imager=filtering, camera=lens, encoding=encoding, progress=bar.update
        )
    write_table(table, output, overwrite)
    if figure is not None:
        from psflut.plots import psfs, save

        save(psfs(table), figure, overwrite)
    console.print_rows(words(summarise(table)))


@app.command()
def info(
    table: Annotated[str, typer.Argument(metavar="TABLE", help=TABLE_HELP)],
    as_json: Json = False,
) -> None:
    """Show what a table holds: its span, camera, blur, imager, noise and origin."""
    from psflut.store import find_table, read_table
    from psflut.summary import summarise, words

    path = find_table(table)
    facts = summarise(read_table(path))
    if as_json:
        print(json.dumps({"table": str(path), **facts}))
    else:
        console.print_rows(words(facts))


@app.command()
def simulate(
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
    from psflut.images import check_tiff, read_image, write_tiff
    from psflut.table import PSFTable
    from psflut.units import parse_length

    metres = parse_length(distance)
    if output == ideal:
        raise PsflutError(f"{output} cannot hold both the capture and the ideal image; name two files")
    for path in (output, ideal):
        if path is not None:
            check_tiff(path, overwrite)
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


@app.command()
def estimate(
    images: Annotated[list[str], typer.Argument(help="Captures: PNG, TIFF, JPEG ...", metavar="IMAGE...")],
    table: TableOption,
    method: Annotated[
        str,
        typer.Option(help=f"{METHODS}; several with commas between, settings behind colons: wiener:candidates=200."),
    ] = "wiener",
    noise: NoiseOption = None,
    imager: ImagerOption = None,
    scene: Annotated[
        Path | None, typer.Option(help="The ideal image, where it is known: as large as the capture, decoded as it is.")
    ] = None,
    patch: Annotated[
        str | None,
        typer.Option(help="Y,X,SIZE or Y,X,HxW: top left corner and sides in pixels. Default: the centred 256."),
    ] = None,
    level: Annotated[float, typer.Option(min=0, max=1, help="Probability of the interval.")] = 0.95,
    as_json: Json = False,
    gamma: Gamma = 1.0,
    srgb: Srgb = False,
) -> None:
    """Estimate the distance of a patch, by one method or several."""
    from psflut.estimation import estimate as run
    from psflut.images import read_image
    from psflut.store import read_table

    tabled = read_table(table)
    family.parse("psflut.imagers", imager or tabled.imager)
    estimators = {name.strip(): family.parse("psflut.estimators", name) for name in method.split(",")}
    known = None if scene is None else read_image(scene, gamma, srgb)
    found: list[tuple[str, str, Estimate]] = []
    try:
        for image in images:
            picture = read_image(Path(image), gamma, srgb)
            with console.about(image):
                observation = _observation(picture, noise, imager, known, patch)
                for name, estimator in estimators.items():
                    found.append((image, name, run(observation, tabled, estimator, level)))
                    if as_json:
                        print(json.dumps(console.record(*found[-1])), flush=True)
            console.say_estimated_noise(image, found[-1][-1])
        console.say_what_wins(tabled, noise, imager)
    finally:  # what was found before a refusal is shown
        if not as_json:
            console.show(found)


def _source(camera: Path | None, table: str | None) -> "Camera | PSFTable":
    from psflut.camera_file import read_camera
    from psflut.store import read_table

    if (camera is None) == (table is None):
        raise PsflutError("a capture needs either --camera or --table; give one of them")
    return read_camera(camera) if camera is not None else read_table(str(table))


def _observation(
    picture: "Picture", noise: str | None, imager: str | None, known: "Picture | None", patch: str | None
) -> "Observation":
    from psflut.estimation import Observation
    from psflut.images import crop
    from psflut.noise import parse_noise

    if known is not None and known.image.shape != picture.image.shape:
        raise PsflutError(f"the scene has the shape {known.image.shape}, not {picture.image.shape}; they must agree")
    window = crop(picture.image.shape, patch)
    return Observation(
        picture.image[window],
        noise=None if noise is None else parse_noise(noise, picture.image[window]),
        imager=imager,
        scene=None if known is None else known.image[window],
        quantum=picture.quantum,
    )
