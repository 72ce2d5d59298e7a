"""`psflut check`: whether a table still holds for new frames."""

import json
from pathlib import Path
from typing import Annotated

import typer

from psflut import family
from psflut.cli import console
from psflut.cli.options import TABLE_HELP, Json
from psflut.errors import PsflutError


def run(
    table: Annotated[str, typer.Argument(metavar="TABLE", help=TABLE_HELP)],
    captures: Annotated[Path, typer.Argument(metavar="CAPTURES.csv", help="The manifest beside the new frames.")],
    target: Annotated[str | None, typer.Option(help="As in calibrate. Default: that of the table.")] = None,
    dark: Annotated[str, typer.Option(help="Dark level in image units, or an image taken without light.")] = "0",
    gamma: Annotated[float | None, typer.Option(help="linear = value ** GAMMA. Default: that of the table.")] = None,
    srgb: Annotated[bool | None, typer.Option("--srgb/--no-srgb", help="Default: as of the table.")] = None,
    as_json: Json = False,
) -> None:
    """Say whether a table still holds for new frames, or how far it has drifted; either is an answer, exit 0."""
    from tqdm import tqdm

    from calib.calibrate import Encoding, measure_all
    from calib.captures import read_dark
    from calib.drift import drift
    from calib.manifest import read_manifest
    from psflut.store import find_table, read_table

    path = find_table(table)
    tabled = read_table(path)
    made = tabled.provenance
    name = target or made.get("target")
    if name is None:
        raise PsflutError(f"{table} was not measured from a target; say with --target what the new frames show")
    part, imager = family.parse("calib.targets", name), family.parse("psflut.imagers", tabled.imager)
    gamma = made.get("gamma", 1.0) if gamma is None and not srgb else gamma or 1.0
    srgb = bool(made.get("srgb", False)) if srgb is None and gamma == 1.0 else bool(srgb)
    manifest = read_manifest(captures)
    if manifest.kind != tabled.kind:
        raise PsflutError(f"{captures} gives a {manifest.kind}, the table's axis is a {tabled.kind}; give that")
    encoding = Encoding(gamma, srgb, read_dark(dark, gamma, srgb))
    with tqdm(total=len(manifest.positions), unit="position", disable=None) as bar:
        axis, measured, _ = measure_all(manifest, part, tabled.size, imager, encoding, lambda _: bar.update())
    found = drift(tabled, axis, measured)
    if as_json:
        print(json.dumps({"table": str(path), **found.facts()}))
        return
    rows = [(f"{row['position_m']:g} m", f"reads {row['read_m']:.5g} m") for row in found.facts()["frames"]]
    console.print_rows([*rows, (found.verdict, found.message())])
