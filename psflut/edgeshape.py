"""What a straight edge shows of a PSF between black and white: its spread, and its rise, summed up across it."""

from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from psflut.edges import Sampled
from psflut.imagers import Imager
from psflut.table import PSFTable

Floats = NDArray[np.float64]

HIGHEST, FREQUENCIES = 1.5, 160
"""Of spatial frequency, cycles a pixel, and nodes of the integral over it: enough for 40 pixels beside an edge."""


def columns_of(table: PSFTable, imager: Imager, positions: Floats, edge: Sampled) -> tuple[Floats, Floats]:
    """Orthonormal columns (M, n, 6) that light and shift may add; and of the middle position the step (n,)."""
    response = _response(table, imager, tuple(positions), edge.line.angle)
    frequency, weight = _nodes()
    wave = np.exp(2j * np.pi * frequency[:, None] * edge.distance)
    spread = 2.0 * np.real((response * weight) @ wave)
    rise = 2.0 * np.imag((response * (weight / (2.0 * np.pi * frequency))) @ wave)
    light = edge.light
    columns = [np.broadcast_to(light, (len(positions), *light.shape))]
    columns += [rise[:, :, None] * light, spread[:, :, None] * light]
    both = np.concatenate(columns, axis=2)
    of_step = slice(light.shape[1], 2 * light.shape[1])
    step = light @ np.linalg.lstsq(both[len(both) // 2], edge.values)[0][of_step]
    return np.asarray(np.linalg.qr(both)[0]), np.asarray(step)


def pull_of(edge: Sampled, imager: Imager, weight: Floats, size: int) -> Floats:
    """(K, K) how much light in a pixel of the PSF adds to the sum of an edge's samples, weighed (n,)."""
    frequency, node = _nodes()
    rows, columns = frequency * np.cos(edge.line.angle), frequency * np.sin(edge.line.angle)
    wave = np.exp(2j * np.pi * frequency[:, None] * edge.distance)
    kernel, half = imager.kernel(), np.arange(len(imager.kernel())) - len(imager.kernel()) // 2
    filtered = np.einsum("yx,fy,fx->f", kernel, _waves(rows, half), _waves(columns, half))
    sums = (wave @ weight) * node / (2.0 * np.pi * frequency) * filtered * _between(rows) * _between(columns)
    across = np.arange(size) - size // 2
    return np.asarray(2.0 * np.imag(np.einsum("f,fy,fx->yx", sums, _waves(rows, across), _waves(columns, across))))


@lru_cache(maxsize=64)
def _response(table: PSFTable, imager: Imager, positions: tuple[float, ...], angle: float) -> NDArray[np.complex128]:
    """Transfer function of PSF and imager along the normal of an edge: (M, FREQUENCIES)."""
    planes = signal.fftconvolve(table.at(positions), imager.kernel()[None], axes=(1, 2))
    across = np.arange(planes.shape[1]) - planes.shape[1] // 2
    rows, columns = _nodes()[0] * np.cos(angle), _nodes()[0] * np.sin(angle)
    seen = np.einsum("myx,fy,fx->mf", planes, _waves(rows, across), _waves(columns, across), optimize=True)
    return np.asarray(seen * _between(rows) * _between(columns))


def _waves(frequency: Floats, place: NDArray[np.int_]) -> NDArray[np.complex128]:
    return np.asarray(np.exp(-2j * np.pi * frequency[:, None] * place))


def _between(frequency: Floats) -> Floats:
    """Transfer function of the cubic spline through samples a pixel apart, beyond their Nyquist frequency too."""
    return np.asarray(np.sinc(frequency) ** 4 * 3.0 / (2.0 + np.cos(2.0 * np.pi * frequency)))


@cache
def _nodes() -> tuple[Floats, Floats]:
    """Gauss-Legendre nodes from 0 to `HIGHEST` cycles a pixel, and their weights."""
    node, weight = np.polynomial.legendre.leggauss(FREQUENCIES)
    return 0.5 * HIGHEST * (node + 1.0), 0.5 * HIGHEST * weight
