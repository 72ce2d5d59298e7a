"""The point estimator against points of the pupil model: off-grid distances, places between the pixels."""

from dataclasses import replace

import numpy as np
import pytest

from psflut.errors import PsflutError
from psflut.estimation import Observation, Outcome, estimate, prior_density
from psflut.imagers.laplacian import Laplacian
from psflut.noise import Noise
from psflut.optics import Camera, defocus_wavefront
from psflut.psfs.pupil import Pupil
from psflut.subpixel import finer
from psflut.table import PSFTable

FINER, SIZE = 5, 31
LAB = Camera.of(focus_distance=6.0, focal_length=16e-3, aperture_diameter=8e-3, pixel_pitch=6e-6)
FINE = replace(LAB, pixel_pitch=LAB.pixel_pitch / FINER)
NOISE = Noise(0.002, 1e4)
QUIET = Noise(1e-4)


def table_of(count):
    """Planes of the pupil model; blur radii from 9.4 to 0.6 pixels."""
    axis = np.sort(1 / np.linspace(1 / 0.95, 1 / 4.5, count))
    return PSFTable(axis, np.stack([Pupil()(LAB, z, SIZE) for z in axis]), LAB.pixel_pitch)


@pytest.fixture(scope="module")
def table():
    return table_of(20)


def waves(table):
    """Of defocus from plane to plane."""
    first, last = defocus_wavefront(LAB, table.axis[[0, -1]]) / LAB.wavelength
    return abs(last - first) / (len(table.axis) - 1)


def light(distance, place=(0, 0), side=45):
    """A point's light, its peak 0.7 over a ground of 0.05; its place in fifths of a pixel from the middle."""
    fine = np.roll(Pupil()(FINE, distance, FINER * (side + 4)), place, axis=(0, 1))
    seen = fine.reshape(side + 4, FINER, side + 4, FINER).sum(axis=(1, 3))[2:-2, 2:-2]
    return 0.05 + 0.7 * seen / seen.max()


def taken(picture, rng):
    return rng.poisson(picture * NOISE.gain) / NOISE.gain + NOISE.read * rng.standard_normal(picture.shape)


def steps(table, found, truth):
    """Of the calibration between an answer and the truth."""
    first, last = table.even(table.span)
    return (table.even(found) - table.even(truth)) / (last - first) * (len(table.axis) - 1)


@pytest.mark.parametrize("distance", [0.97, 1.133, 1.377, 1.6, 2.123, 2.9])
def test_without_noise_the_error_is_a_small_part_of_the_step(table, distance):
    found = estimate(Observation(light(distance), QUIET), table, "point")
    assert abs(steps(table, found.distance, distance)) < 0.05
    assert found.interval[0] < found.distance < found.interval[1]


NEAR_FOCUS = (3.05, 3.4, 3.6, 3.9, 4.1, 4.3)


def test_near_focus_a_step_of_half_a_wave_is_the_limit(table):
    """A PSF has up to one cycle a wave of defocus: below half a wave a step, splines follow it up to the last plane.

    Of a point in the middle of its pixel. Elsewhere the pixels under-sample a blur below 1.3 pixels of radius, and
    the error, up to 0.28 of a step at 4.4 m, is the same with finer steps.
    """
    fine = table_of(26)
    assert waves(fine) < 0.5 < waves(table)
    errors = []
    for each in (fine, table):
        found = [estimate(Observation(light(z), QUIET), each, "point") for z in NEAR_FOCUS]
        errors.append([abs(steps(each, one.distance, z)) for one, z in zip(found, NEAR_FOCUS, strict=True)])
    assert max(errors[0]) < 0.05
    assert max(errors[1]) > 0.05  # the control


def test_intervals_know_planes_that_are_too_far_apart_near_focus():
    """In the middle between two planes of 20, 0.64 waves apart; the control does not know the camera."""
    bare = table_of(20)
    known = replace(bare, camera=LAB)
    even = np.sort(known.even(known.axis))
    middles = 0.5 * (even[1:] + even[:-1])[:3]
    ratios = []
    for table in (known, bare):
        found = [estimate(Observation(light(1 / u), QUIET), table, "point") for u in middles]
        error = [abs(steps(table, one.distance, 1 / u)) for one, u in zip(found, middles, strict=True)]
        half = [abs(steps(table, *one.interval)) / 2 for one in found]
        ratios.append(max(np.divide(error, half)))
    assert ratios[0] < 1 < ratios[1]


@pytest.mark.parametrize("distance", [0.97, 1.133, 1.377, 1.6, 2.123, 2.434])
def test_nor_does_a_place_between_the_pixels_mislead_it(table, distance):
    for place in ((2, 2), (1, -2), (-1, 0)):
        found = estimate(Observation(light(distance, place), QUIET), table, "point")
        assert abs(steps(table, found.distance, distance)) < 0.05
        assert (found.stats["y"], found.stats["x"]) == pytest.approx([22 + k / FINER for k in place], abs=0.02)


def test_intervals_cover_the_truth_at_their_level(table):
    """40 points of random distance, place and noise; 95 % intervals, and the control that a tenth of them fails."""
    rng = np.random.default_rng(3)
    inside, narrow, misfit = 0, 0, []
    for _ in range(40):
        truth = float(table.position(rng.uniform(*np.sort(table.even((1.0, 3.0))))))
        found = estimate(Observation(taken(light(truth, rng.integers(-2, 3, 2)), rng), NOISE), table, "point")
        near, far = found.interval
        inside += near <= truth <= far
        narrow += abs(truth - found.distance) < 0.05 * (far - near)
        misfit.append(found.stats["misfit"])
    assert inside >= 35
    assert narrow < 20
    assert 0.9 < np.median(misfit) < 1.15


def test_errors_of_the_table_widen_the_interval(table, rng):
    """At one of its planes, where interpolation adds nothing."""
    truth = float(table.axis[11])
    image = taken(light(truth), rng)
    unsure = replace(table, psf_std=np.full(table.psf.shape, 0.03 * table.at(truth).max()))
    sharp, wide = (estimate(Observation(image, NOISE), each, "point") for each in (table, unsure))
    assert np.ptp(wide.interval) > 2 * np.ptp(sharp.interval)
    assert wide.stats["misfit"] < sharp.stats["misfit"]


def test_errors_of_placement_add_to_the_interval(table, rng):
    image = taken(light(1.6), rng)
    unsure = replace(table, axis_std=0.005 * table.axis**2)  # 0.005 / m in vergence
    sharp, wide = (estimate(Observation(image, NOISE), each, "point") for each in (table, unsure))
    widths = [1 / each.interval[0] - 1 / each.interval[1] for each in (sharp, wide)]
    assert widths[1] == pytest.approx(np.hypot(widths[0], 2 * 1.96 * 0.005), rel=0.05)


def test_a_large_patch_gives_the_same_as_a_small_one(table, rng):
    small = taken(light(1.6, (1, 2)), rng)
    large = NOISE.read * rng.standard_normal((150, 201)) + 0.05
    large[30:75, 141:186] = small
    one, other = (estimate(Observation(image, NOISE), table, "point") for image in (small, large))
    assert other.distance == pytest.approx(one.distance, rel=1e-6)
    assert (other.stats["y"] - 30, other.stats["x"] - 141) == pytest.approx((one.stats["y"], one.stats["x"]), abs=1e-3)
    assert other.detail["restored"].shape == large.shape


def test_a_point_at_the_border_still_tells(table, rng):
    cut = taken(light(1.6), rng)[:, 18:]
    found = estimate(Observation(np.pad(cut, ((0, 0), (0, 20)), constant_values=0.05), NOISE), table, "point")
    assert found.distance == pytest.approx(1.6, rel=0.01)


def test_the_imager_is_part_of_what_is_seen(table, rng):
    imager = Laplacian()
    caught = rng.poisson(light(1.6, (1, 1), 61) * NOISE.gain) / NOISE.gain
    picture = imager.response(caught)[8:-8, 8:-8] + NOISE.read * rng.standard_normal((45, 45))
    found = estimate(Observation(picture, NOISE, imager="laplacian"), table, "point")
    assert found.distance == pytest.approx(1.6, rel=0.01)
    assert found.interval[0] < 1.6 < found.interval[1]


def test_nothing_above_the_noise_is_flat_and_a_faint_point_is_not(table, rng):
    dark = 0.05 + 0.002 * rng.standard_normal((100, 100))
    found = estimate(Observation(dark, Noise(0.002)), table, "point")
    assert found.outcome is Outcome.FLAT
    assert found.interval == prior_density(table).interval(0.95)
    dark[20:65, 30:75] += 0.005 * (light(1.2) - 0.05) / 0.7
    assert estimate(Observation(dark, Noise(0.002)), table, "point").outcome is not Outcome.FLAT


def test_what_is_no_point_is_finite_and_fits_badly(lab16mm, lab_patch):
    found = estimate(Observation(lab_patch, Noise(0.005)), lab16mm, "point")
    assert np.all(np.isfinite([found.distance, *found.interval]))
    assert found.stats["misfit"] > 10


def test_one_saturated_pixel_of_a_point_is_told(table):
    image = np.minimum(light(4.2) * 1.4, 1.0)
    assert 0 < np.mean(image == 1.0) < 0.005
    assert estimate(Observation(image, QUIET), table, "point").outcome is Outcome.SATURATED


def test_a_patch_smaller_than_the_psf_is_refused(table):
    with pytest.raises(PsflutError, match="take a larger patch"):
        estimate(Observation(light(1.6, side=29), NOISE), table, "point")


def test_a_round_psf_is_known_between_the_pixels():
    """Against the model integrated over shifted pixels; a Fourier shift errs by 0.27 and more."""
    truth = Pupil()(FINE, 1.9, FINER * (SIZE + 4))
    plane = Pupil()(LAB, 1.9, SIZE)
    fine = finer(plane[None], 10, SIZE + 4)[0]
    middle = 10 * ((SIZE + 4) // 2)
    assert fine[middle % 10 :: 10, middle % 10 :: 10][2:-2, 2:-2] == pytest.approx(plane, abs=1e-6)
    for place in ((2, 2), (1, -2)):
        shifted = np.roll(truth, place, axis=(0, 1)).reshape(SIZE + 4, FINER, SIZE + 4, FINER).sum(axis=(1, 3))
        y, x = (middle - 2 * k - 10 * (SIZE // 2) for k in place)
        seen = fine[y::10, x::10][:SIZE, :SIZE]
        assert np.abs(seen - shifted[2:-2, 2:-2]).sum() < 0.03
