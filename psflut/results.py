"""Results of a comparison, to and from CSV (tidy: a line an estimate) and Zarr (arrays over method, distance and run).

Both hold the same numbers and no timings, so that the same comparison gives the same bytes; those have a CSV of their
own.
"""

import csv
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from psflut.errors import PsflutError
from psflut.files import staged
from psflut.trial import Record

COLUMNS = {
    "method": "method",
    "truth": "truth_m",
    "run": "run",
    "source": "photograph",
    "corner_y": "corner_y_px",
    "corner_x": "corner_x_px",
    "estimate": "estimate_m",
    "near": "near_m",
    "far": "far_m",
    "outcome": "outcome",
}
"""Field of a `Record` and its name in the CSV."""

LENGTHS, CAPTURE = ("estimate", "near", "far"), ("source", "corner_y", "corner_x")
"""What an estimate gives, and what all methods share of a capture."""


def write_csv(records: Sequence[Record], path: Path) -> None:
    """One line an estimate; lengths in metres, as `COLUMNS` names them."""
    rows = [[getattr(record, field) for field in COLUMNS] for record in records]
    write_rows(path, [list(COLUMNS.values()), *rows])


def write_timings(records: Sequence[Record], path: Path) -> None:
    """Seconds that every estimate took where it was worked out."""
    rows = [[record.method, record.truth, record.run, record.seconds] for record in records]
    write_rows(path, [["method", "truth_m", "run", "seconds"], *rows])


def write_rows(path: Path, rows: Sequence[Sequence[Any]]) -> None:
    """A CSV, whole or not at all; lines end alike on every system."""
    with staged(path, overwrite=True) as stage, stage.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)


def read_csv(path: Path) -> list[Record]:
    """The records of `write_csv`; seconds, which it does not hold, are NaN.

    Raises
    ------
    PsflutError
        If there is no such file, or it is not of that form.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            if list(reader.fieldnames or ()) != list(COLUMNS.values()):
                raise PsflutError(f"{path} has other columns than {', '.join(COLUMNS.values())}; give a results.csv")
            lines = [{field: line[name] for field, name in COLUMNS.items()} for line in reader]
        truths = sorted({float(line["truth"]) for line in lines})
        return [_record(line, truths) for line in lines]
    except (OSError, UnicodeDecodeError, csv.Error, TypeError, ValueError) as error:
        if isinstance(error, PsflutError):
            raise
        raise PsflutError(f"cannot read {path} as results ({error}); write it again with psflut compare") from error


def _record(line: Mapping[str, str], truths: Sequence[float]) -> Record:
    kinds = {name: kind for name, kind in Record.__annotations__.items() if name in COLUMNS}
    values = {name: kind(line[name]) for name, kind in kinds.items()}
    return Record(**values, position=truths.index(values["truth"]), seconds=float("nan"))


def write_zarr(records: Sequence[Record], path: Path, about: Mapping[str, Any]) -> None:
    """A Zarr v3 group for ``xarray.open_zarr``: estimates over (method, distance, run), captures over (distance, run).

    Where a method has not seen a capture its lengths are NaN and its outcome is empty. `about` becomes the attributes.
    """
    with staged(path, overwrite=True) as stage:
        group = zarr.create_group(stage, zarr_format=3)
        for name, (dimensions, values, attributes) in _arrays(records).items():
            array = group.create_array(
                name,
                shape=values.shape,
                dtype=str if values.dtype == object else values.dtype,
                fill_value="" if values.dtype == object else None if values.dtype.kind == "i" else np.nan,
                dimension_names=dimensions,
                attributes=attributes,
            )
            array[...] = values
        group.attrs.update({"format": "psflut-results", "version": 1, **about})


def read_zarr(path: Path) -> list[Record]:
    """The records of `write_zarr`, in the order of its arrays; seconds, which it does not hold, are NaN.

    Raises
    ------
    PsflutError
        If there is no such group, or it holds something else.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # zarr's note on numcodecs
            group = zarr.open_group(path, mode="r")
            if group.attrs.get("format") != "psflut-results":
                raise PsflutError(f"{path} holds no results of psflut compare")
            data = {name: np.asarray(array[...]).tolist() for name, array in group.arrays()}
    except (OSError, ValueError, KeyError) as error:
        if isinstance(error, PsflutError):
            raise
        raise PsflutError(f"cannot read {path} as results ({error}); write it again with psflut compare") from error
    return [
        Record(
            method=method,
            position=k,
            run=run,
            truth=truth,
            **{name: data["photograph" if name == "source" else name][k][r] for name in CAPTURE},
            **{name: data[name][m][k][r] for name in LENGTHS},
            outcome=data["outcome"][m][k][r],
            seconds=float("nan"),
        )
        for m, method in enumerate(data["method"])
        for k, truth in enumerate(data["distance"])
        for r, run in enumerate(data["run"])
        if data["outcome"][m][k][r]
    ]


def _arrays(records: Sequence[Record]) -> dict[str, tuple[tuple[str, ...], NDArray[Any], dict[str, Any]]]:
    methods = list(dict.fromkeys(record.method for record in records))
    truths = sorted({record.truth for record in records})
    runs = 1 + max(record.run for record in records)
    every, captures = ("method", "distance", "run"), ("distance", "run")
    shape = len(methods), len(truths), runs
    lengths = {name: np.full(shape, np.nan) for name in LENGTHS}
    outcome, source = np.full(shape, "", dtype=object), np.full(shape[1:], "", dtype=object)
    corners = {name: np.full(shape[1:], -1) for name in ("corner_y", "corner_x")}
    for record in records:
        at = methods.index(record.method), truths.index(record.truth), record.run
        for name, values in lengths.items():
            values[at] = getattr(record, name)
        for name, places in corners.items():
            places[at[1:]] = getattr(record, name)
        outcome[at], source[at[1:]] = record.outcome, record.source
    metres = {"units": "m"}
    return {
        "method": (("method",), np.array(methods, dtype=object), {"long_name": "method, as it was asked for"}),
        "distance": (("distance",), np.array(truths), {**metres, "long_name": "true distance or stage coordinate"}),
        "run": (("run",), np.arange(runs), {"long_name": "capture at a distance"}),
        "estimate": (every, lengths["estimate"], {**metres, "long_name": "estimated distance"}),
        "near": (every, lengths["near"], {**metres, "long_name": "lower end of the interval"}),
        "far": (every, lengths["far"], {**metres, "long_name": "upper end of the interval"}),
        "outcome": (every, outcome, {"long_name": "how the estimate went"}),
        "photograph": (captures, source, {"long_name": "photograph or frame"}),
        "corner_y": (captures, corners["corner_y"], {"units": "1", "long_name": "first row of the patch in it"}),
        "corner_x": (captures, corners["corner_x"], {"units": "1", "long_name": "first column of the patch in it"}),
    }
