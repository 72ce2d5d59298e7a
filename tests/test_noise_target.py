"""The printed target is found at any size, turn and tilt, and gives PSFs, with honest errors."""

import dataclasses
from functools import cache

import numpy as np
import pytest
from scipy import ndimage, signal

from calib.noise_target import CELL, DOTS, NoiseTarget
from calib.targets import Shot
from calib.targets.pattern import Pattern
from psflut.errors import PsflutError
from psflut.imagers.laplacian import Laplacian
from psflut.imagers.plain import Plain
from psflut.images import read_image
from psflut.optics import Camera
from psflut.psfs.pupil import Pupil

LENS = Camera.of(16e-3, 6e-6, f_number=2, focus_distance=6.0)
SPLIT, FINER, SIZE, SHAPE = 4, 2, 25, (300, 240)
FINE = dataclasses.replace(LENS, pixel_pitch=LENS.pixel_pitch / SPLIT)
VIEWS = ((1.2, 1.1, 3.0, 0.03), (1.6, 1.15, -4.0, 0.02), (2.2, 1.1, 6.0, 0.0))
"""Distance (m), millimetres of the page to a pixel, turn (degrees), and tilt: change of size across the frame."""
MEASURED = VIEWS[:2]


@cache
def picture():
    return NoiseTarget().picture()


def map_to_picture(millimetres, turn, tilt):
    """From (x, y, 1) of the frame to dots of the picture; the middles are put on each other, and a little aside."""
    turn, dots = np.deg2rad(turn), millimetres * 1e-3 / CELL * DOTS
    middle = np.array([[1, 0, (1 - SHAPE[1]) / 2], [0, 1, (1 - SHAPE[0]) / 2], [0, 0, 1]])
    about = np.array(
        [
            [dots * np.cos(turn), dots * np.sin(turn), (picture().shape[1] - 1) / 2 + 9.3],
            [-dots * np.sin(turn), dots * np.cos(turn), (picture().shape[0] - 1) / 2 - 4.7],
            [0, 0, 1],
        ]
    )
    return about @ np.array([[1, 0, 0], [0, 1, 0], [tilt / SHAPE[1], 0, 1]]) @ middle


def seen(matrix):
    """The page as the frame's pixels would see it, SPLIT times as fine; each the mean of FINER^2 places."""
    per = SPLIT * FINER
    y, x = np.indices((SHAPE[0] * per, SHAPE[1] * per)).reshape(2, -1)
    place = matrix @ np.array([(x + 0.5) / per - 0.5, (y + 0.5) / per - 0.5, np.ones(x.size)])
    light = ndimage.map_coordinates(picture(), place[1::-1] / place[2], order=0, mode="nearest")
    return 0.06 + 0.7 * light.reshape(SHAPE[0] * SPLIT, FINER, SHAPE[1] * SPLIT, FINER).mean(axis=(1, 3))


@cache
def blurred(distance, *view):
    light = signal.oaconvolve(seen(map_to_picture(*view)) - 0.76, Pupil()(FINE, distance, SIZE * SPLIT + 1), "same")
    return 0.76 + light.reshape(SHAPE[0], SPLIT, SHAPE[1], SPLIT).mean(axis=(1, 3))


def shot(view, seed=0, imager=None, gain=20_000.0, read=0.002, bits=12):
    rng = np.random.default_rng(seed)
    frame = rng.poisson(blurred(*view) * gain) / gain
    frame = (frame if imager is None else imager.response(frame)) + read * rng.standard_normal(SHAPE)
    levels = 2**bits - 1
    return Shot(frame if imager else np.round(frame.clip(0, 1) * levels) / levels, view[0], f"shot {seed}")


def truth(distance):
    return Pupil()(LENS, distance, SIZE)


@pytest.fixture(scope="module")
def measured():
    return [Pattern("noise").measure([shot(view)], SIZE, Plain()) for view in MEASURED]


def test_a_printed_page_gives_the_psf(measured):
    errors = [np.abs(each.psf - truth(view[0])).sum() for each, view in zip(measured, MEASURED, strict=True)]
    assert np.mean(errors) < 0.08


def test_standard_errors_are_honest(measured):
    error = sum(np.sum((each.psf - truth(view[0])) ** 2) for each, view in zip(measured, MEASURED, strict=True))
    assert 1 / 1.3 < np.sqrt(error / sum(np.sum(each.std**2) for each in measured)) < 1.3


def test_the_control_the_error_tells_neighbouring_distances_apart(measured):
    assert np.abs(measured[1].psf - truth(1.7)).sum() > 0.1


@pytest.mark.parametrize("view", [*VIEWS, (1.6, 1.4, 93.0, 0.0), (1.2, 1.2, 178.0, 0.02)])
def test_it_is_found_to_a_pixel_or_two_at_any_turn(view):
    found, known = NoiseTarget().find(shot(view).image), map_to_picture(*view[1:])
    corners = np.array([[40.0, 40, 1], [200, 40, 1], [40, 260, 1], [200, 260, 1]]).T
    ours, theirs = (m @ corners for m in (found, known))
    off = np.hypot(*(ours[:2] / ours[2] - theirs[:2] / theirs[2])) / (view[1] * 1e-3 / CELL * DOTS)
    assert off.max() < 2.5


def test_through_a_laplacian_it_serves_too():
    found = Pattern("noise").measure([shot(VIEWS[1], 1, Laplacian(), 2e6, 0.0005)], SIZE, Laplacian())
    assert np.abs(found.psf - truth(VIEWS[1][0])).sum() < 0.08


def test_another_seed_is_not_taken_for_it():
    with pytest.raises(PsflutError, match="shows no noise target"):
        NoiseTarget(seed=1).find(shot(VIEWS[1]).image)


def test_a_frame_that_cuts_a_disc_off_is_refused():
    with pytest.raises(PsflutError, match="all four discs"):
        NoiseTarget().find(shot(VIEWS[1]).image[:, 60:])


def test_power_at_all_scales():
    """Half of a picture is black, and areas of every size still differ in their mean."""
    field = picture()[300:1300, 100:1100]
    assert 0.4 < field.mean() < 0.6
    for side in (5, 20, 80):
        assert ndimage.uniform_filter(field, side)[::side, ::side].std() > 0.1


def test_names_come_back():
    for target in (NoiseTarget(), NoiseTarget("Letter", 7)):
        assert NoiseTarget.parse(target.name) == target
    assert NoiseTarget.parse("noise") == NoiseTarget()


@pytest.mark.parametrize("name", ["noise:A9", "noise:A4:x", "noise:A4:1:2"])
def test_unknown_names_are_refused(name):
    with pytest.raises(PsflutError):
        Pattern(name).picture()


def test_the_page_is_written_and_is_the_same_every_time(run, tmp_path, capsys):
    for name in ("a.pdf", "b.pdf", "a.png"):
        assert run("target", "-o", tmp_path / name, "--size", "Letter", "--seed", 3) == 0
    assert "--reference noise:Letter:3" in capsys.readouterr().err
    assert (tmp_path / "a.pdf").read_bytes() == (tmp_path / "b.pdf").read_bytes()
    np.testing.assert_array_equal(read_image(tmp_path / "a.png").image, NoiseTarget("Letter", 3).picture())
    assert run("target", "-o", tmp_path / "a.pdf") == 2
    assert run("target", "-o", tmp_path / "a.jpg") == 2
