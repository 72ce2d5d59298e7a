"""`psflut estimate`: the distance of a patch."""

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from psflut import family
from psflut.cli import console
from psflut.cli.options import (
    Gamma,
    ImagerOption,
    Json,
    NoiseOption,
    Overwrite,
    PatchOption,
    PosteriorOption,
    Srgb,
    TableOption,
)
from psflut.cli.patches import observe, same_shape
from psflut.errors import PsflutError

if TYPE_CHECKING:
    from psflut.estimation import Estimate

METHODS = ", ".join(family.names("psflut.estimators"))


def run(
    images: Annotated[list[str], typer.Argument(help="Captures: PNG, TIFF, JPEG ...", metavar="IMAGE...")],
    table: TableOption,
    method: Annotated[
        str | None,
        typer.Option(
            help=f"{METHODS}; several with commas between, settings behind colons: wiener:candidates=200. "
            "Default: wiener, point where the scene is one, or two_image where a second image is given."
        ),
    ] = None,
    noise: NoiseOption = None,
    imager: ImagerOption = None,
    scene: Annotated[
        str | None,
        typer.Option(
            metavar="point|FILE",
            help="What is known of the scene: a lone bright point, or the ideal image, as large as the capture and "
            "decoded as it is.",
        ),
    ] = None,
    second: Annotated[
        str | None,
        typer.Option(metavar="IMAGE", help="The same scene with another aperture or focus, for two_image."),
    ] = None,
    second_table: Annotated[
        str | None, typer.Option(metavar="TABLE", help="The table of the second image's setting.")
    ] = None,
    patch: PatchOption = None,
    level: Annotated[float, typer.Option(min=0, max=1, help="Probability of the interval.")] = 0.95,
    posterior: PosteriorOption = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
    gamma: Gamma = 1.0,
    srgb: Srgb = False,
) -> None:
    """Estimate the distance of a patch, by one method or several."""
    from psflut.estimation import estimate as solve
    from psflut.images import read_image
    from psflut.posterior_file import check_posterior, write_posterior
    from psflut.store import read_table

    tabled = read_table(table)
    family.parse("psflut.imagers", imager or tabled.imager)
    default = "point" if scene == "point" else "wiener" if second is None else "two_image"
    names = [name.strip() for name in (default if method is None else method).split(",")]
    estimators = {name: family.parse("psflut.estimators", name) for name in names}
    others = [name for name in names if name.partition(":")[0] != "point"]
    if scene == "point" and others:
        raise PsflutError(f"{others[0]} does not know what a point is; leave --method out, or name point")
    if (second is None) != (second_table is None):
        raise PsflutError("a second image comes with the table of its setting; give --second and --second-table")
    if posterior is not None:
        check_posterior(posterior, overwrite)
        if len(images) != 1 or [name.partition(":")[0] for name in names].count("posterior") != 1:
            raise PsflutError("--posterior keeps the chain of one image; give one image, and the method posterior once")
    known = None if scene in (None, "point") else read_image(Path(scene), gamma, srgb)
    other = None if second is None else (read_image(Path(second), gamma, srgb), read_table(str(second_table)))
    found: list[tuple[str, str, Estimate]] = []
    try:
        for image in images:
            picture = read_image(Path(image), gamma, srgb)
            with console.about(image):
                observation = observe(picture, noise, imager, known, patch)
                if other is not None:
                    same_shape("second image", other[0], picture)
                    beside = observe(other[0], noise, imager, None, patch)
                    observation = replace(observation, second=(beside, other[1]))
                for name, estimator in estimators.items():
                    found.append((image, name, solve(observation, tabled, estimator, level)))
                    if as_json:
                        print(json.dumps(console.record(*found[-1])), flush=True)
            console.say_estimated_noise(image, found[-1][-1])
        console.say_what_wins(tabled, noise, imager)
        if posterior is not None:
            image, name, result = next(each for each in found if each[1].partition(":")[0] == "posterior")
            about = {"image": image, "table": table, "method": name, "patch": patch}
            write_posterior(result, posterior, about, overwrite)
    finally:  # what was found before a refusal is shown
        if not as_json:
            console.show(found)
