"""`psflut report`: an uncertainty report of one patch."""

from pathlib import Path
from typing import Annotated, Any

import typer

from psflut import family
from psflut.cli import console
from psflut.cli.options import (
    Gamma,
    ImagerOption,
    NoiseOption,
    Overwrite,
    PatchOption,
    PosteriorOption,
    Srgb,
    TableOption,
)
from psflut.cli.patches import observe


def run(
    image: Annotated[str, typer.Argument(metavar="IMAGE", help="A capture: PNG, TIFF, JPEG ...")],
    table: TableOption,
    output: Annotated[Path, typer.Option("-o", "--output", help="The page: NAME.html, with all its figures inside.")],
    noise: NoiseOption = None,
    imager: ImagerOption = None,
    patch: PatchOption = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the chain and all else: the same seed, the same page.")] = 0,
    posterior: PosteriorOption = None,
    gamma: Gamma = 1.0,
    srgb: Srgb = False,
    overwrite: Overwrite = False,
) -> None:
    """Report the distance of a patch and its uncertainty: posterior, error budget, every estimator, on one page."""
    from tqdm import tqdm

    from psflut.images import read_image
    from psflut.posterior_file import check_posterior, write_posterior
    from psflut.reporting import check_page, report
    from psflut.store import read_table

    check_page(output, overwrite)
    if posterior is not None:
        check_posterior(posterior, overwrite)
    tabled = read_table(table)
    family.parse("psflut.imagers", imager or tabled.imager)
    picture = read_image(Path(image), gamma, srgb)
    asked: dict[str, Any] = {"image": image, "table": table, "patch": patch, "noise": noise, "imager": imager}
    asked |= {"gamma": None if gamma == 1 else gamma, "encoding": "sRGB" if srgb else None}
    about = {key: str(value) for key, value in asked.items() if value is not None}
    with console.about(image):
        observation = observe(picture, noise, imager, None, patch)
        page = report(
            observation,
            tabled,
            name=Path(image).name,
            about=about,
            seed=seed,
            watch=lambda methods: tqdm(list(methods), unit="method", disable=None),
        )
    found = page.estimates["posterior"]
    if posterior is not None:
        write_posterior(found, posterior, about | {"seed": seed}, overwrite)
    page.save(output, overwrite)
    console.say_estimated_noise(image, found)
    console.say_what_wins(tabled, noise, imager)
    console.show([(image, "posterior", found)])
    console.say(f"the report is in {output}")
