"""The whole story on a photograph: what `psflut demo` shows."""

import csv
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from psflut import capture, plots
from psflut.errors import PsflutError
from psflut.estimation import Estimate, Observation, estimate, for_any_scene
from psflut.files import staged
from psflut.noise import Noise
from psflut.photographs import shipped
from psflut.store import read_table
from psflut.table import PSFTable

Floats = NDArray[np.floating]

SEED = 7
HEADINGS = ("set-up", "truth", "method", "estimate", "95 % interval", "outcome", "seconds")


@dataclass(frozen=True)
class Act:
    """One set-up of the story: a shipped table, distances off its grid (metres), the side of the patch."""

    table: str
    words: str
    distances: tuple[float, ...]
    side: int
    noise: str


ACTS = (
    Act("lab16mm", "plain imager, read noise 0.005", (1.07, 1.63, 2.41), 128, "0.005"),
    Act("thesis", "Laplacian imager scaled to [0, 1], noise variance 1e-3", (3.43, 3.87, 4.29), 192, "variance:1e-3"),
)
STEPS = sum(len(act.distances) for act in ACTS) * len(for_any_scene())


def run(folder: Path) -> Iterator[tuple[str, ...]]:
    """Play the story and write its figures; yields a row of words (`HEADINGS`) for every estimate.

    Raises
    ------
    PsflutError
        If the folder cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise PsflutError(f"cannot make the folder {folder}: {error.strerror}; choose another with -o") from error
    scene = photograph()
    rows = []
    for act in ACTS:
        for row in _play(act, scene, folder):
            rows.append(row)
            yield row
    with staged(folder / "results.csv", overwrite=True) as stage, stage.open("w", newline="") as file:
        csv.writer(file).writerows([HEADINGS, *rows])


def photograph() -> Floats:
    """A photograph from scikit-image, shrunk two-fold so that its own blur is small: (256, 256)."""
    return shipped("camera")


def _play(act: Act, scene: Floats, folder: Path) -> Iterator[tuple[str, ...]]:
    table = read_table(act.table)
    plots.save(plots.psfs(table), folder / f"{act.table}-psfs.png")
    images, noises = zip(*(_capture(act, table, scene, z) for z in act.distances), strict=True)
    patches = [image[_centre(image.shape[0], act.side)] for image in images]
    setup = capture.setup_of(table)
    ideal = capture.ideal_image(scene, setup)
    named = {f"object at {z:g} m": image for z, image in zip(act.distances, images, strict=True)}
    sharp = {"scene": scene} if setup.imager == "plain" else {"scene": scene, "ideal image": ideal}
    figure = plots.pictures({**sharp, **named}, f"{act.table}: {act.words}", columns=5)
    plots.save(figure, folder / f"{act.table}-captures.png")
    results: dict[str, list[Estimate]] = {}
    for method in for_any_scene():
        for patch, noise, truth in zip(patches, noises, act.distances, strict=True):
            found = estimate(Observation(patch, noise), table, method)
            results.setdefault(method, []).append(found)
            yield _row(act, truth, method, found)
    plots.save(plots.curves(results, act.distances), folder / f"{act.table}-estimates.png")
    plots.save(_restorations(act, ideal, patches, results), folder / f"{act.table}-restored.png")


def _capture(act: Act, table: PSFTable, scene: Floats, distance: float) -> tuple[Floats, Noise | None]:
    setup = replace(capture.setup_of(table), noise=act.noise)
    return capture.simulate(scene, table, distance, setup, SEED)


def _restorations(act: Act, ideal: Floats, patches: list[Floats], results: dict[str, list[Estimate]]) -> Any:
    middle = len(patches) // 2
    shown = {"ideal image": ideal[_centre(ideal.shape[0], act.side)], "capture": patches[middle]}
    shown |= {
        f"{method}, {found[middle].distance:.2f} m": found[middle].detail["restored"]
        for method, found in results.items()
        if "restored" in found[middle].detail
    }
    return plots.pictures(shown, f"{act.table}: restored from the capture at {act.distances[middle]} m", columns=6)


def _centre(total: int, side: int) -> tuple[slice, slice]:
    middle = slice((total - side) // 2, (total + side) // 2)
    return middle, middle


def _row(act: Act, truth: float, method: str, found: Estimate) -> tuple[str, ...]:
    near, far = found.interval
    return (
        act.table,
        f"{truth:.2f} m",
        method,
        f"{found.distance:.3f} m",
        f"{near:.3f} .. {far:.3f} m",
        found.outcome.name.lower(),
        f"{found.stats['seconds']:.2f}",
    )
