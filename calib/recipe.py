"""Recipes: ``tables/<name>.toml`` becomes a table from an optical model."""

import dataclasses
import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from calib.planes import Planes
from psflut import family
from psflut.camera_file import CameraSettings, read_toml
from psflut.capture import Setup
from psflut.container import LARGEST
from psflut.errors import PsflutError, refusal
from psflut.noise import parse_noise
from psflut.optics import Camera
from psflut.psfs import PSFModel
from psflut.table import PSFTable
from psflut.units import Length, parse_length


class Range(BaseModel):
    """``{from = "0.8 m", to = "5 m", count = 64}``, in metres."""

    model_config = ConfigDict(extra="forbid")

    first: Length = Field(alias="from", gt=0)
    last: Length = Field(alias="to", gt=0)
    count: int = Field(ge=3, le=10_000)


class TableSettings(BaseModel):
    """The ``[table]`` of a recipe; other keys are settings of the model."""

    model_config = ConfigDict(extra="allow")

    model: str
    distances: Range
    size: int = Field(ge=3, le=1001)


class RecipeFile(BaseModel):
    """A whole recipe."""

    model_config = ConfigDict(extra="forbid")

    camera: CameraSettings
    table: TableSettings
    capture: dict[str, Any] = {}


@dataclass(frozen=True)
class Recipe:
    """An optical model of a set-up and the distances at which to tabulate it.

    Parameters
    ----------
    camera, model, capture : Camera, PSFModel, Setup
    distances : tuple of float
        In metres, ascending, even in vergence.
    size : int
        Side of a PSF in pixels, odd.
    sha256 : str
        Of the recipe's text.
    """

    camera: Camera
    model: PSFModel
    distances: tuple[float, ...]
    size: int
    capture: Setup = dataclasses.field(default_factory=Setup)
    sha256: str = ""


def read_recipe(path: Path) -> Recipe:
    """Read and check a recipe.

    Raises
    ------
    PsflutError
        For unknown, missing or unfit keys, lengths without a unit, unknown models and settings.
    """
    contents = read_toml(path)
    try:
        return _recipe(RecipeFile.model_validate(contents), hashlib.sha256(path.read_bytes()).hexdigest())
    except ValidationError as error:
        raise refusal(str(path), error) from error
    except PsflutError as error:
        raise PsflutError(f"{path}: {error}") from error


def _recipe(file: RecipeFile, sha256: str) -> Recipe:
    settings = {key: _in_metres(value) for key, value in (file.table.model_extra or {}).items()}
    found = Recipe(
        camera=file.camera.camera(),
        model=family.make("psflut.psfs", file.table.model, settings),
        distances=tuple(float(z) for z in _even_in_vergence(file.table.distances)),
        size=file.table.size,
        capture=TypeAdapter(Setup).validate_python(_known(file.capture, Setup)),
        sha256=sha256,
    )
    if len(found.distances) * found.size**2 > LARGEST:
        planes = f"{len(found.distances)} planes of {found.size} pixels a side"
        raise PsflutError(f"{planes} are more than {LARGEST} values; take fewer or smaller ones")
    return found


def build(
    recipe: Recipe, progress: Callable[[int], object] = lambda planes: None, kept: Planes | None = None
) -> PSFTable:
    """The table of a recipe; `progress` hears of every plane computed, or found among those that are `kept`."""
    kept = kept or Planes()
    planes = np.empty((len(recipe.distances), recipe.size, recipe.size))
    for index, distance in enumerate(recipe.distances):
        planes[index] = kept.get(
            [recipe.model, recipe.camera, distance, recipe.size], partial(_plane, recipe, distance)
        )["psf"]
        progress(1)
    fixed = recipe.capture.noise
    return PSFTable(
        axis=np.array(recipe.distances),
        psf=planes,
        pixel_pitch=recipe.camera.pixel_pitch,
        camera=recipe.camera,
        imager=recipe.capture.imager,
        # A noise relative to each capture is no property of the table.
        noise=None if fixed is None or fixed.startswith("relative") else parse_noise(fixed, planes),
        provenance={
            "model": type(recipe.model).__module__.rsplit(".", 1)[-1],
            "settings": dataclasses.asdict(recipe.model),  # type: ignore[call-overload]
            "capture": dataclasses.asdict(recipe.capture),
            "recipe_sha256": recipe.sha256,
        },
    )


def _plane(recipe: Recipe, distance: float) -> dict[str, NDArray[np.float64]]:
    return {"psf": recipe.model(recipe.camera, distance, recipe.size)}


def _even_in_vergence(span: Range) -> NDArray[np.float64]:
    if not span.last > span.first:
        raise PsflutError(f"distances must run from near to far, got {span.first} m to {span.last} m; turn them")
    distances = 1.0 / np.linspace(1.0 / span.first, 1.0 / span.last, span.count)
    distances[[0, -1]] = span.first, span.last
    return distances


def _in_metres(value: Any) -> Any:
    """Settings of a model: a text that is a length becomes metres, a range of lengths a list."""
    if isinstance(value, Mapping) and set(value) == {"from", "to", "count"}:
        span = Range.model_validate(value)
        return [float(x) for x in np.linspace(span.first, span.last, span.count)]
    if isinstance(value, list):
        return [_in_metres(item) for item in value]
    return parse_length(value) if isinstance(value, str) else value


def _known(keys: Mapping[str, Any], part: type) -> Mapping[str, Any]:
    allowed = [field.name for field in dataclasses.fields(part)]
    for key in keys:
        if key not in allowed:
            raise PsflutError(f"[capture] has an unknown key {key!r}; it may have {', '.join(allowed)}")
    return keys
