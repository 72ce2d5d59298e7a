"""From an image to the map of its distances: all pieces of the work, laid in their places."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from psflut import __version__
from psflut.depthmaps import DepthMap
from psflut.errors import PsflutError
from psflut.frames import Stack
from psflut.mapping import Done, Job, plan, solve
from psflut.noise import Noise
from psflut.relief import widened
from psflut.smoothing import smoothed
from psflut.table import PSFTable


def depthmap(
    image: NDArray[np.floating],
    table: PSFTable,
    *,
    size: int = 64,
    stride: int = 32,
    noise: Noise | None = None,
    imager: str | None = None,
    level: float = 0.95,
    smooth: bool = False,
    threads: int = 1,
) -> DepthMap:
    """Distances of all patches of an image, by the evidence (`psflut.estimators.wiener`).

    Parameters
    ----------
    image : (H, W) or (T, H, W) array
        Linear intensity, full scale 1.
    table : PSFTable
    size, stride : int
        Of the patches, pixels; what is left at the right and lower rim is not looked at.
    noise : Noise or None
        None: the table's, else one estimate from the middle of the (first) image.
    imager : str or None
        None: the table's.
    level : float
        Probability of the intervals.
    smooth : bool
        Also smooth the distances.
    threads : int
        Patches are shared out among so many; the result does not depend on it.

    Raises
    ------
    PsflutError
        As `Tiles` and `estimate` do.
    """
    array = np.asarray(image)
    if array.ndim not in (2, 3):
        raise PsflutError(f"an image is (H, W), a sequence (T, H, W), got the shape {array.shape}; give grey levels")
    job = plan(Stack(array.reshape(-1, *array.shape[-2:])), table, size, stride, noise, imager, level)
    return assemble(
        job, (solve(job, piece, threads) for piece in job.pieces()), smooth=smooth, sequence=array.ndim == 3
    )


def assemble(
    job: Job, done: Iterable[Done], *, smooth: bool = False, sequence: bool = True, rate: float | None = None
) -> DepthMap:
    """The map that all pieces of a job make, in whatever order they come."""
    rows, columns = job.tiles.grid
    shape = len(job.frames.names), rows, columns
    parts: dict[str, NDArray[Any]] = {
        name: np.empty((*shape, 2) if name == "interval" else shape, np.int8 if name == "outcome" else np.float64)
        for name in ("distance", "interval", "outcome", "misfit")
    }
    for piece, batch in done:
        for name, array in parts.items():
            own = array[piece.frame, piece.first : piece.last]
            own[...] = getattr(batch, name).reshape(own.shape)
    pairs = list(zip(parts["distance"], parts["interval"], strict=True))
    parts["wide"] = np.stack([widened(z, ends, job.table, job.level) for z, ends in pairs])
    if smooth:
        parts["smooth"] = np.stack([smoothed(z, ends, job.table, job.level) for z, ends in pairs])
    y, x = job.tiles.centres
    time = np.arange(shape[0]) / (rate or 1.0)
    one: dict[str, Any] = {name: array if sequence else array[0] for name, array in parts.items()}
    return DepthMap(y, x, **{"smooth": None, **one}, time=time if sequence else None, about=_about(job, rate))


def _about(job: Job, rate: float | None) -> dict[str, Any]:
    return {
        "psflut": __version__,
        "axis": job.table.kind,
        "span_m": list(job.table.span),
        "image_shape": list(job.tiles.shape),
        "size": job.tiles.size,
        "stride": job.tiles.stride,
        "noise": job.noise.read,
        "imager": job.imager,
        "level": job.level,
        "rate": rate,
    }
