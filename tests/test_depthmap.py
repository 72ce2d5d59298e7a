"""A map of distances is `estimate` on every patch, however it is cut; and what it says beyond that holds."""

from dataclasses import replace

import numpy as np
import pytest

from psflut import capture, cluster, depthmap, mapping, workers
from psflut.assembly import assemble
from psflut.errors import PsflutError
from psflut.estimation import Observation, Outcome, estimate
from psflut.frames import Stack
from psflut.noise import Noise
from psflut.relief import OWN, relief, widened
from psflut.smoothing import smoothed
from psflut.tiles import Tiles

NOISE = Noise(0.005)


@pytest.fixture(scope="module")
def image(lab16mm, scene):
    """(160, 144) of a photograph at 1.63 m, its upper left patch without texture."""
    taken = capture.simulate(scene, lab16mm, 1.63, capture.Setup(noise="0.005"), 1)[0][40:200, 60:204].copy()
    taken[:64, :64] = 0.5 + NOISE.read * np.random.default_rng(2).standard_normal((64, 64))
    return taken


@pytest.fixture(scope="module")
def found(image, lab16mm):
    return depthmap(image, lab16mm, size=64, stride=40, noise=NOISE)


def test_the_map_is_estimate_on_every_patch(found, image, lab16mm):
    assert found.distance.shape == (3, 3)
    for row, column in np.ndindex(3, 3):
        y, x = 40 * row, 40 * column
        own = estimate(Observation(image[y : y + 64, x : x + 64], NOISE), lab16mm, "wiener")
        assert found.distance[row, column] == pytest.approx(own.distance, rel=1e-4)
        assert tuple(found.interval[row, column]) == pytest.approx(own.interval, rel=1e-3)
        assert list(Outcome)[found.outcome[row, column]] is own.outcome
        assert (found.y[row], found.x[column]) == (y + 31.5, x + 31.5)
    assert list(Outcome)[found.outcome[0, 0]] is Outcome.FLAT
    assert not found.sure[0, 0]


def test_however_it_is_cut_it_is_the_same(found, image, lab16mm, monkeypatch):
    job = mapping.plan(Stack(image[None]), lab16mm, 64, 40, NOISE, None, 0.95)
    monkeypatch.setattr(mapping, "PATCHES", 1)
    pieces = job.pieces()
    assert len(pieces) == 3
    ours = assemble(job, workers.local(job, pieces[::-1], 2, mapping.solve), sequence=False)
    for name in ("distance", "interval", "wide", "outcome", "misfit"):
        np.testing.assert_allclose(getattr(ours, name), getattr(found, name), rtol=1e-9)


def test_a_sequence_is_its_frames(found, image, lab16mm):
    both = depthmap(np.stack([image[::-1], image]), lab16mm, size=64, stride=40, noise=NOISE)
    assert both.distance.shape == (2, 3, 3)
    np.testing.assert_allclose(both.frame(1).distance, found.distance, rtol=1e-9)
    assert both.to_xarray().distance.dims == ("time", "y", "x")


def test_a_cluster_gives_the_same(found, image, lab16mm):
    distributed = pytest.importorskip("distributed", reason="dask is not installed: pip install psflut[lab]")
    job = mapping.plan(Stack(image[None]), lab16mm, 64, 40, NOISE, None, 0.95)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0", silence_logs=50
    ) as running:
        done = list(cluster.cluster(job, job.pieces(), running.scheduler_address, mapping.solve))
    np.testing.assert_allclose(assemble(job, done, sequence=False).interval, found.interval, rtol=1e-9)


def test_patches_that_straddle_two_surfaces_say_so(lab16mm):
    """Sure readings of 1 m beside sure ones of 3 m: at the step intervals reach half way, elsewhere they stay."""
    distance = np.where(np.arange(8) < 4, 1.0, 3.0) * np.ones((6, 8))
    interval = np.stack([1 / (1 / distance + 0.01), 1 / (1 / distance - 0.01)], axis=-1)
    wide = widened(distance, interval, lab16mm, 0.95)
    middle = 1 / np.mean([1 / 1.0, 1 / 3.0])
    assert np.all(wide[:, 3, 1] > middle)
    assert np.all(wide[:, 4, 0] < middle)
    np.testing.assert_allclose(wide[:, :2], interval[:, :2])
    assert np.all(wide[..., 0] <= interval[..., 0] + 1e-12)
    assert np.all(wide[..., 1] >= interval[..., 1] - 1e-12)


def test_relief_is_the_difference_beyond_the_errors_that_are_not_shared(rng):
    sd = np.full((60, 60), 0.1)
    flat = 1.0 + np.sqrt(OWN) * rng.standard_normal((60, 60)) * sd
    rough = flat + 0.3 * rng.standard_normal((60, 60))
    assert np.sqrt(np.mean(relief(rough, sd) ** 2)) == pytest.approx(0.3 * np.sqrt(2), rel=0.1)
    assert np.sqrt(np.mean(relief(flat, sd) ** 2)) < 0.06
    assert relief(np.ones((1, 1)), np.ones((1, 1))) == 0


def test_smoothing_keeps_steps_and_heeds_intervals(lab16mm, rng):
    truth = np.where(np.arange(12) < 6, 1.0, 3.0) * np.ones((12, 12))
    sd = 0.02
    distance = 1 / (1 / truth + sd * rng.standard_normal(truth.shape))
    even = 1 / distance
    even[3, 3] += 0.4  # a wrong one, which says so
    reach = 1.96 * np.where(np.arange(144).reshape(12, 12) == 39, 0.5, sd)
    interval = np.stack([1 / (even + reach), 1 / (even - reach)], axis=-1)
    ours = smoothed(1 / even, interval, lab16mm, 0.95)
    others = np.arange(144).reshape(12, 12) != 39
    assert np.std((1 / ours - 1 / truth)[others]) < 0.6 * sd
    assert abs(1 / ours[3, 3] - 1.0) < 0.15


def test_tiles_lie_where_they_say():
    tiles = Tiles((100, 90), 32, 20)
    image = np.arange(9000.0).reshape(100, 90)
    views = tiles.cut(image)
    assert views.shape == (*tiles.grid, 32, 32) == (4, 3, 32, 32)
    assert views[2, 1, 0, 0] == image[40, 20]
    top, bottom = tiles.lines(1, 3)
    np.testing.assert_array_equal(tiles.cut(image[top:bottom]), views[1:3])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"stride": 0}, "stride of at least 1"),
        ({"size": 32}, "smaller than the table's PSF of 49"),
        ({"size": 256}, "smaller than a patch of 256"),
        ({"imager": "none such"}, "none such"),
        ({"level": 1.5}, "between 0 and 1"),
    ],
)
def test_what_cannot_be_mapped_is_refused(image, lab16mm, change, words):
    with pytest.raises(PsflutError, match=words):
        depthmap(image, lab16mm, **{"noise": NOISE, **change})


def test_a_map_shows_itself(found, image):
    assert "median" in found._repr_html_()
    figure = replace(found, smooth=found.distance).figure(image)
    scene, there = (axis.get_title() for axis in figure.axes[:2])
    assert scene == "scene"
    assert there.startswith("distance, smoothed (grey: uncertain, ")
    data = found.to_xarray()
    assert (data.distance.attrs["units"], data.distance.dims) == ("m", ("y", "x"))
