"""Points that differ in shape: what their modes are, and what is read with them."""

from dataclasses import replace

import numpy as np
import pytest

from calib.modes import with_modes
from psflut.errors import PsflutError
from psflut.estimation import Observation, estimate
from psflut.noise import Noise
from psflut.optics import Camera
from psflut.psfs.pupil import Pupil
from psflut.store import read_table, write_table
from psflut.table import PSFTable

SIZE, PITCH = 21, 6e-6
LAB = Camera.of(focus_distance=6.0, focal_length=16e-3, aperture_diameter=8e-3, pixel_pitch=PITCH)
AXIS = 1 / np.linspace(1 / 1.2, 1 / 2.4, 12)
COMAS = np.linspace(-0.25, 0.25, 9)


def psf(distance, coma):
    """A point whose coma goes with its place in depth, as over the field of a tilted specimen."""
    plane = Pupil(zernikes=((3, 1, coma),))(LAB, float(1 / (1 / distance + 0.04 * coma)), SIZE)
    return plane / plane.sum()


@pytest.fixture(scope="module")
def single():
    return [PSFTable(AXIS, np.stack([psf(z, coma) for z in AXIS]), PITCH) for coma in COMAS]


@pytest.fixture(scope="module")
def mean(single):
    return replace(single[0], psf=np.mean([each.psf for each in single], axis=0))


def test_all_modes_together_give_back_how_points_scatter(mean, single):
    planes = np.stack([each.psf for each in single])
    modes = with_modes(mean, single, len(single) - 1).psf_modes
    assert np.sum(modes**2, axis=0) == pytest.approx(planes.var(axis=0, ddof=1), abs=1e-9)


def test_shape_that_goes_with_depth_tells_the_distance(mean, single):
    """Points between those of the calibration, at distances between its own."""
    modes = with_modes(mean, single, 3)
    rng, without, found, inside = np.random.default_rng(1), [], [], 0
    for truth in rng.uniform(1.3, 2.2, 12):
        image = np.pad(0.7 * psf(truth, rng.uniform(-0.2, 0.2)) / psf(truth, 0).max(), 8) + 0.05
        observation = Observation(image + 0.003 * rng.standard_normal(image.shape), Noise(0.003))
        first, second = (estimate(observation, table, "point") for table in (mean, modes))
        without.append(1 / first.distance - 1 / truth)
        found.append(1 / second.distance - 1 / truth)
        inside += second.interval[0] <= truth <= second.interval[1]
    assert np.std(found) < 0.2 * np.std(without)
    assert inside >= 9


def test_what_few_modes_leave_widens_intervals_and_the_control_without_it_does_not_cover():
    """Points that differ in coma and in the size of their blur, one mode of ten of them, thirty others to read."""
    rng = np.random.default_rng(4)

    def point(kind, z):
        coma, scale = kind
        plane = Pupil(zernikes=((3, 1, coma),))(LAB, float(1 / (1 / 6 + (1 / z - 1 / 6) * scale)), SIZE)
        return plane / plane.sum()

    def kinds(count):
        return zip(0.15 * rng.standard_normal(count), 1 + 0.02 * rng.standard_normal(count), strict=True)

    single = [PSFTable(AXIS, np.stack([point(kind, z) for z in AXIS]), PITCH) for kind in kinds(10)]
    mean = replace(single[0], psf=np.mean([each.psf for each in single], axis=0))
    table, inside = with_modes(mean, single, 1), np.zeros(2)
    for kind, truth in zip(kinds(30), rng.uniform(1.3, 2.2, 30), strict=True):
        image = np.pad(0.7 * (plane := point(kind, truth)) / plane.max(), 8) + 0.05
        observation = Observation(image + 0.003 * rng.standard_normal(image.shape), Noise(0.003))
        for k, each in enumerate((table, replace(table, axis_std=None))):
            near, far = estimate(observation, each, "point").interval
            inside[k] += near <= truth <= far
    assert inside[0] >= 26  # of 95 %, with a probability of 98 %
    assert inside[1] < 22


def test_modes_are_kept_on_disk_and_known_between_planes(mean, single, tmp_path):
    table = with_modes(mean, single, 2)
    write_table(table, tmp_path / "beads.zarr.zip")
    back = read_table(tmp_path / "beads.zarr.zip")
    np.testing.assert_allclose(back.psf_modes, table.psf_modes, atol=1e-7)
    np.testing.assert_allclose(back.modes_at(AXIS[[2, 5]]), table.psf_modes[:, [2, 5]], atol=1e-7)
    assert mean.modes_at(AXIS).shape == (0, *mean.psf.shape)


def test_too_many_modes_and_modes_of_another_shape_are_refused(mean, single):
    with pytest.raises(PsflutError, match="fewer than points"):
        with_modes(mean, single[:3], 3)
    with pytest.raises(PsflutError, match="shaped like"):
        replace(mean, psf_modes=np.zeros((1, 3, 3, 3)))
