"""Tables on disk: a Zarr v3 group, as a folder ``x.zarr`` or one file ``x.zarr.zip``.

The format is described in ``tables/README.md``. Nothing is read on trust: the sha256 of every array and of the
attributes is checked, and ``complete`` is written last.
"""

import dataclasses
import hashlib
import json
import os
import tempfile
import warnings
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.codecs import BloscCodec, Crc32cCodec
from zarr.storage import LocalStore, ZipStore

from psflut import __version__
from psflut.errors import PsflutError
from psflut.files import pack, refuse_overwrite, staged
from psflut.noise import Noise
from psflut.optics import Camera
from psflut.table import PSFTable

FORMAT, VERSION = "psflut-table", 1
SHIPPED = (Path(__file__).parent / "tables", Path(__file__).parent.parent / "tables")
"""Where built tables lie in an installed package, and in a checkout."""

PLANES, AXIS = ("distance", "y", "x"), ("distance",)
ARRAYS = {"psf": PLANES, "distance": AXIS, "y": ("y",), "x": ("x",), "psf_std": PLANES, "distance_std": AXIS}
ARRAYS["psf_modes"] = ("mode", *PLANES)
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
ATTRIBUTES = ("format", "version", "axis", "camera", "imager", "noise", "provenance", "check")


def find_table(name: str | Path) -> Path:
    """The path of a table given as a path, or as the bare name of one that ships."""
    path, bare = Path(name), Path(name).name == str(name)
    # A folder of results may bear a shipped table's name.
    if path.is_file() or (path / "zarr.json").is_file():
        return path
    for folder in SHIPPED:
        if bare and (folder / f"{name}.zarr.zip").is_file():
            return folder / f"{name}.zarr.zip"
    if path.exists() and str(name):
        return path
    names = sorted({p.name.removesuffix(".zarr.zip") for f in SHIPPED for p in f.glob("*.zarr.zip")})
    raise PsflutError(f"no table at {name}; give a path, or a shipped table: {', '.join(names)}")


def check_target(path: Path, overwrite: bool) -> None:
    """Refuse, before the work of building, a path that `write_table` would refuse after it."""
    if not path.name.endswith((".zarr", ".zarr.zip")):
        raise PsflutError(f"a table's name ends in .zarr or .zarr.zip, got {path.name}")
    refuse_overwrite(path, overwrite)


def write_table(table: PSFTable, path: Path, overwrite: bool = False) -> None:
    """Write a table whole or not at all.

    Raises
    ------
    PsflutError
        If `path` does not end in .zarr or .zarr.zip, exists without `overwrite`, or cannot be written.
    """
    check_target(path, overwrite)
    with staged(path, overwrite) as stage:
        if path.name.endswith(".zarr"):
            _write_group(table, stage)
        else:
            with tempfile.TemporaryDirectory(dir=path.parent, prefix=".psflut-") as folder:
                _write_group(table, Path(folder))
                pack(Path(folder), stage)


def read_table(name: str | Path) -> PSFTable:
    """Read a table and check all of it.

    Parameters
    ----------
    name : str or Path
        A path, or the bare name of a table that ships.

    Raises
    ------
    PsflutError
        For anything that is not a complete, undamaged table of version 1.
    """
    path = find_table(name)
    try:
        store = LocalStore(path, read_only=True) if path.is_dir() else ZipStore(path, mode="r")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # zarr's note on numcodecs
            group = zarr.open_group(store, mode="r")
            attributes = _plain(dict(group.attrs))
            _check_attributes(path, attributes)
            arrays = _read_arrays(path, group)
    except PsflutError:
        raise
    except (OSError, KeyError, ValueError, TypeError, RuntimeError, zipfile.BadZipFile) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise PsflutError(f"{path} is not a readable table ({reason}); build it again") from error
    _check_sums(path, attributes, arrays)
    try:
        return _table(attributes, arrays)
    except (TypeError, KeyError, AttributeError) as error:
        raise PsflutError(f"{path} has attributes that do not fit a table ({error}); build it again") from error


def _write_group(table: PSFTable, folder: Path) -> None:
    arrays = _arrays(table)
    group = zarr.create_group(LocalStore(folder), zarr_format=3)
    for name, values in arrays.items():
        planes = ARRAYS[name][-3:] == PLANES
        array = group.create_array(
            name,
            shape=values.shape,
            dtype=values.dtype,
            chunks=(*[1] * (values.ndim - 2), *values.shape[-2:]) if planes else values.shape,
            compressors=(BloscCodec(cname="zstd", shuffle="shuffle"), Crc32cCodec()),
            fill_value=np.nan,
            dimension_names=ARRAYS[name],
            attributes={
                "units": "1" if name.startswith("psf") else "m",
                "long_name": _long_name(name, table),
            },
        )
        if planes:
            for index in np.ndindex(values.shape[:-2]):
                array[index] = values[index]
        else:
            array[:] = values
    attributes = _attributes(table)
    sums = {name: _sha256(values) for name, values in arrays.items()}
    sums["attributes"] = _sha256_json(attributes)
    group.attrs.update({**attributes, "sha256": sums, "complete": True})


def _arrays(table: PSFTable) -> dict[str, NDArray[Any]]:
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


def _long_name(name: str, table: PSFTable) -> str:
    return "stage coordinate" if name == "distance" and table.kind == "stage" else LONG_NAMES[name]


def _attributes(table: PSFTable) -> dict[str, Any]:
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
    return _plain(attributes)


def _plain(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """As JSON gives it back: tuples are lists, numbers are plain."""
    plain: dict[str, Any] = json.loads(json.dumps(attributes))
    return plain


def _check_attributes(path: Path, attributes: Mapping[str, Any]) -> None:
    if attributes.get("format") != FORMAT:
        raise PsflutError(f"{path} is a Zarr group but no psflut table; build one with 'psflut build'")
    if attributes.get("version") != VERSION:
        raise PsflutError(f"{path} is of version {attributes.get('version')}, this psflut reads {VERSION}")
    if attributes.get("complete") is not True:
        raise PsflutError(f"{path} is not complete; build it again")


def _read_arrays(path: Path, group: zarr.Group) -> dict[str, NDArray[Any]]:
    present = dict(group.arrays())
    unknown = sorted(set(present) - set(ARRAYS)) + sorted(name for name, _ in group.groups())
    missing = sorted(set(ARRAYS) - set(OPTIONAL) - set(present))
    if unknown or missing:
        raise PsflutError(
            f"{path} has unknown arrays {unknown} and lacks {missing}; this psflut reads version {VERSION} only"
        )
    for name, array in present.items():
        if array.metadata.dimension_names != ARRAYS[name]:  # type: ignore[union-attr]
            raise PsflutError(
                f"{path}: {name} has dimensions {array.metadata.dimension_names}, "  # type: ignore[union-attr]
                f"expected {ARRAYS[name]}; this psflut reads no others"
            )
    return {name: np.asarray(array[:]) for name, array in present.items()}


def _check_sums(path: Path, attributes: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
    expected = {name: _sha256(values) for name, values in arrays.items()}
    expected["attributes"] = _sha256_json({k: v for k, v in attributes.items() if k not in ("sha256", "complete")})
    stored = attributes.get("sha256")
    for name in expected:
        if not isinstance(stored, dict) or stored.get(name) != expected[name]:
            raise PsflutError(f"{path} is damaged: the checksum of its {name} does not fit; build it again")


def _table(attributes: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> PSFTable:
    psf = arrays["psf"].astype(np.float64)
    std = arrays.get("psf_std")
    x = arrays["x"]
    return PSFTable(
        axis=arrays["distance"],
        psf=psf / psf.sum(axis=(1, 2), keepdims=True),  # single precision leaves 1e-7
        pixel_pitch=float((x[-1] - x[0]) / (x.size - 1)) if x.size > 1 else float("nan"),
        kind=attributes["axis"],
        camera=Camera(**attributes["camera"]) if attributes["camera"] else None,
        imager=attributes["imager"],
        noise=Noise(**attributes["noise"]) if attributes["noise"] else None,
        psf_std=None if std is None else std.astype(np.float64),
        axis_std=arrays.get("distance_std"),
        psf_modes=arrays["psf_modes"].astype(np.float64) if "psf_modes" in arrays else None,
        provenance=attributes["provenance"],
        check=attributes["check"],
    )


def _sha256(values: NDArray[Any]) -> str:
    little = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<"))
    return hashlib.sha256(little.tobytes()).hexdigest()


def _sha256_json(attributes: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(attributes, sort_keys=True).encode()).hexdigest()
