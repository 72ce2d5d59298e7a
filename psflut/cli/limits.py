"""`psflut limits`: how near any method can come, before a single capture is taken."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from psflut.cli import console
from psflut.cli.options import ImagerOption, Json, NoiseOption, Overwrite, TableOption

if TYPE_CHECKING:
    from psflut.limits import Limits
    from psflut.table import PSFTable

NOISE = "0.005"
"""Where neither the option nor the table says."""

EVERY = 10
"""Of the positions, those that are printed."""


def run(
    table: TableOption,
    patch_size: Annotated[int, typer.Option(min=1, max=4096, metavar="N", help="Side of the patch in pixels.")] = 128,
    noise: NoiseOption = None,
    imager: ImagerOption = None,
    scene: Annotated[
        Literal["unknown", "known", "point"],
        typer.Option(help="What is known of the scene: nothing but that it has texture, all of it, or a lone point."),
    ] = "unknown",
    contrast: Annotated[
        float | None,
        typer.Option(
            metavar="C",
            help="Standard deviation of the sharp scene, full scale 1; of a point, its brightest pixel where it is "
            "sharpest. Default: the texture prior's median; a point: 1.",
        ),
    ] = None,
    as_json: Json = False,
    figure: Annotated[Path | None, typer.Option("-o", "--output", help="Also draw the bound: FILE.png.")] = None,
    overwrite: Overwrite = False,
) -> None:
    """Say how near any method can come to a distance: the Cramer-Rao bound along a table."""
    import numpy as np

    from psflut import family
    from psflut.capture import setup_of
    from psflut.limits import bound
    from psflut.noise import parse_noise
    from psflut.store import read_table

    if figure is not None:
        from psflut.plots import check_figure

        check_figure(figure, overwrite)
    tabled = read_table(table)
    text = noise or setup_of(tabled).noise
    known = tabled.noise if noise is None else None
    found = bound(
        tabled,
        (patch_size, patch_size),
        known or parse_noise(text or NOISE, np.array([-1.0, 1.0])),  # relative to a capture of variance 1
        family.parse("psflut.imagers", imager or tabled.imager),
        scene=scene,
        contrast=contrast,
        relative=known is None and (text or NOISE).startswith("relative"),
    )
    if text is None:
        console.say(f"the table holds no noise: {NOISE} is taken; pass --noise where it is known")
    console.say_what_wins(tabled, noise, imager)
    if figure is not None:
        from psflut.plots import limits, save

        save(limits({f"scene {scene}": found}), figure, overwrite)
    if as_json:
        _print_json(found)
    else:
        _print_table(found, tabled)


def _print_json(found: "Limits") -> None:
    import numpy as np

    for position, crb, within in zip(found.axis, found.crb, found.within, strict=True):
        crb_m = float(crb) if np.isfinite(crb) else None
        print(json.dumps({"distance_m": float(position), "crb_m": crb_m, "within_span_m": float(within)}))


def _print_table(found: "Limits", table: "PSFTable") -> None:
    from psflut.limits import GOOD
    from psflut.units import format_length

    of = "of the distance" if table.kind == "distance" else "of the span"
    rows = [("distance", "bound", of, "within the table's span")]
    for k in range(0, len(found.axis), EVERY):
        position, crb, within = (format_length(float(each[k])) for each in (found.axis, found.crb, found.within))
        rows.append((position, crb, f"{100 * found.relative[k]:.3g} %", within))
    console.print_rows(rows)
    for name, spans in (("good", found.good), ("blind", found.blind)):
        if spans:
            text = ", ".join(f"{format_length(first)} to {format_length(last)}" for first, last in spans)
            print(f"{name} ({'at most' if name == 'good' else 'above'} {100 * GOOD:g} % {of}): {text}")
    print(f"scene {found.scene}, contrast {found.contrast:.3g}")
