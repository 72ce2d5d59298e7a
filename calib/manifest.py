"""The manifest of real captures: which frame was taken where.

A CSV beside the frames. Its columns: ``file``; one of ``distance_m``, ``distance_mm``, ``stage_m``, ``stage_mm``,
``stage_um``; and where needed ``page`` (of a TIFF, from 0) and ``x, y`` (pixel of the target's centre, from 0). Its
rows run along the axis, up or down; several may share a position, and a frame that shows several targets has a row
for each.
"""

import csv
import functools
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from calib.manifest_row import Row, position_column, row_of
from psflut.errors import PsflutError
from psflut.images import page_shapes
from psflut.table import Kind


@dataclass(frozen=True)
class Manifest:
    """The frames of a calibration.

    Parameters
    ----------
    path : Path
        Of the CSV.
    kind : "distance" or "stage"
        What the positions are: object distances, or coordinates of a stage.
    rows : tuple of Row
        In the order of the file.
    shape : (int, int)
        Rows and columns of pixels of every frame.
    """

    path: Path
    kind: Kind
    rows: tuple[Row, ...]
    shape: tuple[int, int]

    @property
    def positions(self) -> tuple[float, ...]:
        """Distinct positions, ascending, metres."""
        return tuple(sorted({row.position for row in self.rows}))


def read_manifest(path: Path, least_positions: int = 1) -> Manifest:
    """Read and check a manifest; of the frames, only the headers.

    Parameters
    ----------
    least_positions : int
        How many distinct positions there must be: 3 for a table.

    Raises
    ------
    PsflutError
        For an absent or unreadable manifest, unknown, missing or contradicting columns, no rows, positions that are
        no numbers, not positive distances, out of order or too few; for frames that are absent, listed twice, outside
        the folder, of another shape, or a page that the file does not have. The sentence names file and row.
    """
    columns, lines = _read_csv(path)
    with _naming(path, 1):
        position = position_column(columns)
    pages = functools.cache(page_shapes)
    shapes: dict[tuple[Path, int], tuple[int, int]] = {}
    twins: defaultdict[tuple[Path, int], list[Row]] = defaultdict(list)
    rows: list[Row] = []
    for number, cells in lines:
        with _naming(path, number):
            row = row_of(path.parent, cells, position)
            _add_frame(row, pages(row.file), shapes, twins)
            _check_order(row.position, rows)
        rows.append(row)
    kind: Kind = "stage" if position.startswith("stage") else "distance"
    manifest = Manifest(path, kind, tuple(rows), next(iter(shapes.values())))
    if len(manifest.positions) < least_positions:
        raise PsflutError(
            f"{path} has {len(manifest.positions)} distinct positions, expected {least_positions} or more; "
            "take frames at others"
        )
    return manifest


@contextmanager
def _naming(path: Path, number: int) -> Iterator[None]:
    """Every refusal names the file and the row, counted as an editor does."""
    try:
        yield
    except PsflutError as error:
        raise PsflutError(f"{path}, row {number}: {error}") from error


def _read_csv(path: Path) -> tuple[list[str], list[tuple[int, dict[str, str]]]]:
    """Names of the columns; number in the file and cells of every row that is not blank."""
    if not path.is_file():
        raise PsflutError(f"no manifest at {path}; check the path")
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file, strict=True)
            table = [(reader.line_num, [cell.strip() for cell in cells]) for cells in reader if any(cells)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise PsflutError(f"{path} is no readable CSV ({error}); save it again as CSV in UTF-8") from error
    if len(table) < 2:
        raise PsflutError(f"{path} lists no frames; it needs a line of column names and a row for every frame")
    columns = table[0][1]
    for number, cells in table[1:]:
        if len(cells) != len(columns):
            raise PsflutError(f"{path}, row {number}: it has {len(cells)} cells, expected {len(columns)}; mend it")
    return columns, [(number, dict(zip(columns, cells, strict=True))) for number, cells in table[1:]]


def _add_frame(
    row: Row,
    pages: tuple[tuple[int, int], ...],
    shapes: dict[tuple[Path, int], tuple[int, int]],
    twins: dict[tuple[Path, int], list[Row]],
) -> None:
    """Note shape and row of a frame that is there, fits the others, and is new or shows another target."""
    _, page = row.frame
    if row.page is None and len(pages) > 1:
        raise PsflutError(f"{row.name} has {len(pages)} pages; say which in a column page")
    if page >= len(pages):
        raise PsflutError(f"{row.file.name} has pages 0 to {len(pages) - 1}, got page {page}; name one that it has")
    for twin in twins[row.frame]:
        if row.centre is None or twin.centre in (None, row.centre) or twin.position != row.position:
            raise PsflutError(f"{row.name} is listed twice; keep one of its rows, or give each target its x and y")
    twins[row.frame].append(row)
    height, width = shapes[row.frame] = pages[page]
    first = next(iter(shapes.values()))
    if (height, width) != first:
        raise PsflutError(f"{row.name} has {height} x {width} pixels, expected {first[0]} x {first[1]}; crop all alike")
    if row.centre and not (0 <= row.centre[0] <= height - 1 and 0 <= row.centre[1] <= width - 1):
        y, x = row.centre
        raise PsflutError(f"the centre x = {x:g}, y = {y:g} lies outside {height} x {width} pixels; mend it")


def _check_order(position: float, rows: list[Row]) -> None:
    """Rows run up or down: a position out of order is most often a slip of the hand."""
    if rows and (position - rows[-1].position) * (rows[-1].position - rows[0].position) < 0:
        raise PsflutError("its position turns back; sort the rows along the axis, after checking the number")
