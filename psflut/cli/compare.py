"""`psflut compare`: estimators side by side on captures of known distance."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from psflut.cli import console
from psflut.cli.options import Gamma, ImagerOption, Srgb, TableOption
from psflut.errors import PsflutError

RUNS, FEW = 40, 8
"""Captures at a distance, and of them those that `posterior` and methods that are told the scene see."""


def run(
    table: TableOption,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder of the results.")],
    images: Annotated[
        str | None,
        typer.Option(
            metavar="DIR",
            help="Folder of sharp pictures, or names of scikit-image's: camera,coins. "
            "Default: all of those that ship with it and are large enough, shrunk 2x.",
        ),
    ] = None,
    captures: Annotated[
        Path | None,
        typer.Option(metavar="CAPTURES.csv", help="Real frames at known positions in place of simulated captures."),
    ] = None,
    camera: Annotated[
        Path | None, typer.Option(help="With --captures: its camera file; another pixel pitch is refused.")
    ] = None,
    method: Annotated[
        str | None,
        typer.Option(
            help="Several with commas between, settings behind colons; +scene tells a method the ideal image. "
            "Default: golden_section, blind_rl, wiener, posterior, golden_section+scene, two_image+scene."
        ),
    ] = None,
    distances: Annotated[int, typer.Option(min=1, help="Evenly over the table, off its grid.")] = 9,
    runs: Annotated[
        int | None,
        typer.Option(
            min=1,
            help=f"Captures at every distance: photograph after photograph, at places and with noise of their own. "
            f"Default: {RUNS}, of which posterior and +scene see the first {FEW}.",
        ),
    ] = None,
    size: Annotated[int, typer.Option(min=1, help="Side of a patch, pixels.")] = 128,
    noise: Annotated[
        str | None,
        typer.Option(
            help="Read sigma, full scale is 1: 0.005; or variance:1e-3, relative:1e-3. Default: as the table's "
            "set-up, else 0.005; of real frames the table's, else estimated."
        ),
    ] = None,
    imager: ImagerOption = None,
    level: Annotated[float, typer.Option(min=0, max=1, help="Probability of the intervals.")] = 0.95,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same results.csv, whoever works.")] = 0,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes, of one thread each. Default: one for every core.")
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Of a running Dask scheduler: its workers do the work (extra: lab)."),
    ] = None,
    gamma: Gamma = 1.0,
    srgb: Srgb = False,
) -> None:
    """Compare estimators on captures of known distance; run it again and it goes on where it stopped.

    By default all methods for any scene see 9 distances x 40 captures of 128 x 128 pixels, posterior 9 x 8 of them;
    golden_section and two_image also see 9 x 8 with the ideal image known. blind_rl goes from coarse to fine: it
    restores from 12 PSFs over the whole table and reads 400 candidates between them. This takes some 10 minutes on two
    cores. DIR gets results.csv, results.zarr, timings.csv, summary.csv, summary.md and figures.
    """
    from tqdm import tqdm

    from psflut import compare, scoreboard, scores, trial
    from psflut.cli.shots import Encoding, measured, simulated
    from psflut.cluster import cluster
    from psflut.gallery import draw
    from psflut.store import read_table
    from psflut.workers import cores, local

    tabled = read_table(table)
    names = [name.strip() for name in method.split(",")] if method else compare.default_methods(captures is None)
    parts = {name: trial.method(name) for name in names}
    known = [name for name in names if name.endswith(trial.KNOWN)]
    if captures is not None and images is not None:
        raise PsflutError("captures are real frames or made of pictures; give either --captures or --images")
    if captures is not None and known:
        raise PsflutError(f"{known[0]} needs the ideal image, which real frames do not have; leave {trial.KNOWN} away")
    shots = (
        simulated(tabled, images, distances, runs or RUNS, size, noise, imager, seed, Encoding(gamma, srgb))
        if captures is None
        else measured(tabled, captures, camera, size, noise, imager, Encoding(gamma, srgb))
    )
    bench = trial.Bench(tabled, shots, parts, level, seed)
    most = max(shots.counts())
    few = [name for name in names if captures is None and (name == "posterior" or name in known)]
    counts = {name: min(runs or (FEW if name in few else most), most) for name in names}
    work = partial(cluster, address=scheduler) if scheduler else partial(local, count=workers or cores())
    steps, total = compare.run(bench, counts, output, work), compare.cells(bench, counts)
    records = next(steps)
    try:
        with tqdm(total=total, initial=len(records), unit="cell", disable=None, smoothing=0) as bar:
            for found in steps:
                records += found
                bar.update(len(found))
    except KeyboardInterrupt:
        console.say(f"{len(records)} of {total} cells are done and kept in {output}; the same command goes on")
        raise
    console.say_what_wins(tabled, noise, imager)
    span = compare.span_of(tabled)
    console.print_rows(scoreboard.words(scores.scores(compare.ordered(records, bench), span), span))
    draw(bench, compare.ordered(records, bench), output / "figures")
    console.say(f"results.csv, results.zarr, timings.csv, summary.md and figures are in {output}")
