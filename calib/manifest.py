"""The manifest of real captures: which frame was taken where.

A CSV beside the frames. Its columns: ``file``; one of ``distance_m``, ``distance_mm``, ``stage_m``, ``stage_mm``,
``stage_um``; and where needed ``page`` (of a TIFF, from 0) and ``x, y`` (pixel of the target's centre, from 0). Its
rows run along the axis, up or down; several may share a position, and a frame that shows several targets has a row
for each.
"""

import csv
import functools
import math
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath

from psflut.errors import PsflutError
from psflut.images import page_shapes
from psflut.table import Kind
from psflut.units import METRES

POSITIONS = ("distance_m", "distance_mm", "stage_m", "stage_mm", "stage_um")
COLUMNS = ("file", "page", "x", "y", *POSITIONS)


@dataclass(frozen=True)
class Row:
    """A frame, or a target in it: file, page (None in a file of one), position in metres, target's (y, x) in pixels."""

    file: Path
    page: int | None
    position: float
    centre: tuple[float, float] | None = None

    @property
    def name(self) -> str:
        """For messages: the file, and its page."""
        return self.file.name if self.page is None else f"{self.file.name} page {self.page}"

    @property
    def frame(self) -> tuple[Path, int]:
        """What tells one frame from another: the file itself, and the page."""
        return self.file.resolve(), self.page or 0


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
        position = _position_column(columns)
    pages = functools.cache(page_shapes)
    shapes: dict[tuple[Path, int], tuple[int, int]] = {}
    twins: defaultdict[tuple[Path, int], list[Row]] = defaultdict(list)
    rows: list[Row] = []
    for number, cells in lines:
        with _naming(path, number):
            row = _row(path.parent, cells, position)
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


def _position_column(columns: list[str]) -> str:
    unknown = [name for name in columns if name not in COLUMNS]
    if unknown:
        raise PsflutError(f"unknown column {unknown[0]!r}; it may have {', '.join(COLUMNS)}, with commas between")
    if len(set(columns)) < len(columns):
        raise PsflutError(f"a column is there twice, got {', '.join(columns)}; keep one of them")
    if "file" not in columns:
        raise PsflutError("the column file is missing; add it")
    if ("x" in columns) != ("y" in columns):
        raise PsflutError("a centre has both x and y, got one of them; add the other")
    found = [name for name in columns if name in POSITIONS]
    if len(found) != 1:
        got = " and ".join(found) or "none"
        raise PsflutError(f"expected one column of {', '.join(POSITIONS)}, got {got}; keep one")
    return found[0]


def _row(folder: Path, cells: dict[str, str], position: str) -> Row:
    kind, unit = position.split("_")
    place = _number(position, cells[position]) * METRES[unit]
    if kind == "distance" and not place > 0:
        raise PsflutError(f"a distance must be positive, got {cells[position]!r}; a stage coordinate may be negative")
    page = cells.get("page", "")
    if page and not (page.isdecimal() and len(page) < 9):
        raise PsflutError(f"a page is a whole number from 0, got {page!r}; mend it or leave the cell empty")
    x, y = cells.get("x", ""), cells.get("y", "")
    centre = (_number("y", y), _number("x", x)) if x or y else None
    return Row(_inside(folder, cells["file"]), int(page) if page else None, place, centre)


def _number(name: str, text: str) -> float:
    try:
        value = float(text) if "_" not in text else math.nan  # 2_9 is a number to Python alone
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise PsflutError(f"{name} must be a number, got {text!r}; mend it")
    return value


def _inside(folder: Path, name: str) -> Path:
    """The file of that name in the folder or below it; nothing else is ever opened."""
    windows = PureWindowsPath(name)  # knows both kinds of slash, and drives
    if not name or not name.isprintable() or windows.anchor or ".." in windows.parts:
        raise PsflutError(f"file is a name in the manifest's folder or below it, got {name!r}; put the frame there")
    path = folder / name
    try:
        outside = not path.resolve().is_relative_to(folder.resolve())
        there = path.is_file()
    except (OSError, RuntimeError):  # a name that is too long, links in a circle
        outside = there = False
    if outside:
        raise PsflutError(f"{name!r} is a link that leaves the manifest's folder; put the frame itself there")
    if not there:
        raise PsflutError(f"no file {name!r} beside the manifest; check its name")
    return path


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
