"""`psflut target`: a page of noise to print and to calibrate with."""

from pathlib import Path
from typing import Annotated

import typer

from psflut.cli import console
from psflut.cli.options import Overwrite
from psflut.errors import PsflutError


def run(
    output: Annotated[Path, typer.Option("-o", "--output", help="The page: FILE.pdf; or its picture: FILE.png.")],
    size: Annotated[str, typer.Option(help="Of the page: A4, A3 or Letter.")] = "A4",
    seed: Annotated[int, typer.Option(min=0, help="Of the noise: the same seed gives the same page.")] = 0,
    overwrite: Overwrite = False,
) -> None:
    """Draw the noise target for calibrate --target pattern: print it at any size, and glue it on something flat."""
    from calib.noise_target import AROUND, CELL, DOTS, PAGES, SIDE, NoiseTarget
    from psflut.files import refuse_overwrite
    from psflut.plots import page, save
    from psflut.writing import write_png

    target = NoiseTarget(size, seed)
    if output.suffix.lower() not in (".pdf", ".png"):
        raise PsflutError(f"a target is a page, FILE.pdf, or a picture, FILE.png, got {str(output)!r}; choose one")
    refuse_overwrite(output, overwrite)
    if output.suffix.lower() == ".png":
        write_png(output, target.picture(), overwrite)
    else:
        words = (
            f"psflut noise target {target.name}. Print it, mount it flat, light it evenly, and take frames that "
            f"show all four discs: psflut calibrate CAPTURES.csv --target pattern --reference {target.name} -o TABLE"
        )
        place = SIDE - AROUND
        save(page(target.picture(), CELL / DOTS, PAGES[size], place, words), output, overwrite)
    console.say(f"{output}: calibrate with --target pattern --reference {target.name}")
