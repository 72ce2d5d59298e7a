"""Tables on disk: a Zarr v3 group, as a folder ``x.zarr`` or one file ``x.zarr.zip``.

The format is described in ``tables/README.md``. Nothing is read on trust: the folder or archive is looked over before
it is opened, sizes are checked before memory is asked for, and the sha256 of every array and of the attributes is
checked; ``complete`` is written last.
"""

import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.codecs import BloscCodec, Crc32cCodec
from zarr.storage import LocalStore, ZipStore

from psflut import layout
from psflut.container import LARGEST, look_over
from psflut.errors import PsflutError
from psflut.files import pack, refuse_overwrite, staged
from psflut.layout import DIMENSIONS, OPTIONAL, PLANES, VERSION
from psflut.table import PSFTable

SHIPPED = (Path(__file__).parent / "tables", Path(__file__).parent.parent / "tables")
"""Where built tables lie in an installed package, and in a checkout."""


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
        raise PsflutError(f"a table's name ends in .zarr or .zarr.zip, got {path.name}; add the ending")
    refuse_overwrite(path, overwrite)


def write_table(table: PSFTable, path: Path, overwrite: bool = False) -> None:
    """Write a table whole or not at all.

    Raises
    ------
    PsflutError
        If `path` does not end in .zarr or .zarr.zip, exists without `overwrite`, or cannot be written.
    """
    check_target(path, overwrite)
    check_size(path, {name: values.shape for name, values in layout.arrays_of(table).items()})
    with staged(path, overwrite) as stage:
        if path.name.endswith(".zarr"):
            _write_group(table, stage)
        else:
            folder = stage.with_name("folder")
            _write_group(table, folder)
            pack(folder, stage)


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
    look_over(path)
    try:
        with LocalStore(path, read_only=True) if path.is_dir() else ZipStore(path, mode="r") as store:
            attributes, arrays = _read_group(path, store)
    except PsflutError:
        raise
    except Exception as error:  # of zarr, its codecs and JSON, which share no base class
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise PsflutError(f"{path} is not a readable table ({reason}); build it again") from error
    found = layout.sums(arrays, attributes)
    for name in found:
        if attributes["sha256"].get(name) != found[name]:
            raise PsflutError(f"{path} is damaged: the checksum of its {name} does not fit; build it again")
    try:
        return layout.table_of(attributes, arrays)
    except PsflutError as error:
        raise PsflutError(f"{path} holds no table: {error}") from error


def check_size(path: Path, shapes: dict[str, tuple[int, ...]]) -> None:
    """Refuse arrays that are too large, before they are made or read."""
    for name, shape in shapes.items():
        if math.prod(shape) > LARGEST:
            sides = " x ".join(map(str, shape))
            raise PsflutError(f"{path}: {name} has {sides} values, more than {LARGEST}; use fewer or smaller planes")


def _write_group(table: PSFTable, folder: Path) -> None:
    arrays, attributes = layout.arrays_of(table), layout.attributes_of(table)
    group = zarr.create_group(LocalStore(folder), zarr_format=3)
    for name, values in arrays.items():
        planes = DIMENSIONS[name][-3:] == PLANES
        array = group.create_array(
            name,
            shape=values.shape,
            dtype=values.dtype,
            chunks=(*[1] * (values.ndim - 2), *values.shape[-2:]) if planes else values.shape,
            compressors=(BloscCodec(cname="zstd", shuffle="shuffle"), Crc32cCodec()),
            fill_value=np.nan,
            dimension_names=DIMENSIONS[name],
            attributes={"units": "1" if name.startswith("psf") else "m", "long_name": layout.long_name(name, table)},
        )
        if planes:
            for index in np.ndindex(values.shape[:-2]):
                array[index] = values[index]
        else:
            array[:] = values
    group.attrs.update({**attributes, "sha256": layout.sums(arrays, attributes), "complete": True})


def _read_group(path: Path, store: LocalStore | ZipStore) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # zarr's note on numcodecs
        group = zarr.open_group(store, mode="r")
        attributes = layout.plain(dict(group.attrs))
        layout.check_attributes(path, attributes)
        present = dict(group.arrays())
        _check_arrays(path, group, present)
        return attributes, {name: np.asarray(array[:]) for name, array in present.items()}


def _check_arrays(path: Path, group: zarr.Group, present: dict[str, Any]) -> None:
    unknown = sorted(set(present) - set(DIMENSIONS)) + sorted(name for name, _ in group.groups())
    missing = sorted(set(DIMENSIONS) - set(OPTIONAL) - set(present))
    if unknown or missing:
        raise PsflutError(
            f"{path} has unknown arrays {unknown} and lacks {missing}; this psflut reads version {VERSION} only"
        )
    for name, array in present.items():
        found = array.metadata.dimension_names
        if found != DIMENSIONS[name]:
            raise PsflutError(
                f"{path}: {name} has dimensions {found}, expected {DIMENSIONS[name]}; this psflut reads no others"
            )
        if any(chunk > side for chunk, side in zip(array.chunks, array.shape, strict=True)):
            raise PsflutError(f"{path}: {name} has chunks of {array.chunks}, larger than itself; build it again")
    check_size(path, {name: array.shape for name, array in present.items()})
