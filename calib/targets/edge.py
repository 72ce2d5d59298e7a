"""Straight edges between black and white: a symmetric PSF straight from the samples beside them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.rings import Rings, smooth_fit
from calib.targets import Measurement, Shot, Target
from psflut.edges import Sampled, Search
from psflut.errors import PsflutError
from psflut.imagers import Imager
from psflut.units import format_length

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Edge(Search, Target):
    """Straight edges at any angle, one or several in a frame, sampled clear of corners and of each other.

    The optics' PSF is p(r) = sum a_j hat(r / d - j) with a_j >= 0 (`calib.rings`). With A_j the share of ring j
    on the bright side of an edge at a distance s, a pixel shows

        y(s) = low + step * sum_j a_j (L * box * A_j)(s),

    box being the pixel and L the imager's kernel, both turned with the edge. So nothing is differentiated, and a
    signed imager is not inverted: its kernel is in the model. The a_j of all edges and shots together are
    a regularised least-squares fit, whose smoothness the data choose (`calib.rings.smooth_fit`).

    Assumed: a rotationally symmetric PSF, the same along an edge; no light beyond 3 sigma + 2 pixels of the
    spread, sigma being that of the normal distribution nearest to it; white noise; even light on either side.
    An edge exactly along a row has one phase of sampling only, and leaves more of the PSF to the smoothness.
    PSF and standard error are mean and scatter of draws that are not negative either. Errors were 1.0 to 1.4 times
    the stated ones where blur is wider than 2 pixels in radius, and 0.7 to 1.5 times nearer to focus, where a_j >= 0
    and the smoothness decide. Half of an error is what the smoothness hides, the same at neighbouring distances: a
    table that averaged it away stated errors too small by 1.2 to 1.7.

    Its settings say what counts as an edge: see `psflut.edges.Search`.
    """

    def measure(self, shots: Sequence[Shot], size: int, imager: Imager) -> Measurement:
        """See `Target`."""
        edges, rejected = [], []
        for shot in shots:
            used, refused = self.edges(shot.image, size, imager, shot.centre)
            edges += used
            rejected += [f"{shot.name}: {reason}" for reason in refused]
        if not edges:
            why = "; ".join(rejected[:3]) or "no straight edge found"
            raise PsflutError(f"no edge can be used at {format_length(shots[0].position)}: {why}; look at the frames")
        psf, std, hidden = _solve(edges, size, imager.kernel())
        return Measurement(psf, std, len(edges), tuple(rejected), hidden)


def _solve(edges: Sequence[Sampled], size: int, kernel: Floats) -> tuple[Floats, Floats, Floats]:
    """The PSF, its standard error and what of that smoothness hides, (size, size), from all edges together."""
    reach = max(edge.reach for edge in edges)
    width = float(np.clip(reach / 32.0, 0.15, 0.5))
    rings = Rings(int(reach / width), width)
    seen = [rings.seen(edge.distance, edge.line.angle, kernel) for edge in edges]
    sigma = max(edge.line.sigma for edge in edges)
    heights = np.exp(-0.5 * (width * np.arange(rings.count) / sigma) ** 2)
    nuisances = sum(2 * edge.light.shape[1] for edge in edges)
    for _ in range(3):  # the light of the edges in turn with the PSF
        parts = [
            _lit(edge, shown, shown @ heights / (rings.mass @ heights)) for edge, shown in zip(edges, seen, strict=True)
        ]
        design, data = (np.concatenate(part) for part in zip(*parts, strict=True))
        heights, draws, hidden = smooth_fit(design, data, rings.bend, nuisances, _blocks(edges))
    planes = rings.planes(size)
    drawn, unseen = (np.einsum("yxi,ni->nyx", planes, each, optimize=True) for each in (draws, hidden))
    drawn, unseen = (each / each.sum(axis=(1, 2), keepdims=True) for each in (drawn, unseen))
    return drawn.mean(axis=0), drawn.std(axis=0), unseen.std(axis=0)


def _lit(edge: Sampled, seen: Floats, shape: Floats) -> tuple[Floats, Floats]:
    """What the rings show in the light that suits a shape best, and the samples, both less the low level."""
    light = edge.light
    step = light @ np.linalg.lstsq(np.hstack([light, light * shape[:, None]]), edge.values)[0][light.shape[1] :]
    low = np.linalg.qr(light)[0]
    design = seen * step[:, None]
    return design - low @ (low.T @ design), edge.values - low @ (low.T @ edge.values)


def _blocks(edges: Sequence[Sampled]) -> NDArray[np.int_]:
    """Of every sample the number of its edge, or of a part of its edge where there are fewer than four."""
    parts = -(-4 // len(edges))
    within = [np.minimum((0.5 * (edge.along + 1.0) * parts).astype(int), parts - 1) for edge in edges]
    return np.concatenate([number * parts + part for number, part in enumerate(within)])
