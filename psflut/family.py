"""A folder of interchangeable parts is its own registry.

A family is a package such as ``psflut.psfs`` with one part a file; the part is the one public dataclass
of that file and is named after it. Its fields are its settings. A new file is a new part: nothing is
listed anywhere, and nothing is imported until it is asked for.
"""

import dataclasses
import importlib
import inspect
import json
import math
import pkgutil
from collections.abc import Mapping
from functools import cache
from typing import Any

from psflut.errors import PsflutError, refusal


@cache
def names(family: str) -> tuple[str, ...]:
    """Names of the parts in the package `family`, without importing them."""
    package = importlib.import_module(family)
    return tuple(sorted(m.name for m in pkgutil.iter_modules(package.__path__) if not m.name.startswith("_")))


def load(family: str, name: str) -> type[Any]:
    """The class of the part `name`.

    Raises
    ------
    PsflutError
        If the family has no such part; the sentence lists those it has.
    """
    if name not in names(family):
        kind = family.rsplit(".", 1)[-1]
        raise PsflutError(f"unknown name {name!r} among the {kind}; choose one of {', '.join(names(family))}")
    module = importlib.import_module(f"{family}.{name}")
    (part,) = (
        thing
        for label, thing in vars(module).items()
        if inspect.isclass(thing) and thing.__module__ == module.__name__ and not label.startswith("_")
        if dataclasses.is_dataclass(thing)
    )
    return part


def make(family: str, name: str, settings: Mapping[str, Any]) -> Any:
    """The part `name` with its settings checked and converted to the types of its fields.

    Raises
    ------
    PsflutError
        For a setting that the part does not have, or a value that does not fit.
    """
    from pydantic import ValidationError

    part = load(family, name)
    fields = [field.name for field in dataclasses.fields(part)]
    for key in settings:
        if key not in fields:
            raise PsflutError(f"{name} has no setting {key!r}; it has {', '.join(fields) or 'none'}")
    try:
        made = _adapter(family, name).validate_python(dict(settings))
    except ValidationError as error:
        raise refusal(name, error) from error
    for key in settings:
        value = getattr(made, key)
        if isinstance(value, float) and not math.isfinite(value):
            raise PsflutError(f"{name}: {key} must be a finite number, got {value}; mend it")
    return made


@cache
def _adapter(family: str, name: str) -> Any:
    """What checks the settings of a part; it takes a millisecond to make."""
    from pydantic import TypeAdapter

    return TypeAdapter(load(family, name))


def parse(family: str, text: str) -> Any:
    """The part that text such as ``laplacian:0.5`` or ``golden_section:start=table`` describes.

    Settings follow the name after colons, as ``key=value`` or, in the order of the fields, as bare values.
    """
    name, *words = text.strip().split(":")
    fields = [field.name for field in dataclasses.fields(load(family, name))]
    settings: dict[str, Any] = {}
    for position, word in enumerate(words):
        key, equals, value = word.partition("=")
        if not equals:
            if position >= len(fields):
                raise PsflutError(f"{name} takes at most {len(fields)} settings, {text!r} has {len(words)}; drop some")
            key, value = fields[position], word
        settings[key] = _value(value)
    return make(family, name, settings)


def describe(part: Any) -> str:
    """The text that `parse` reads back: the part's name and those settings that are not the default."""
    words = [type(part).__module__.rsplit(".", 1)[-1]]
    for field in dataclasses.fields(part):
        value = getattr(part, field.name)
        if value != field.default:
            words.append(f"{field.name}={value if isinstance(value, str) else json.dumps(value)}")
    return ":".join(words)


def _value(text: str) -> Any:
    """Numbers, true and false, lists and null as JSON has them; anything else is text."""
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        return text
