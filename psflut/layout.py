"""A table as arrays and attributes, the way `psflut.store` keeps them: what is written, and what is believed of it."""

import dataclasses
import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError

from psflut import __version__, family
from psflut.errors import PsflutError, refusal
from psflut.noise import Noise
from psflut.optics import Camera
from psflut.table import PSFTable

FORMAT, VERSION = "psflut-table", 1

PLANES, AXIS = ("distance", "y", "x"), ("distance",)
DIMENSIONS = {"psf": PLANES, "distance": AXIS, "y": ("y",), "x": ("x",), "psf_std": PLANES, "distance_std": AXIS}
DIMENSIONS["psf_modes"] = ("mode", *PLANES)
OPTIONAL = ("psf_std", "distance_std", "psf_modes")
LONG_NAMES = {
    "psf": "point spread function",
    "psf_std": "standard error of the point spread function",
    "psf_modes": "what PSFs differ by from point to point, a standard deviation each",
    "distance": "object distance",
    "distance_std": "standard error of the distance",
    "y": "offset from the centre on the detector, down",
    "x": "offset from the centre on the detector, to the right",
}


class Header(BaseModel):
    """The attributes that the arrays need, of the kinds that JSON has; what it does not name is kept as it is."""

    model_config = ConfigDict(strict=True)

    axis: Literal["distance", "stage"]
    camera: dict[str, float] | None
    imager: str
    noise: dict[str, float | None] | None
    provenance: dict[str, Any]
    check: dict[str, Any] | None
    sha256: dict[str, str]


def arrays_of(table: PSFTable) -> dict[str, NDArray[Any]]:
    """The arrays of a table, by name."""
    offset = (np.arange(table.size) - table.size // 2) * table.pixel_pitch
    arrays: dict[str, NDArray[Any]] = {
        "psf": table.psf.astype("<f4"),
        "distance": table.axis.astype("<f8"),
        "y": offset,
        "x": offset,
    }
    if table.psf_std is not None:
        arrays["psf_std"] = table.psf_std.astype("<f4")
    if table.psf_modes is not None:
        arrays["psf_modes"] = table.psf_modes.astype("<f4")
    if table.axis_std is not None:
        arrays["distance_std"] = table.axis_std.astype("<f8")
    return arrays


def long_name(name: str, table: PSFTable) -> str:
    """What an array is, in words."""
    return "stage coordinate" if name == "distance" and table.kind == "stage" else LONG_NAMES[name]


def attributes_of(table: PSFTable) -> dict[str, Any]:
    """The attributes of a table but its checksums, as JSON has them; dated by SOURCE_DATE_EPOCH alone."""
    provenance: dict[str, Any] = {**table.provenance, "psflut": __version__}
    if "SOURCE_DATE_EPOCH" in os.environ:
        provenance["date"] = int(os.environ["SOURCE_DATE_EPOCH"])
    attributes = {
        "format": FORMAT,
        "version": VERSION,
        "axis": table.kind,
        "camera": dataclasses.asdict(table.camera) if table.camera else None,
        "imager": table.imager,
        "noise": dataclasses.asdict(table.noise) if table.noise else None,
        "provenance": provenance,
        "check": table.check,
    }
    return plain(attributes)


def plain(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """As JSON gives it back: tuples are lists, numbers are plain."""
    found: dict[str, Any] = json.loads(json.dumps(attributes))
    return found


def sums(arrays: Mapping[str, NDArray[Any]], attributes: Mapping[str, Any]) -> dict[str, str]:
    """The sha256 of every array (little-endian, C order), and of the other attributes' canonical JSON."""
    kept = {key: value for key, value in attributes.items() if key not in ("sha256", "complete")}
    text = json.dumps(kept, sort_keys=True)
    found = {name: np.ascontiguousarray(a, dtype=a.dtype.newbyteorder("<")).tobytes() for name, a in arrays.items()}
    return {name: hashlib.sha256(data).hexdigest() for name, data in {**found, "attributes": text.encode()}.items()}


def check_attributes(path: Path, attributes: Mapping[str, Any]) -> None:
    """Refuse a group that is no whole table of this version.

    Raises
    ------
    PsflutError
        Naming the table, and the attribute that is wrong.
    """
    if attributes.get("format") != FORMAT:
        raise PsflutError(f"{path} is a Zarr group but no psflut table; build one with 'psflut build'")
    if attributes.get("version") != VERSION or attributes["version"] is True:
        raise PsflutError(
            f"{path} is of version {attributes.get('version')!r}, this psflut reads {VERSION}; build the table again"
        )
    if attributes.get("complete") is not True:
        raise PsflutError(f"{path} is not complete; build it again")

    try:
        Header.model_validate(dict(attributes))
        TypeAdapter(Camera | None).validate_python(attributes["camera"])
        TypeAdapter(Noise | None).validate_python(attributes["noise"])
        family.parse("psflut.imagers", attributes["imager"])
    except ValidationError as error:
        raise PsflutError(f"{refusal(str(path), error)}; build the table again") from error
    except PsflutError as error:
        raise PsflutError(f"{path}: {error}") from error


def table_of(attributes: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> PSFTable:
    """The table of attributes that `check_attributes` took, and of arrays.

    Raises
    ------
    PsflutError
        If the arrays do not make a table.
    """
    for name, values in arrays.items():
        kind = "f4" if name.startswith("psf") else "f8"
        if values.dtype != np.dtype(kind):
            raise PsflutError(f"its {name} holds values of the kind {values.dtype}, expected {kind}; build it again")
    psf, std, x, y = arrays["psf"].astype(np.float64), arrays.get("psf_std"), arrays["x"], arrays["y"]
    sums = psf.sum(axis=(1, 2), keepdims=True)
    if not np.all(np.abs(sums - 1.0) < 1e-4):
        raise PsflutError("every PSF of a table must be finite and sum to 1; build it again")
    size, pitch = psf.shape[-1], float(x[-1] - x[0]) / max(x.size - 1, 1)
    offset = (np.arange(size) - size // 2) * pitch
    if not all(each.shape == (size,) and np.allclose(each, offset, rtol=0, atol=1e-6 * abs(pitch)) for each in (x, y)):
        raise PsflutError("its y and x are not the offsets of square pixels from the PSF's centre; build it again")
    camera = Camera(**attributes["camera"]) if attributes["camera"] else None
    if camera and abs(camera.pixel_pitch - pitch) > 1e-6 * pitch:
        raise PsflutError(f"its camera has pixels of {camera.pixel_pitch} m, its PSFs of {pitch} m; build it again")
    return PSFTable(
        axis=arrays["distance"],
        psf=psf / sums,  # single precision leaves 1e-7
        pixel_pitch=pitch,
        kind=attributes["axis"],
        camera=camera,
        imager=attributes["imager"],
        noise=Noise(**attributes["noise"]) if attributes["noise"] else None,
        psf_std=None if std is None else std.astype(np.float64),
        axis_std=arrays.get("distance_std"),
        psf_modes=arrays["psf_modes"].astype(np.float64) if "psf_modes" in arrays else None,
        provenance=attributes["provenance"],
        check=attributes["check"],
    )
