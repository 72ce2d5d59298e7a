"""`psflut info`: what a table holds."""

import json
from typing import Annotated

import typer

from psflut.cli import console
from psflut.cli.options import TABLE_HELP, Json


def run(
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
