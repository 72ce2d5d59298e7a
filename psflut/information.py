"""Fisher's information of distance in a patch, for three kinds of scene; `psflut.limits` makes bounds of it.

Each is taken in the table's even coordinate e (vergence in 1/m, or stage in m), at M positions, with what is not known
of the scene projected out. The noise of `known` and `point` is Gaussian, its variance taken as known.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.interpolate import CubicSpline, interp1d

from psflut.ensemble import Sensor, Textures
from psflut.fourier import transfer
from psflut.table import PSFTable

Floats = NDArray[np.float64]


def of_texture(scenes: Textures, sensor: Sensor) -> Floats:
    """(M, D) information of the annuli's powers, the prior on the spectrum being all that is known of a scene; linear
    in the logarithm between the ensemble's `places`.

    With s_k = S_k |L|^2_k T_k / V_k and X = s [d ln T / de, P_0 .. P_J], (K, 1 + J), it is X' C^-1 X, C the relative
    covariance of the powers; the prior's precision is added to the block of the coefficients, which is projected out.
    That is the expected curvature of the log evidence, but for the correlation of neighbours that the evidence leaves
    out; powers are so nearly normal in the logarithm that what V tells by their variance is left out too.
    """
    bank, prior = scenes.bank, scenes.bank.prior
    scatter = scenes.scatter(sensor) + np.diag(prior.unevenness(bank.rings.place))
    order = np.argsort(bank.even)
    slopes = CubicSpline(bank.even[order], bank.attenuation[order])(bank.even, 1)
    rows = []
    for position, inverse in zip(scenes.places, np.linalg.inv(scatter), strict=True):
        kept, slope = bank.attenuation[position], slopes[position]
        noise = scenes.noise(sensor, position)
        mean = (scenes.spectra * kept + noise)[..., None]
        towards = np.column_stack([slope, kept[:, None] * bank.basis])
        change = scenes.spectra[..., None] * towards / mean
        weighted = np.tensordot(change, inverse, (1, 0))  # (D, 1 + J, K), in one product
        found = weighted @ change
        rows.append(_projected(found, prior.precision))
    told = np.log(np.maximum(rows, np.finfo(float).tiny))
    return np.asarray(np.exp(interp1d(scenes.places, told, axis=0)(np.arange(len(bank.even)))))


def of_known_scene(scenes: Textures, sensor: Sensor) -> Floats:
    """(M, D) information of a patch of a scene that is known, also beyond the border: sum of S |L dH/de|^2 / N."""
    rings = scenes.bank.rings
    bins = np.bincount(rings.index.ravel(), _twice(scenes.shape).ravel())[:-1]
    response = sensor.imager.transfer(scenes.shape) ** 2
    rows = []
    for position, even in enumerate(scenes.bank.even):
        change = np.abs(transfer(_slope(scenes.table, even), scenes.shape)) ** 2
        told = bins * scenes.spectra * rings.mean(response * change)
        rows.append(np.sum(told * scenes.bank.white / scenes.noise(sensor, position), axis=1))
    return np.array(rows)


def of_point(table: PSFTable, shape: tuple[int, int], sensor: Sensor, peak: float, count: int) -> Floats:
    """(M, 1) information of a lone point in the middle of a dark patch: light, place and background are not known.

    Its light is such that at the sharpest of the positions its brightest pixel has that peak.
    """
    positions = table.candidates(count)
    planes = table.at(positions)
    light = peak / planes.max()
    kernel, steps = sensor.imager.kernel(), (fft.fftfreq(shape[0])[:, None], fft.rfftfreq(shape[1]))
    filtered, squared = transfer(kernel, shape).real, transfer(kernel**2, shape).real
    rows = []
    for plane, even in zip(planes, table.even(positions), strict=True):
        shown, moved = light * filtered * transfer(np.stack([plane, _slope(table, even)]), shape)
        nuisance = [shown, *(2j * np.pi * step * shown for step in steps)]
        columns = fft.irfft2(np.stack([moved, *nuisance]), s=shape).reshape(4, -1)
        columns = np.concatenate([columns, np.ones_like(columns[:1])])
        glow = fft.irfft2(squared * transfer(light * plane, shape), s=shape).ravel()
        noise = sensor.power(1.0, glow, columns[1].var())
        rows.append(_projected((columns / noise) @ columns.T, np.zeros((4, 4))))
    return np.array(rows)[:, None]


def _projected(information: Floats, prior: Floats) -> Floats:
    """What (..., 1 + J, 1 + J) tells of the first parameter once the others, with their prior's, are projected out."""
    cross = information[..., 1:, :1]
    others = np.linalg.solve(information[..., 1:, 1:] + prior, cross)
    return np.asarray(np.maximum(information[..., 0, 0] - np.sum(cross * others, axis=(-2, -1)), 0.0))


def _slope(table: PSFTable, even: float) -> Floats:
    """d PSF / d even (K, K); for a distance z = 1 / e, d/de = -z^2 d/dz."""
    position = np.clip(table.position(even), *table.span)
    chain = -(position**2) if table.kind == "distance" else 1.0
    return np.asarray(table.derivative(position) * chain)


def _twice(shape: tuple[int, int]) -> Floats:
    """How many bins of the whole plane each of the half plane stands for: 1 where the half holds its mirror, else 2."""
    column = np.arange(shape[1] // 2 + 1)
    return np.where((column == 0) | (2 * column == shape[1]), 1.0, 2.0) * np.ones((shape[0], 1))
