"""The command line: options in, calls, words out. No science here.

Results go to stdout (``--json``: one JSON object a line and nothing else), messages and progress to stderr.
Exit 0: done; 2: refused with one sentence; 130: interrupted.
"""

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.exceptions import TyperException

from psflut.errors import PsflutError

if TYPE_CHECKING:
    from psflut.estimation import Estimate
    from psflut.images import Picture
    from psflut.optics import Camera
    from psflut.table import PSFTable

app = typer.Typer(
    help="Distance from blur: tables of point spread functions, and estimators with honest error bars.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

TableOption = Annotated[str, typer.Option("--table", help="A table's path, or the name of one that ships.")]
Gamma = Annotated[float, typer.Option(help="Undo an encoding: linear = value ** GAMMA.")]
Srgb = Annotated[bool, typer.Option("--srgb", help="Undo the sRGB encoding.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace an existing file.")]
NoiseOption = Annotated[
    str | None, typer.Option(help="Read sigma in image units (0..1); or variance:1e-3, relative:1e-3.")
]
ImagerOption = Annotated[str | None, typer.Option(help="plain, laplacian:0.2, dog ...; default: the table's.")]
Json = Annotated[bool, typer.Option("--json", help="One JSON object a line on stdout.")]


def main() -> None:
    """Run, and turn what the caller can mend into one sentence on stderr and exit 2."""
    try:
        code = app(standalone_mode=False)
    except (PsflutError, TyperException) as error:
        print(f"psflut: {' '.join(str(error).split())}", file=sys.stderr)
        sys.exit(2)
    except (KeyboardInterrupt, typer.Abort):
        print("psflut: interrupted", file=sys.stderr)
        sys.exit(130)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(1)
    sys.exit(code if isinstance(code, int) else 0)


@app.callback(invoke_without_command=True)
def _root(
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
) -> None:
    if version:
        from psflut import __version__

        print(__version__)
        raise typer.Exit


@app.command()
def demo(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the figures.")] = Path("psflut-demo"),
) -> None:
    """The whole story on a photograph: captures, every estimator side by side, figures."""
    from tqdm import tqdm

    from psflut import demo as story

    rows = list(tqdm(story.run(output), total=story.STEPS, unit="estimate", disable=None))
    _print_table(story.HEADINGS, rows)
    _say(f"figures and results.csv are in {output}")


@app.command()
def build(
    recipe: Annotated[Path, typer.Argument(help="A recipe: a TOML file with [camera] and [table].")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The table: NAME.zarr or NAME.zarr.zip.")],
    overwrite: Overwrite = False,
) -> None:
    """Build a table from an optical model."""
    from tqdm import tqdm

    from calib.recipe import build as build_table
    from calib.recipe import read_recipe
    from psflut.store import check_target, write_table

    plan = read_recipe(recipe)
    check_target(output, overwrite)
    with tqdm(total=len(plan.distances), unit="plane", disable=None) as bar:
        table = build_table(plan, bar.update)
    write_table(table, output, overwrite)
    _say(f"{output}: {len(table.axis)} planes of {table.size} x {table.size} pixels")


@app.command()
def info(
    table: Annotated[str, typer.Argument(help="A table's path, or the name of one that ships.")],
    as_json: Json = False,
) -> None:
    """What a table holds."""
    from psflut.store import find_table, read_table
    from psflut.summary import summarise, words

    path = find_table(table)
    facts = summarise(read_table(path))
    if as_json:
        print(json.dumps({"table": str(path), **facts}))
    else:
        _print_table(None, words(facts))


@app.command()
def simulate(
    image: Annotated[Path, typer.Argument(help="A sharp picture: the scene.")],
    distance: Annotated[str, typer.Option(help="Object distance with a unit: '1.83 m'.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The capture: a float32 TIFF.")],
    camera: Annotated[Path | None, typer.Option(help="A camera file (TOML).")] = None,
    table: Annotated[str | None, typer.Option(help="A table's path, or the name of one that ships.")] = None,
    noise: NoiseOption = None,
    gain: Annotated[float | None, typer.Option(help="Photo-electrons at full scale: adds shot noise.")] = None,
    imager: ImagerOption = None,
    normalise: Annotated[
        bool | None,
        typer.Option(help="Scale by the ideal image's minimum and maximum; default: the table's."),
    ] = None,
    bits: Annotated[int | None, typer.Option(help="Quantise to 2^BITS levels.")] = None,
    seed: Annotated[int, typer.Option(help="Of the noise.")] = 0,
    ideal: Annotated[Path | None, typer.Option(help="Also write the ideal image, without blur and noise.")] = None,
    gamma: Gamma = 1.0,
    srgb: Srgb = False,
    overwrite: Overwrite = False,
) -> None:
    """A capture of a scene at a distance, through a camera or the set-up of a table."""
    from dataclasses import asdict, replace

    from psflut import capture
    from psflut.files import refuse_overwrite
    from psflut.images import read_image, write_tiff
    from psflut.units import parse_length

    metres = parse_length(distance)
    for path in (output, ideal):
        if path is not None:
            refuse_overwrite(path, overwrite)
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
    words = "without noise" if sigma is None else f"read noise {sigma:.4g}"
    _say(f"{output}: {picture.shape[0]} x {picture.shape[1]} pixels at {metres:g} m, {words}")


@app.command()
def estimate(
    images: Annotated[list[Path], typer.Argument(help="Captures.", metavar="IMAGE...")],
    table: TableOption,
    method: Annotated[str, typer.Option(help="Methods, with commas between; settings follow colons.")] = "wiener",
    noise: NoiseOption = None,
    imager: ImagerOption = None,
    scene: Annotated[Path | None, typer.Option(help="The ideal image, where it is known.")] = None,
    patch: Annotated[
        str | None,
        typer.Option(help="Y,X,SIZE: top left corner and side in pixels; default: the centred 256."),
    ] = None,
    level: Annotated[float, typer.Option(help="Probability of the interval.")] = 0.95,
    as_json: Json = False,
    gamma: Gamma = 1.0,
    srgb: Srgb = False,
) -> None:
    """The distance of a patch, by one method or several."""
    from psflut import family
    from psflut.estimation import Observation, Outcome
    from psflut.estimation import estimate as run
    from psflut.images import crop, read_image
    from psflut.noise import parse_noise
    from psflut.store import find_table, read_table

    tabled = read_table(find_table(table))
    estimators = {name: family.parse("psflut.estimators", name) for name in method.split(",")}
    _announce(tabled, noise, imager)
    known = None if scene is None else read_image(scene, gamma, srgb).image
    rows = []
    for path in images:
        picture = read_image(path, gamma, srgb)
        window = crop(picture.image.shape, patch)
        observation = Observation(
            picture.image[window],
            noise=None if noise is None else parse_noise(noise, picture.image[window]),
            imager=imager,
            scene=None if known is None else _same_window(known, picture, scene)[window],
            quantum=picture.quantum,
        )
        for name, estimator in estimators.items():
            found = run(observation, tabled, estimator, level)
            if as_json:
                print(json.dumps(_record(path, name, found)), flush=True)
            rows.append((str(path), name, *_cells(found)))
    if not as_json:
        _print_table(("image", "method", "distance", f"{level:.0%} interval", "outcome", "seconds"), rows)
        for name in sorted({row[4] for row in rows} - {"ok"}):
            _say(f"{name}: {Outcome[name.upper()].value}")


def _source(camera: Path | None, table: str | None) -> "Camera | PSFTable":
    from psflut.camera_file import read_camera
    from psflut.store import find_table, read_table

    if (camera is None) == (table is None):
        raise PsflutError("a capture needs either --camera or --table; give one of them")
    return read_camera(camera) if camera is not None else read_table(find_table(str(table)))


def _same_window(known: Any, picture: "Picture", path: Path | None) -> Any:
    if known.shape != picture.image.shape:
        raise PsflutError(f"{path} has the shape {known.shape}, the capture {picture.image.shape}; they must agree")
    return known


def _announce(table: "PSFTable", noise: str | None, imager: str | None) -> None:
    """Say where an option wins over what the table holds."""
    if noise is not None and table.noise is not None:
        _say(f"noise {noise} is used in place of the table's {table.noise.read:.4g}")
    if imager is not None and imager != table.imager:
        _say(f"imager {imager} is used in place of the table's {table.imager}")


def _record(path: Path, method: str, found: "Estimate") -> dict[str, Any]:
    """The JSON object of an estimate."""
    stats = dict(found.stats)
    seconds, edge = stats.pop("seconds"), stats.pop("edge", None)
    record = {
        "image": str(path),
        "method": method,
        "distance_m": found.distance,
        "interval_m": list(found.interval),
        "level": found.level,
        "outcome": found.outcome.name.lower(),
        "message": found.outcome.value,
        "modes": [{"distance_m": mode.distance, "weight": mode.weight} for mode in found.modes],
        "seconds": seconds,
        "stats": stats,
    }
    return record if edge is None else record | {"edge": edge}


def _cells(found: "Estimate") -> tuple[str, ...]:
    near, far = found.interval
    name = found.outcome.name.lower()
    return f"{found.distance:.3f} m", f"{near:.3f} .. {far:.3f} m", name, f"{found.stats['seconds']:.2f}"


def _print_table(headings: Sequence[str] | None, rows: Sequence[Sequence[str]]) -> None:
    lines = list(rows) if headings is None else [headings, *rows]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for line in lines:
        print("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip())


def _say(sentence: str) -> None:
    print(sentence, file=sys.stderr)
