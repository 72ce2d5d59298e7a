"""Options that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

TABLE_HELP = "A table's path, or the name of one that ships, such as lab16mm."
TableOption = Annotated[str, typer.Option("--table", help=TABLE_HELP)]
TableOutput = Annotated[Path, typer.Option("-o", "--output", help="The table: NAME.zarr or NAME.zarr.zip.")]
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
PatchOption = Annotated[
    str | None,
    typer.Option("--patch", help="Y,X,SIZE or Y,X,HxW: top left corner and sides in pixels. Default: the centred 256."),
]
PosteriorOption = Annotated[
    Path | None,
    typer.Option(
        "--posterior",
        help="Keep the chain of the method posterior for ArviZ: NAME.zarr or NAME.nc (pip install psflut[lab]).",
    ),
]
