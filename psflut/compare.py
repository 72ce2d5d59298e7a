"""Compare estimators on captures of known distance: the same captures to every method, resumable, in any order.

In the folder of a comparison: ``journal.jsonl`` (every finished cell, at once), and once all is done ``results.csv``,
``results.zarr``, ``timings.csv``, ``summary.csv`` and ``summary.md``.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from psflut import __version__, family
from psflut.errors import PsflutError
from psflut.estimation import for_any_scene
from psflut.files import claimed, staged
from psflut.journal import Journal
from psflut.results import write_csv, write_rows, write_timings, write_zarr
from psflut.scoreboard import markdown, rows, words
from psflut.scores import scores
from psflut.shots import table_print
from psflut.table import PSFTable
from psflut.trial import KNOWN, Bench, Record, Unit

Work = Callable[[Bench, Sequence[Unit]], Iterator[list[Record]]]

WITH_SCENE = ("golden_section", "two_image")
"""Methods that a comparison also shows with the ideal image known, as the thesis' figures 5.2.5 to 5.2.7."""


def default_methods(scene_known: bool = True) -> tuple[str, ...]:
    """All that take any scene, and where it is known also those of `WITH_SCENE`."""
    return for_any_scene() + (tuple(name + KNOWN for name in WITH_SCENE) if scene_known else ())


def run(bench: Bench, runs: Mapping[str, int], folder: Path, work: Work) -> Iterator[list[Record]]:
    """Do what is not yet done of a comparison, and write its results.

    Parameters
    ----------
    runs : mapping
        For each method, how many of the captures at every position it sees: the first so many.
    folder : Path
        Made where there is none.
    work : callable
        Who does it: from bench and units to the records of each, in any order.

    Yields
    ------
    list of Record
        What has just been finished; first what was there before.

    Raises
    ------
    PsflutError
        If the folder cannot be made, holds a comparison with other settings, or one that is running; whatever a
        method refuses.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise PsflutError(f"cannot make the folder {folder}: {error.strerror}; choose another with -o") from error
    about = settings(bench, runs)
    try:
        with claimed(folder / ".journal.part"), Journal(folder / "journal.jsonl", about) as journal:
            yield list(journal.records)
            for found in work(bench, units(bench, runs, journal.records)):
                journal.append(found)
                yield found
            write(ordered(journal.records, bench), folder, bench.table, about)
    finally:
        with suppress(OSError):
            folder.rmdir()  # where nothing was found, nothing is left behind


def settings(bench: Bench, runs: Mapping[str, int]) -> dict[str, Any]:
    """What decides on the results; plain JSON."""
    return {
        "psflut": __version__,
        "table": table_print(bench.table),
        "methods": {name: family.describe(part) for name, part in bench.methods.items()},
        "runs": dict(runs),
        "level": bench.level,
        "seed": bench.seed,
        **bench.shots.settings(),
    }


def cells(bench: Bench, runs: Mapping[str, int]) -> int:
    """How many there are in all."""
    return sum(min(runs[name], count) for name in bench.methods for count in bench.shots.counts())


def units(bench: Bench, runs: Mapping[str, int], done: Sequence[Record] = ()) -> list[Unit]:
    """What is to be done, a capture a unit; shuffled, so that the time left can be told from the time spent."""
    finished = {(record.position, record.run, record.method) for record in done}
    found = []
    for position, count in enumerate(bench.shots.counts()):
        for run in range(count):
            left = (m for m in bench.methods if run < runs[m] and (position, run, m) not in finished)
            found.append(Unit(position, run, tuple(left)))
    order = np.random.default_rng(0).permutation(len(found))
    return [found[k] for k in order if found[k].methods]


def ordered(records: Sequence[Record], bench: Bench) -> list[Record]:
    """The records by method, position and run, whatever order they came in; each cell once."""
    place = {name: k for k, name in enumerate(bench.methods)}
    once = {(place[record.method], record.position, record.run): record for record in records}
    return [once[key] for key in sorted(once)]


def write(records: Sequence[Record], folder: Path, table: PSFTable, about: Mapping[str, Any]) -> None:
    """The files of a comparison that is done."""
    write_csv(records, folder / "results.csv")
    write_zarr(records, folder / "results.zarr", {"settings": about})
    write_timings(records, folder / "timings.csv")
    span = span_of(table)
    found = scores(records, span)
    write_rows(folder / "summary.csv", rows(found))
    with staged(folder / "summary.md", overwrite=True) as stage:
        stage.write_text(markdown(words(found, span)), encoding="utf-8")


def span_of(table: PSFTable) -> float | None:
    """Metres that relative errors on a stage axis are shares of; None: on a distance axis, of the distance."""
    return None if table.kind == "distance" else table.span[1] - table.span[0]
