"""What a table says of itself is true: of errors, of placement, of good and blind ranges, and of the model's merit."""

from dataclasses import replace

import numpy as np
import pytest

from calib.assess import Assessment
from calib.build import table_of
from calib.check import facts, hold_out
from calib.drift import drift
from calib.fill import between
from calib.nearest import nearest
from calib.pupil_fit import Lens, fit_lens
from calib.ranges import ranges
from calib.targets import Measurement
from psflut.errors import PsflutError
from psflut.optics import Camera
from psflut.psfs.pupil import Pupil
from psflut.table import PSFTable

CAMERA = Camera.of(16e-3, 6e-6, f_number=2, focus_distance=6.0)
SIZE, NOISE = 31, 3e-4
MODEL = Pupil(zernikes=((4, 0, 0.1),))


def axis_of(count, near=1.05, far=3.5):
    return 1 / np.linspace(1 / near, 1 / far, count)


def psf(distance, model=MODEL):
    return model(CAMERA, float(distance), SIZE)


def measured(distances, rng, noise=NOISE):
    std = np.full((SIZE, SIZE), noise)
    return [Measurement(psf(z) + noise * rng.standard_normal(std.shape), std, 1) for z in distances]


@pytest.fixture(scope="module")
def fitted():
    """A sparse table and the lens fitted to it, without a word on the camera."""
    frames = measured(axis_of(9), np.random.default_rng(1))
    table = table_of(axis_of(9), "distance", frames, CAMERA.pixel_pitch)
    psf, std = np.stack([each.psf for each in frames]), np.stack([each.std for each in frames])
    even = table.even(table.axis)
    return table, frames, fit_lens(even, psf, std, Lens.of_moments(even, table.psf))


def test_psfs_alone_tell_the_lens(fitted):
    _, _, lens = fitted
    truth = Lens.of_camera(CAMERA)
    assert lens.slope == pytest.approx(truth.slope, rel=0.01)
    assert 1 / lens.focus == pytest.approx(6.0, rel=0.05)
    assert lens.sampling == pytest.approx(truth.sampling, rel=0.03)
    assert lens.spherical == pytest.approx(0.1, abs=0.02)


def test_the_held_out_error_is_that_of_fresh_frames(fitted):
    table, frames, lens = fitted
    rng = np.random.default_rng(2)
    fresh = 1 / np.linspace(1 / 3.3, 1 / 1.08, 120)  # the median of 40 at random places scatters by a third
    error = [nearest(table, one.psf) / z - 1 for z, one in zip(fresh, measured(fresh, rng), strict=True)]
    found = hold_out(table.axis, table.kind, frames, table.pixel_pitch, lens)
    true = np.median(np.abs(error))
    assert 1 / 1.5 < facts(found, "distance")["position_error_of_distance"] / true < 1.5
    assert np.median(np.abs(found.position_error) / found.position) / true > 3  # control: twice the gap


def test_placement_is_found_from_the_scatter():
    sigmas, axis = [], axis_of(16, 1.05, 2.0)
    for seed in range(3):
        rng = np.random.default_rng(seed)
        frames = measured(axis + 0.004 * rng.standard_normal(16), rng, 5e-5)
        table = Assessment().of(table_of(axis, "distance", frames, CAMERA.pixel_pitch), frames)
        sigmas.append(table.check["placement_m"])
        assert table.axis_std.min() >= sigmas[-1]
    assert 1 / 1.5 < np.median(sigmas) / 0.004 < 1.5


def test_positions_that_are_exact_have_no_placement_error(rng):
    axis = axis_of(16, 1.05, 2.0)
    frames = measured(axis, rng, 5e-5)
    table = table_of(axis, "distance", frames, CAMERA.pixel_pitch)
    assert Assessment().of(table, frames).check["placement_m"] < 0.0005
    np.testing.assert_array_equal(Assessment(placement=1e-3).of(table, frames).axis_std, 1e-3)


def test_the_model_fills_a_sparse_table_where_it_explains_the_frames(fitted):
    table, frames, _ = fitted
    filled = Assessment(model=True, planes=33).of(table, frames)
    truth = np.stack([psf(z) for z in filled.axis])
    assert filled.check["model"]["better"] == "pupil"
    assert len(filled.axis) == 33
    assert np.abs(filled.psf - truth).sum(axis=(1, 2)).max() < 0.03
    assert np.abs(table.at(filled.axis) - truth).sum(axis=(1, 2)).max() > 0.1  # the control: the course between


def test_lens_and_course_together_serve_where_planes_are_too_far_apart_for_either():
    """Near focus, 20 planes 0.64 waves apart, of a lens with astigmatism and coma; errors in steps of the table."""
    model = Pupil(zernikes=((2, 2, 0.2), (3, 1, 0.15)))
    table = PSFTable(axis_of(20, 0.95, 4.5), np.stack([psf(z, model) for z in axis_of(20, 0.95, 4.5)]), 6e-6)
    even, axis = table.even(table.axis), table.candidates(60)
    lens = fit_lens(even, table.psf, np.full_like(table.psf, 1e-6), Lens.of_camera(CAMERA))
    planes = [table.at(axis), lens.at(table.even(axis), SIZE), between(table, lens, axis)]
    places = np.array([2.74, 3.4, 3.9, 4.1])
    read = [[nearest(replace(table, axis=axis, psf=each), psf(z, model)) for z in places] for each in planes]
    course, alone, both = np.abs(table.even(np.array(read)) - table.even(places)).max(axis=1) * 19 / np.ptp(even)
    assert both < 0.05
    assert min(course, alone) > 0.05  # the controls


def test_a_model_that_does_not_fit_is_told_so_and_displaces_no_frame(rng):
    """Twice as wide along y: no round pupil shows that."""
    axis = axis_of(12, 1.5, 1.9)
    wide = [np.kron(psf(z)[8:23, 8:23], np.ones((2, 1)))[:30] for z in axis]
    planes = [np.pad(each, ((1, 0), (8, 8))) / each.sum() for each in wide]
    std = np.full((31, 31), 1e-5)
    frames = [Measurement(each + std * rng.standard_normal(std.shape), std, 1) for each in planes]
    found = Assessment(model=True, planes=60).of(table_of(axis, "distance", frames, 6e-6), frames)
    squares = found.check["model"]["chi_square"]
    assert squares["pupil"] > 100 * squares["both"]
    assert np.abs(found.at(axis) - planes).sum(axis=(1, 2)).max() < 0.01


def test_a_table_is_blind_at_focus_and_good_beside_it(rng):
    """A stage axis on both sides: a defocus from -0.6 to 0.6 dioptres."""
    stage = np.linspace(-0.6, 0.6, 25)
    planes = [psf(1 / (1 / 6 + u), Pupil()) for u in stage]
    frames = [Measurement(each, np.full(each.shape, 1e-4), 1) for each in planes]
    found = ranges(table_of(stage, "stage", frames, 6e-6))
    assert any(low < 0.0 < high for low, high in found["blind_m"])
    assert all(high - low < 0.3 for low, high in found["blind_m"])
    for place in (-0.4, 0.4):
        assert any(low < place < high for low, high in found["good_m"])
    assert sum(high - low for low, high in found["good_m"] + found["blind_m"]) == pytest.approx(1.2)


def test_noise_does_not_pass_for_a_change(rng):
    """A PSF that is the same everywhere, measured with noise: blind from end to end."""
    frames = measured(np.full(12, 2.0), rng, 3e-3)
    found = ranges(table_of(axis_of(12), "distance", frames, 6e-6))
    assert sum(high - low for low, high in found["good_m"]) < 0.1 * np.ptp(axis_of(12))


def test_what_cannot_be_looked_into_is_refused(fitted):
    table, frames, _ = fitted
    few = replace(table, axis=table.axis[:4], psf=table.psf[:4], psf_std=table.psf_std[:4])
    with pytest.raises(PsflutError, match="7 positions"):
        Assessment(model=True).of(few, frames[:4])
    for wrong in ({"placement": -1.0}, {"planes": 50}, {"planes": 2, "model": True}):
        with pytest.raises(PsflutError, match=r"sigma is a length|more planes"):
            Assessment(**wrong)


@pytest.fixture(scope="module")
def calibrated():
    axis = axis_of(16, 1.05, 2.5)
    frames = measured(axis, np.random.default_rng(4))
    return Assessment().of(replace(table_of(axis, "distance", frames, CAMERA.pixel_pitch), camera=CAMERA), frames)


FRESH = np.array([1.11, 1.27, 1.39, 1.63, 1.88, 2.17])


def again(camera, rng):
    """Fresh frames at other places, by a camera that may have changed."""
    std = np.full((SIZE, SIZE), NOISE)
    planes = [MODEL(camera, z, SIZE) + std * rng.standard_normal(std.shape) for z in FRESH]
    return [Measurement(plane, std, 1) for plane in planes]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_table_holds_for_new_frames_of_the_same_lens(calibrated, seed):
    found = drift(calibrated, FRESH, again(CAMERA, np.random.default_rng(seed)))
    assert found.verdict == "holds"
    assert "holds" in found.message()


@pytest.mark.parametrize("focus", [5.4, 5.7, 6.6])
def test_a_focus_that_moved_is_named(calibrated, rng, focus):
    """From 6 m; 30 cm there are a hundredth of a dioptre."""
    moved = Camera.of(16e-3, 6e-6, f_number=2, focus_distance=focus)
    found = drift(calibrated, FRESH, again(moved, rng))
    facts = found.facts()
    assert found.verdict == "drifted"
    assert found.shift[0] == pytest.approx(1 / 6 - 1 / focus, abs=3 * found.shift[1])
    assert facts["focus_m"] == pytest.approx(focus, abs=0.1)
    assert (facts["shift_m"] > 0) == (focus < 6.0) == ("too far" in found.message())
    assert facts["chi_square"]["shifted"] < 0.5 * facts["chi_square"]["as_it_is"]


def test_another_aperture_is_no_shift(calibrated, rng):
    found = drift(calibrated, FRESH, again(replace(CAMERA, aperture_diameter=4e-3), rng))
    assert found.verdict == "changed"
    with pytest.raises(PsflutError, match="within the table"):
        drift(calibrated, np.array([3.0]), again(CAMERA, rng)[:1])
