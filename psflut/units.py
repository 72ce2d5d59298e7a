"""Lengths as text with a unit: ``"16 mm"`` is 0.016 (metres). Bare numbers are refused."""

import math
import re
from typing import Annotated

from pydantic import BeforeValidator

from psflut.errors import PsflutError

METRES = {"nm": 1e-9, "um": 1e-6, "µm": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "km": 1e3}
LARGEST_PITCH = 1e-3
_LENGTH = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\s\d]+)\s*")


def parse_length(text: object) -> float:
    """Metres from text such as ``"1.83 m"``, ``"25 um"`` or ``"100mm"``.

    Raises
    ------
    PsflutError
        If the text is not a number followed by one of nm, um, mm, cm, m, km.
    """
    match = _LENGTH.fullmatch(text) if isinstance(text, str) else None
    if match is None or match[2] not in METRES:
        raise PsflutError(
            f"a length is a number with a unit ({', '.join(METRES)}), got {text!r}; write for example '16 mm'"
        )
    metres = float(match[1]) * METRES[match[2]]
    if not math.isfinite(metres):
        raise PsflutError(f"a length must be finite, got {text!r}; write for example '16 mm'")
    return metres


def parse_pitch(text: object) -> float:
    """Metres from one pixel to the next, from text such as ``"6 um"``; no camera has pixels of more than a millimetre.

    Raises
    ------
    PsflutError
        If the text is no length, or not that of a pixel.
    """
    metres = parse_length(text)
    if not 0 < metres <= LARGEST_PITCH:
        raise PsflutError(
            f"the width of a pixel is positive and at most {format_length(LARGEST_PITCH)}, got {text!r}; check the unit"
        )
    return metres


def format_length(metres: float) -> str:
    """Text that `parse_length` reads back, in the unit that a person would choose."""
    size = abs(metres)
    if not math.isfinite(metres) or size == 0 or size >= 1:
        return f"{metres:.4g} m"
    unit = next(unit for unit in ("mm", "um", "nm") if size >= METRES[unit] or unit == "nm")
    return f"{metres / METRES[unit]:.4g} {unit}"


Length = Annotated[float, BeforeValidator(parse_length)]
"""A pydantic field in metres that is written as text with a unit."""

Pitch = Annotated[float, BeforeValidator(parse_pitch)]
"""The same of a pixel's side."""
