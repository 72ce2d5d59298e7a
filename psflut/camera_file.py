"""Camera files: TOML with lengths as text with a unit."""

import tomllib
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from psflut.errors import PsflutError, refusal
from psflut.optics import Camera
from psflut.units import Length, Pitch

LARGEST_FILE = 65536
"""Bytes of a TOML file that is read: keys that nest without end take for ever."""


class CameraSettings(BaseModel):
    """The ``[camera]`` of a camera file or recipe."""

    model_config = ConfigDict(extra="forbid")

    focal_length: Length
    pixel_pitch: Pitch
    aperture_diameter: Length | None = None
    f_number: float | None = None
    focus_distance: Length | None = None
    detector_distance: Length | None = None
    wavelength: Length = 550e-9

    def camera(self) -> Camera:
        """The camera, from whichever of the alternative keys is given (`Camera.of`)."""
        return Camera.of(**self.model_dump())


class CameraFile(BaseModel):
    """A whole camera file."""

    model_config = ConfigDict(extra="forbid")

    camera: CameraSettings


def read_toml(path: Path) -> dict[str, Any]:
    """The contents of a TOML file, or one sentence about what is wrong with it."""
    if not path.is_file():
        raise PsflutError(f"no file at {path}; check the path")
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise ValueError(f"it has more than {LARGEST_FILE} bytes")
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError, OSError) as error:
        raise PsflutError(f"{path} is not valid TOML ({error}); mend it there") from error


def read_camera(path: Path) -> Camera:
    """The camera that a TOML file describes.

    Raises
    ------
    PsflutError
        For a missing file, an unknown or missing key, a length without a unit, or an impossible camera.
    """
    contents = read_toml(path)
    try:
        return CameraFile.model_validate(contents).camera.camera()
    except ValidationError as error:
        raise refusal(str(path), error) from error
    except PsflutError as error:
        raise PsflutError(f"{path}: {error}") from error
