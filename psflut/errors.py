"""The one family of errors."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pydantic import ValidationError


class PsflutError(ValueError):
    """Something the caller can mend. The message is one sentence: expected, got, what to do."""


def refusal(what: str, error: ValidationError) -> PsflutError:
    """The first thing that pydantic found wrong with `what`, as one sentence."""
    # A misspelt key is both unknown and missing: the unknown one tells more.
    first = min(error.errors(), key=lambda each: each["type"] != "extra_forbidden")
    where = ".".join(str(step) for step in first["loc"])
    reason = first["msg"].removeprefix("Value error, ")
    if first["type"] == "extra_forbidden":
        return PsflutError(f"{what} has an unknown key {where!r}; remove it or mend its spelling")
    if first["type"] == "missing":
        return PsflutError(f"{what} lacks the key {where!r}; add it")
    got = "" if first["type"] == "value_error" else f", got {first['input']!r}"
    mend = "" if ";" in reason else "; mend it"
    return PsflutError(f"{what}: {where + ': ' if where else ''}{reason}{got}{mend}")
