"""Maps of distance as files: Zarr for xarray, 32-bit TIFF, PNG; each whole or not at all."""

import json
import warnings
from pathlib import Path

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.codecs import BloscCodec, Crc32cCodec

from psflut.batch import OUTCOMES
from psflut.depthmaps import DepthMap
from psflut.errors import PsflutError
from psflut.estimation import Outcome
from psflut.files import refuse_overwrite, staged

SUFFIXES = (".zarr", ".tif", ".tiff", ".png")
PAGES = ("distance", "near", "far", "near_wide", "far_wide", "distance_smooth")
"""Of a TIFF, for every frame; the last where the map was smoothed."""


def check_map(path: Path, overwrite: bool, frames: int = 1) -> None:
    """Refuse, before the work, a path that `write_map` would refuse after it."""
    if path.suffix.lower() not in SUFFIXES:
        raise PsflutError(f"a map's name ends in {', '.join(SUFFIXES)}, got {path.name}; choose one of them")
    if path.suffix.lower() == ".png" and frames > 1:
        raise PsflutError(f"{path.name} can show one frame, not {frames}; write a sequence as .zarr or .tif")
    refuse_overwrite(path, overwrite)


def write_map(found: DepthMap, path: Path, image: NDArray[np.floating] | None = None, overwrite: bool = False) -> None:
    """Write a map in the format that the name's ending tells.

    Parameters
    ----------
    image : (H, W) array or None
        The scene, to be shown beside a PNG's map.

    Raises
    ------
    PsflutError
        For another ending, several frames in a PNG, a path that exists without `overwrite` or cannot be written.
    """
    check_map(path, overwrite, 1 if found.time is None else len(found.time))
    if path.suffix.lower() == ".png":
        from psflut.plots import save  # only who draws pays for matplotlib

        save(found.figure(image), path, overwrite)
        return
    with staged(path, overwrite) as stage:
        if path.suffix.lower() == ".zarr":
            _write_zarr(found, stage)
        else:
            _write_tiff(found, stage)


def _write_zarr(found: DepthMap, folder: Path) -> None:
    """A Zarr v3 group for ``xarray.open_zarr``; a chunk a frame, as frames are read one by one."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # zarr's note on numcodecs
        group = zarr.create_group(folder, zarr_format=3)
        for name, (dimensions, values, attributes) in found.variables().items():
            array = group.create_array(
                name,
                shape=values.shape,
                dtype=values.dtype,
                chunks=(1, *values.shape[1:]) if "time" in dimensions and values.ndim > 1 else values.shape,
                compressors=(BloscCodec(cname="zstd", shuffle="shuffle"), Crc32cCodec()),
                fill_value=-1 if values.dtype.kind == "i" else np.nan,
                dimension_names=dimensions,
                attributes=attributes,
            )
            array[...] = values
        group.attrs.update({"format": "psflut-depthmap", "version": 1, **found.about, "complete": True})


def _write_tiff(found: DepthMap, path: Path) -> None:
    """Pages of float32 metres, those of `PAGES` for every frame; NaN where a patch is FLAT."""
    import tifffile

    values = {name: each for name, (_, each, _) in found.variables().items() if name in PAGES}
    flat = found.outcome == OUTCOMES.index(Outcome.FLAT)
    pages = {name: np.where(flat, np.nan, values[name]).astype(np.float32) for name in PAGES if name in values}
    grid = found.distance.shape[-2:]
    with tifffile.TiffWriter(path) as file:
        for frame in range(found.distance.size // (grid[0] * grid[1])):
            for name, array in pages.items():
                words = json.dumps({"page": name, "frame": frame, "units": "m", **found.about}, sort_keys=True)
                file.write(array.reshape(-1, *grid)[frame], description=words, metadata=None, contiguous=False)
