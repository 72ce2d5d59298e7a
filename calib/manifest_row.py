"""One row of a manifest of captures: its cells become a file in the folder, a page, a position and a place."""

import math
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath

from psflut.errors import PsflutError
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


def position_column(columns: list[str]) -> str:
    """Which of the columns has the positions; refuses names that are unknown, missing or there twice."""
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


def row_of(folder: Path, cells: dict[str, str], position: str) -> Row:
    """The row of these cells by column; `position` is the column of its position."""
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
