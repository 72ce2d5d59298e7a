"""`psflut depthmap`: distances of all patches of an image, or of a sequence."""

from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from psflut import family
from psflut.cli import console
from psflut.cli.options import Gamma, ImagerOption, Json, NoiseOption, Overwrite, Srgb, TableOption
from psflut.cli.patchmaps import say
from psflut.errors import PsflutError

MANY = 8
"""Pieces for which it pays to start processes: a frame of 640 x 480 pixels is one, 1,000 patches are another."""


def run(
    images: Annotated[
        list[str],
        typer.Argument(
            metavar="IMAGE...",
            help="Captures: PNG, TIFF of one page or many, .npy or .zarr (y, x) or (time, y, x), folders of pictures, "
            "videos (extra: video). Several are a sequence.",
        ),
    ],
    table: TableOption,
    output: Annotated[
        list[Path] | None,
        typer.Option("-o", "--output", help="The map: NAME.zarr, .tif or .png; may be given several times."),
    ] = None,
    size: Annotated[int, typer.Option(help="Side of a patch, pixels.")] = 64,
    stride: Annotated[int, typer.Option(help="From patch to patch, pixels.")] = 32,
    noise: NoiseOption = None,
    imager: ImagerOption = None,
    pixel_pitch: Annotated[
        str | None, typer.Option(help="Of the images, with a unit: '6 um'. Another than the table's is refused.")
    ] = None,
    level: Annotated[float, typer.Option(min=0, max=1, help="Probability of the intervals.")] = 0.95,
    smooth: Annotated[bool, typer.Option("--smooth", help="Also smooth distances across patches that agree.")] = False,
    rate: Annotated[
        float | None, typer.Option(help="Frames a second of a sequence, for its time axis. Default: a video's.")
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(min=1, help=f"Processes, of one thread each. Default: one for every core from {MANY} pieces on."),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Of a running Dask scheduler: its workers do the work (extra: lab)."),
    ] = None,
    as_json: Json = False,
    gamma: Gamma = 1.0,
    srgb: Srgb = False,
    overwrite: Overwrite = False,
) -> None:
    """Map the distances of an image's patches; run it again and it goes on where it stopped.

    Images of any size are read line by line where they are uncompressed TIFF, .npy or .zarr. What is finished is kept
    beside the first output until all is.
    """
    from tqdm import tqdm

    from psflut.assembly import assemble
    from psflut.cluster import cluster
    from psflut.files import refuse_inputs
    from psflut.frames import frames
    from psflut.mapfiles import check_map, write_map
    from psflut.mapping import plan, solve
    from psflut.noise import parse_noise
    from psflut.store import read_table
    from psflut.unfinished import resumed, settings
    from psflut.workers import cores, local

    tabled, outputs = read_table(table), output or []
    family.parse("psflut.imagers", imager or tabled.imager)
    _check_pitch(pixel_pitch, tabled.pixel_pitch)
    if rate is not None and not 0 < rate < float("inf"):
        raise PsflutError(f"a rate is a positive number of frames a second, got {rate}")
    if len({path.resolve() for path in outputs}) < len(outputs):
        raise PsflutError("two outputs have one name; give each its own")
    sequence = frames(images, gamma, srgb)
    for path in outputs:
        check_map(path, overwrite, len(sequence.names))
        refuse_inputs(path, {page.path for page in sequence.pages})
    middle = sequence.lines(0, 0, min(sequence.shape[0], max(size, 1))).image
    job = plan(sequence, tabled, size, stride, None if noise is None else parse_noise(noise, middle), imager, level)
    pieces = job.pieces()
    count = workers or (cores() if len(pieces) >= MANY else 1)
    work = partial(cluster, address=scheduler, work=solve) if scheduler else partial(local, count=count, work=solve)
    kept = outputs[0].with_name(f".{outputs[0].name}.unfinished") if outputs else None
    with ExitStack() as stack:
        done = stack.enter_context(resumed(job, pieces, work, kept, settings(job, sequence)))
        bar = stack.enter_context(tqdm(done, total=len(pieces), unit="piece", disable=None, smoothing=0))
        try:
            found = assemble(job, bar, smooth=smooth, sequence=len(sequence.names) > 1, rate=rate or sequence.rate)
        except KeyboardInterrupt:
            if kept is not None:
                count = len(list(kept.glob("*-*-*.npz")))
                console.say(f"{count} of {len(pieces)} pieces are done and kept in {kept}; the same command goes on")
            raise
        scene = sequence.lines(0, 0, sequence.shape[0]).image if any(p.suffix == ".png" for p in outputs) else None
        for path in outputs:
            write_map(found, path, scene, overwrite)
    if noise is None and tabled.noise is None:
        console.say(f"noise {job.noise.read:.3g} is estimated from {images[0]}; pass --noise where it is known")
    console.say_what_wins(tabled, noise, imager)
    say(sequence.names, found, as_json)
    for path in outputs:
        console.say(f"the map is in {path}")


def _check_pitch(text: str | None, pitch: float) -> None:
    from psflut.units import format_length, parse_pitch

    if text is not None and abs(parse_pitch(text) / pitch - 1.0) > 1e-6:
        raise PsflutError(
            f"the images have pixels of {format_length(parse_pitch(text))}, the table of {format_length(pitch)}; "
            "give the table of their camera"
        )
