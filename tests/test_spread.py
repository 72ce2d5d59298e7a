"""A table's own errors widen what is read from it, by as much as they move it."""

from dataclasses import replace

import numpy as np
import pytest

from psflut import capture
from psflut.estimation import Observation, Problem, estimate
from psflut.estimators.posterior import Posterior
from psflut.estimators.wiener import Wiener
from psflut.grid import grid
from psflut.gross import with_gross_errors
from psflut.imagers.plain import Plain
from psflut.noise import Noise
from psflut.table import PSFTable

NOISE = Noise(0.005)


def table_of(source, count):
    """Noiseless pupil PSFs of the camera behind `source`, evenly in vergence over its span."""
    axis = source.candidates(count)
    return PSFTable(axis, np.stack([capture.psf_of(source, z) for z in axis]), source.pixel_pitch)


def with_noise(table, share, seed):
    """Normal errors of `share` of each plane's peak in all pixels, cut off at zero and in the dark."""
    peak = table.psf.max(axis=(1, 2), keepdims=True)
    error = share * peak * np.random.default_rng(seed).standard_normal(table.psf.shape)
    seen = np.where(table.psf > 1e-3 * peak, np.maximum(table.psf + error, 0), 0)
    total = seen.sum(axis=(1, 2), keepdims=True)
    return replace(table, psf=seen / total, psf_std=share * peak / total * np.ones_like(seen))


def patch_at(source, scene, distance):
    return capture.simulate(scene, source, distance, capture.Setup(noise="0.005"), 3)[0][64:192, 64:192]


def look(image, table):
    return grid(Problem(image, table, Plain(), NOISE, "given", 0.95), 100)


def coverage(source, scene, tables, distances, level=0.9):
    """Share of intervals that hold the truth: widened, and, for control, with the table's errors left out."""
    images = [patch_at(source, scene, distance) for distance in distances]
    hits = []
    for table in tables:
        for image, distance in zip(images, distances, strict=True):
            found = look(image, table)
            hits.append(
                [
                    each.interval(level)[0] <= distance <= each.interval(level)[1]
                    for each in (found.density, found.exact)
                ]
            )
    return np.mean(hits, axis=0)


def test_pixel_errors_widen_intervals_to_cover_and_the_control_without_them_does_not(lab16mm, scene):
    clean = table_of(lab16mm, 16)
    tables = (with_noise(clean, 0.25, seed) for seed in range(8))
    widened, bare = coverage(lab16mm, scene, tables, (1.07, 1.3, 1.58, 2.2))
    assert widened > 0.8
    assert bare < widened - 0.15


def test_sparse_tables_cover_and_the_control_without_their_error_does_not(lab16mm, scene):
    widened, bare = coverage(lab16mm, scene, [table_of(lab16mm, 6)], 1 / np.linspace(0.35, 1.15, 24))
    assert widened > 0.8
    assert bare < widened - 0.15


def test_the_propagated_error_is_that_of_noisy_tables(lab16mm, scene):
    """At two distances; between planes there is an error besides, which a table without noise has as well."""
    ratios = []
    for distance in (1.3, 1.58):
        image, clean = patch_at(lab16mm, scene, distance), table_of(lab16mm, 16)
        runs = [look(image, with_noise(clean, 0.1, seed)) for seed in range(16)]
        means = np.array([found.density.mean for found in runs])
        still = look(image, clean).spread(means)
        predicted = [found.spread(means)[k] ** 2 - still[k] ** 2 for k, found in enumerate(runs)]
        ratios.append(np.mean((means - 1 / distance) ** 2) / np.mean(predicted))
    assert np.sqrt(np.mean(ratios)) == pytest.approx(1.0, rel=0.4)


@pytest.mark.parametrize("method", [Wiener(), Posterior()])
def test_errors_of_placement_add_to_the_interval(lab16mm, lab_patch, method):
    exact = estimate(Observation(lab_patch, NOISE), lab16mm, method)
    table = replace(lab16mm, axis_std=0.02 * lab16mm.axis**2)  # 0.02 / m in vergence
    blurred = estimate(Observation(lab_patch, NOISE), table, method)
    widths = [1 / each.interval[0] - 1 / each.interval[1] for each in (exact, blurred)]
    assert widths[1] == pytest.approx(np.hypot(widths[0], 2 * 1.96 * 0.02), rel=0.05)
    assert blurred.distance == pytest.approx(exact.distance, rel=0.01)


def test_a_dense_table_is_read_as_before_and_a_sparse_one_more_widely(lab16mm, lab_patch):
    dense, sparse = look(lab_patch, lab16mm), look(lab_patch, table_of(lab16mm, 7))
    widths = [
        [
            np.ptp(density.interval(0.95))
            for density in (each.density, with_gross_errors(each.exact, each.bank.prior.gross))
        ]
        for each in (dense, sparse)
    ]
    assert widths[0][0] == pytest.approx(widths[0][1], rel=1e-3)
    assert widths[1][0] > 1.5 * widths[1][1]


def test_a_table_whose_planes_are_alike_says_nothing_of_distance(lab16mm, lab_patch):
    plane = np.repeat(table_of(lab16mm, 3).psf[:1], 6, axis=0)
    axis = lab16mm.candidates(6)
    table = PSFTable(axis, plane, lab16mm.pixel_pitch, psf_std=np.full_like(plane, 1e-4))
    near, far = look(lab_patch, table).density.interval(0.9)
    assert 1 / near - 1 / far == pytest.approx(0.9 * (1 / axis[0] - 1 / axis[-1]), rel=0.05)
