"""What the command line says: JSON objects, rows in columns, sentences. Light, as ``psflut --help`` imports it."""

import errno
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from typer.exceptions import TyperException

from psflut.errors import PsflutError

if TYPE_CHECKING:
    from psflut.estimation import Estimate
    from psflut.table import PSFTable

HEADINGS = ("image", "method", "distance", "interval", "outcome", "seconds")


def say(sentence: str) -> None:
    """A message, on stderr; none where that is closed, for stdout is for results alone."""
    if sys.stderr is not None:
        print(sentence, file=sys.stderr)


def sentence(error: BaseException) -> str:
    """What went wrong, in one line; for a mistake in the command itself also where its help is."""
    text = str(error)
    if isinstance(error, OSError) and error.strerror:
        remedy = "make room" if error.errno == errno.ENOSPC else "check the path"
        text = f"{error.filename or 'the system'}: {error.strerror.lower()}; {remedy}"
    if isinstance(error, TyperException):
        words = error.format_message().rstrip(".").replace(". Did you mean", "; did you mean")
        context = getattr(error, "ctx", None)
        text = f"{words[:1].lower()}{words[1:]} (see '{context.command_path if context else 'psflut'} --help')"
    return " ".join(text.split())


@contextmanager
def about(image: str) -> Iterator[None]:
    """Name the image in a refusal of what was to be done with it."""
    try:
        yield
    except PsflutError as error:
        raise PsflutError(f"{image}: {error}") from error


def record(image: str, method: str, found: "Estimate") -> dict[str, Any]:
    """The JSON object of an estimate: lengths in metres, image and method as they were given."""
    facts = {
        "image": image,
        "method": method,
        "distance_m": found.distance,
        "interval_m": list(found.interval),
        "level": found.level,
        "outcome": found.outcome.name.lower(),
        "message": found.outcome.value,
        "modes": [{"distance_m": mode.distance, "weight": mode.weight} for mode in found.modes],
        "seconds": found.stats["seconds"],
    }
    return facts | {"edge": found.stats["edge"]} if found.outcome.name == "AT_EDGE" else facts


def show(estimates: Sequence[tuple[str, str, "Estimate"]]) -> None:
    """The same for a person: a row an estimate, and on stderr what each outcome that is not ok means."""
    if estimates:
        print_rows([HEADINGS, *(_row(*each) for each in estimates)])
    for outcome in dict.fromkeys(found.outcome for *_, found in estimates):
        if outcome.value:
            say(f"{outcome.name.lower()}: {outcome.value}")


def _row(image: str, method: str, found: "Estimate") -> tuple[str, ...]:
    from psflut.units import METRES

    size = max(map(abs, found.interval))
    unit = next((unit for unit in ("m", "mm", "um") if size >= 0.1 * METRES[unit]), "nm")  # three decimals show it
    near, distance, far = (metres / METRES[unit] for metres in (found.interval[0], found.distance, found.interval[1]))
    interval = f"{near:.3f} .. {far:.3f} {unit} ({100 * found.level:g} %)"
    name = found.outcome.name.lower()
    return image, method, f"{distance:.3f} {unit}", interval, name, f"{found.stats['seconds']:.2f}"


def print_rows(rows: Sequence[Sequence[str]]) -> None:
    """Lines in which the cells of every column stand below each other, on stdout."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())


def say_what_wins(table: "PSFTable", noise: str | None, imager: str | None) -> None:
    """Where an option was used in place of what the table holds."""
    if noise is not None and table.noise is not None:
        say(f"noise {noise} is used in place of the table's {table.noise.read:.4g}")
    if imager is not None and imager != table.imager:
        say(f"imager {imager} is used in place of the table's {table.imager}")


def say_estimated_noise(image: str, found: "Estimate") -> None:
    """Which noise the image itself was found to have, where neither option nor table knows it."""
    if found.stats["noise_source"] == "image":
        say(f"noise {found.stats['noise']:.3g} is estimated from {image}; pass --noise where it is known")
