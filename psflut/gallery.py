"""The figures of a comparison, numbered as in the thesis, for every method."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from psflut import capture, family, plots
from psflut.compare import span_of
from psflut.errors import PsflutError
from psflut.estimation import Estimate, estimate
from psflut.limits import Limits, Scene, bound
from psflut.noise import parse_noise
from psflut.shots import Shot, Simulated
from psflut.trial import KNOWN, Bench, Record

LARGEST, PSF, TIMES = 6, "PSF", "times"
"""Positions of which transfer functions are drawn at most; with what the names of pictures of a PSF begin; the figure
that differs from run to run."""


def draw(bench: Bench, records: Sequence[Record], folder: Path) -> list[Path]:
    """Draw and save every figure that the comparison has the means for; their paths.

    Raises
    ------
    PsflutError
        If the folder cannot be made or written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise PsflutError(f"cannot make the folder {folder}: {error.strerror}; choose another with -o") from error
    paths = []
    for name, figure in (*_of_optics(bench), *_of_captures(bench), *_of_results(bench, records)):
        paths.append(folder / f"{name}.png")
        plots.save(figure, paths[-1])
    return paths


def _of_optics(bench: Bench) -> Iterator[tuple[str, Any]]:
    positions = bench.shots.positions
    some = [positions[k] for k in np.unique(np.linspace(0, len(positions) - 1, LARGEST).round().astype(int))]
    yield "2.5.3-2.5.4-otfs", plots.otfs(bench.table, some)
    imager = family.parse("psflut.imagers", _imager(bench))
    yield "5.1.1-filters", plots.filters(bench.table, positions[len(positions) // 2], imager)


def _of_captures(bench: Bench) -> Iterator[tuple[str, Any]]:
    """Of the first capture at the nearest, the middle and the farthest position."""
    count = len(bench.shots.positions)
    near, middle, far = (bench.shots.take(k, 0) for k in (0, count // 2, count - 1))
    if isinstance(bench.shots, Simulated) and middle.ideal is not None:
        name, scene = bench.shots.photographs[0]
        blurred = capture.simulate(
            scene, bench.table, middle.truth, replace(bench.shots.setup, noise=None, gain=None), 0
        )
        shown = {name: scene, "ideal image": capture.ideal_image(scene, bench.shots.setup)}
        shown |= {f"defocused, object at {middle.truth:.3g} m": blurred[0]}
        yield "4.1.2-4.1.3-images", plots.pictures(shown, "scene, ideal image and its defocused image (no noise)")
    ends = {f"{shot.source} at {shot.truth:.3g} m": shot.observation.image for shot in (near, far)}
    ends |= {f"{PSF} at {shot.truth:.3g} m": capture.psf_of(bench.table, shot.truth) for shot in (near, far)}
    title = "captures of the nearest and the farthest object, and their PSFs"
    yield "5.1.2-captures", plots.pictures(ends, title, 2, [name for name in ends if name.startswith(PSF)])
    found = {k: _estimates(bench, shot) for k, shot in enumerate((near, middle, far))}
    costs = {method: [result] for method, result in found[1].items()}
    yield "4.2.2-cost", plots.curves(costs, [middle.truth], plots.palette_of(bench.methods))
    shown = _restored((near, far), (found[0], found[2]))
    title = "what methods restored of the nearest and of the farthest object"
    yield (
        "5.2.1-restored",
        plots.pictures(shown, title, -(-len(shown) // 2), [name for name in shown if name.startswith(PSF)]),
    )


def _estimates(bench: Bench, shot: Shot) -> dict[str, Estimate]:
    """What every method makes of a capture."""
    told = replace(shot.observation, scene=shot.ideal)
    return {
        name: estimate(told if name.endswith(KNOWN) else shot.observation, bench.table, part, bench.level)
        for name, part in bench.methods.items()
    }


def _restored(shots: Sequence[Shot], found: Sequence[dict[str, Estimate]]) -> dict[str, Any]:
    """Ideal images, what methods restored without them, and the PSFs restored with that, at each position."""
    shown: dict[str, Any] = {}
    for shot, results in zip(shots, found, strict=True):
        at = f"{shot.truth:.3g} m"
        shown |= {f"ideal image, {at}": shot.ideal} if shot.ideal is not None else {}
        for name, result in results.items():
            if not name.endswith(KNOWN):
                parts = {"restored": f"{name}, {at}", "psf": f"{PSF} of {name}, {at}"}
                shown |= {title: result.detail[key] for key, title in parts.items() if key in result.detail}
    return shown


def _of_results(bench: Bench, records: Sequence[Record]) -> Iterator[tuple[str, Any]]:
    span, about, palette = span_of(bench.table), _about(bench), plots.palette_of(bench.methods)
    for known, numbers in ((False, ("5.2.2", "5.2.3", "5.2.4")), (True, ("5.2.5", "5.2.6", "5.2.7"))):
        some = [record for record in records if record.method.endswith(KNOWN) == known]
        if some:
            title = f"{about}; the ideal image is {'' if known else 'not '}known"
            limit = _bound(bench, "known" if known else "unknown")
            yield f"{numbers[0]}-estimates", plots.agreement(some, title, palette)
            yield f"{numbers[1]}-relative-errors", plots.relative_errors(some, span, title, palette)
            yield f"{numbers[2]}-scatter", plots.scatter(some, limit, title, palette)
    yield "reliability", plots.reliability(records, bench.level, span, about)
    yield TIMES, plots.times(records, about)


def _bound(bench: Bench, scene: Scene) -> Limits | None:
    """The Cramer-Rao bound of simulated captures, for the prior's median contrast; of real frames none."""
    shots = bench.shots
    if not isinstance(shots, Simulated) or shots.setup.noise is None:
        return None
    noise = replace(parse_noise(shots.setup.noise, np.array([-1.0, 1.0])), gain=shots.setup.gain)
    relative = shots.setup.noise.startswith("relative")  # to a capture of variance 1
    imager = family.parse("psflut.imagers", shots.setup.imager)
    return bound(bench.table, (shots.size, shots.size), noise, imager, scene=scene, relative=relative)


def _about(bench: Bench) -> str:
    """The captures in a few words."""
    if not isinstance(bench.shots, Simulated):
        return "real frames"
    setup, count = bench.shots.setup, len(bench.shots.photographs)
    scaled = ", scaled to [0, 1]" if setup.normalise else ""
    of = bench.shots.photographs[0][0] if count == 1 else f"{count} photographs"
    return f"{of}, {bench.shots.size} x {bench.shots.size} pixels, imager {setup.imager}{scaled}, noise {setup.noise}"


def _imager(bench: Bench) -> str:
    return bench.shots.setup.imager if isinstance(bench.shots, Simulated) else bench.table.imager
