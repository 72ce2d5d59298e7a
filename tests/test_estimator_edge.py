"""Distances from straight edges. Captures come from the pupil model at distances that the table does not hold."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage
from test_target_edge import SIDE, blurred, line, quartered, shot

from psflut import edgefit
from psflut.edges import Search
from psflut.estimation import Observation, Outcome, estimate
from psflut.imagers.plain import Plain
from psflut.noise import Noise

NOISE = Noise(0.001, gain=8e4)


def seen(share, distance, seed, side=SIDE):
    return Observation(shot(blurred(share, distance, side), seed).image, NOISE)


@pytest.mark.parametrize("angle", [5, 45])
def test_an_edge_tells_its_distance_at_any_angle(lab16mm, angle):
    for seed, distance in enumerate((1.03, 1.37, 1.79, 2.47)):
        found = estimate(seen(line(angle), distance, seed), lab16mm, "edge")
        assert found.distance == pytest.approx(distance, rel=0.01)
        assert found.stats["misfit"] < 1.5


@pytest.mark.campaign
def test_intervals_cover_the_truth_as_often_as_they_say(lab16mm):
    """Twenty edges, blur radii of 4 to 8 pixels: 12 to 20 hits of 80 % intervals have a probability of 99 %."""
    rng, hits = np.random.default_rng(0), 0
    for number in range(20):
        distance, angle = rng.uniform(1.0, 1.6), rng.uniform(0, 360)
        near, far = estimate(seen(line(angle), distance, number), lab16mm, "edge", 0.8).interval
        hits += near <= distance <= far
    assert hits >= 12


def test_noise_that_neighbours_share_widens_intervals_and_the_control_that_takes_it_for_white_covers_less(lab16mm):
    """Noise smoothed over some pixels, as compressed and demosaiced frames have it: 16 readings, intervals of 90 %."""
    rng, hits = np.random.default_rng(1), np.zeros(2)
    for _ in range(16):
        distance, angle = rng.uniform(1.0, 1.6), rng.uniform(0, 360)
        noise = ndimage.gaussian_filter(rng.standard_normal((SIDE, SIDE)), 1.5)
        image = blurred(line(angle), distance)[18:-18, 18:-18] + 0.002 * noise / noise.std()
        edges, _ = Search().edges(image, lab16mm.size, Plain())
        found = edgefit.fit(edges, lab16mm, Plain(), Noise(0.002), 0.4, 200)
        white = replace(found, squares=found.squares * found.excess / max(found.misfit, 1.0), freedom=0)
        for k, each in enumerate((found, white)):
            near, far = each.density(lab16mm).interval(0.9)
            hits[k] += near <= distance <= far
    assert hits[0] >= 12  # with a probability of 98 %
    assert hits[1] < 10  # of which honest ones would fall short once in a thousand times


def test_errors_of_the_tables_pixels_are_the_scatter_over_noisy_tables(lab16mm):
    """Of a twentieth of each PSF's peak, independent from one lit pixel to the next, on every fourth plane."""
    image = seen(line(8), 1.5, 0).image
    edges, _ = Search().edges(image, lab16mm.size, Plain())
    axis, planes = lab16mm.axis[::4], lab16mm.psf[::4]
    peak = planes.max(axis=(1, 2), keepdims=True)
    std = 0.05 * peak * (planes > 0.2 * peak)
    rng, means, stated = np.random.default_rng(2), [], []
    for _ in range(12):
        psf = np.maximum(planes + std * rng.standard_normal(std.shape), 0.0)
        total = psf.sum(axis=(1, 2), keepdims=True)
        noisy = replace(lab16mm, axis=axis, psf=psf / total, psf_std=std / total)
        found = edgefit.fit(edges, noisy, Plain(), NOISE, 0.4, 100)
        means.append(found.density(noisy).mean)
        stated.append(found.table_error)
    assert np.mean(stated) == pytest.approx(np.std(means, ddof=1), rel=0.5)


def test_four_edges_tell_more_than_one(lab16mm):
    one = estimate(seen(line(8), 1.5, 0, 122), lab16mm, "edge")
    four = estimate(seen(quartered, 1.5, 0, 122), lab16mm, "edge")
    assert np.ptp(four.interval) < np.ptp(one.interval)
    assert four.stats["edges"] == 4
    assert four.distance == pytest.approx(1.5, rel=0.005)


def test_errors_of_placement_add_to_the_interval(lab16mm):
    unsure = replace(lab16mm, axis_std=0.005 * lab16mm.axis**2)  # 0.005 / m in vergence
    sharp, wide = (estimate(seen(line(8), 1.5, 0), table, "edge") for table in (lab16mm, unsure))
    widths = [1 / each.interval[0] - 1 / each.interval[1] for each in (sharp, wide)]
    assert widths[1] == pytest.approx(np.hypot(widths[0], 2 * 1.96 * 0.005), rel=0.05)


def test_a_patch_without_an_edge_is_flat(lab16mm, rng):
    found = estimate(Observation(0.5 + 0.1 * rng.standard_normal((88, 88)), NOISE), lab16mm, "edge")
    assert found.outcome is Outcome.FLAT
    assert found.stats["edges"] == 0
