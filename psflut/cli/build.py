"""`psflut build`: a table from an optical model."""

from pathlib import Path
from typing import Annotated

import typer

from psflut.cli import console
from psflut.cli.options import Overwrite, TableOutput


def run(
    recipe: Annotated[Path, typer.Argument(metavar="RECIPE", help="A TOML file with [camera] and [table].")],
    output: TableOutput,
    overwrite: Overwrite = False,
) -> None:
    """Build a table from an optical model, by a recipe."""
    from tqdm import tqdm

    from calib.planes import beside
    from calib.recipe import build as build_table
    from calib.recipe import read_recipe
    from psflut.sampling import advice
    from psflut.store import check_target, write_table

    plan = read_recipe(recipe)
    check_target(output, overwrite)
    with beside(output) as kept:
        with tqdm(total=len(plan.distances), unit="plane", disable=None) as bar, console.about(str(recipe)):
            table = build_table(plan, bar.update, kept)
        write_table(table, output, overwrite)
    console.say(f"{output}: {len(table.axis)} planes of {table.size} x {table.size} pixels")
    if (sentence := advice(table)) is not None:
        console.say(f"{output}: {sentence}")
