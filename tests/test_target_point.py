"""Points against the pupil model they were made from: off-grid distances, random places, 12 bits."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.signal import fftconvolve

from calib.targets import Shot
from calib.targets.point import Point
from psflut.errors import PsflutError
from psflut.imagers.laplacian import Laplacian
from psflut.imagers.plain import Plain
from psflut.optics import Camera
from psflut.psfs.pupil import Pupil

FINER = 5
LAB = Camera.of(focus_distance=6.0, focal_length=16e-3, aperture_diameter=8e-3, pixel_pitch=6e-6)
FINE = replace(LAB, pixel_pitch=LAB.pixel_pitch / FINER)
PIXELS = {1.13: 33, 1.63: 25, 2.37: 21}
"""Distance (metres) to size: blur radii of 7.7, 4.8 and 2.7 pixels."""


def photograph(distance, size, rng, *, imager=None, points=3, pinhole=0.0, level=0.7):
    """A frame of points x points points around the nodes of a grid, places even over fifths of a pixel."""
    fine = Pupil()(FINE, distance, FINER * (size + 14))
    if pinhole:
        y, x = np.mgrid[-30:31, -30:31]
        disc = (np.hypot(y, x) <= pinhole * FINER / 2).astype(float)
        fine = fftconvolve(fine, disc / disc.sum(), mode="same")
    cell, half = int(1.6 * size) + 8, len(fine) // 2
    side = points * cell + 16
    canvas = np.zeros((FINER * side, FINER * side))
    for node in np.ndindex(points, points):
        y, x = FINER * (np.array(node) * cell + cell // 2 + 8) + rng.integers(-10, 11, 2)
        canvas[y - half : y + half + 1, x - half : x + half + 1] += fine
    light = canvas.reshape(side, FINER, side, FINER).sum(axis=(1, 3))
    light = rng.poisson((light * level / light.max() + 0.005) * 1e4) / 1e4
    picture = (light if imager is None else imager.response(light)) + 0.03
    picture = picture + 0.002 * rng.standard_normal(picture.shape)
    return picture if imager else np.round(np.clip(picture, 0, 1) * 4095) / 4095


def shots(distance, size, rng, count=2, **settings):
    return [Shot(photograph(distance, size, rng, **settings), distance, f"shot {k}") for k in range(count)]


@pytest.fixture(scope="module")
def measured():
    """By distance: what 18 points gave, and the truth."""
    rng = np.random.default_rng(1)
    return {
        z: (Point().measure(shots(z, size, rng), size, Plain()), Pupil()(LAB, z, size)) for z, size in PIXELS.items()
    }


def wrong(measurement, truth):
    return np.abs(measurement.psf - truth).sum()


@pytest.mark.parametrize("distance", PIXELS)
def test_the_psf_is_the_pupil_models(measured, distance):
    found, truth = measured[distance]
    assert found.used == 18
    assert found.rejected == ()
    assert found.psf.shape == found.std.shape == truth.shape
    assert found.psf.sum() == pytest.approx(1)
    assert wrong(found, truth) < 0.05


def test_standard_errors_are_honest(measured):
    """Over all three distances, as each alone is one draw of errors that hang together."""
    scaled = [((found.psf - truth) / found.std, truth > truth.max() / 4) for found, truth in measured.values()]
    assert 1 / 1.3 < np.sqrt(np.mean([np.mean(error**2) for error, _ in scaled])) < 1.3
    assert 1 / 1.5 < np.sqrt(np.mean([np.mean(error[core] ** 2) for error, core in scaled])) < 1.5


def test_fourier_shifts_mix_the_aliases_up(measured, rng):
    found, truth = measured[2.37]
    shifted = Point(oversampling=1).measure(shots(2.37, 21, rng), 21, Plain())
    assert wrong(shifted, truth) > 2 * wrong(found, truth)


def test_more_points_tell_more(measured, rng):
    few, truth = Point().measure(shots(1.63, 25, rng, count=1, points=2), 25, Plain()), measured[1.63][1]
    assert few.used == 4
    assert 1.5 < few.std.mean() / measured[1.63][0].std.mean() < 8
    assert wrong(few, truth) > wrong(measured[1.63][0], truth)


def test_bright_points_of_another_shape_do_not_tell_most(rng):
    """Two of sixteen, eight times as bright and more blurred: by energy they would be most of the fit (0.28)."""
    picture = photograph(1.63, 25, rng, points=4)
    for cell in ((slice(56, 104), slice(56, 104)), (slice(104, 152), slice(8, 56))):
        picture[cell] = 0.03 + 8 * (gaussian_filter(picture[cell], 3.0) - 0.03)
    found = Point().measure([Shot(picture, 1.63, "shot")], 25, Plain())
    assert found.used == 14
    assert wrong(found, Pupil()(LAB, 1.63, 25)) < 0.05


def test_a_point_on_a_pixel_edge_is_not_smeared(rng):
    """Half a pixel off at the sharpest, where a linear shift would halve the peak."""
    sharp = Point().measure(shots(4.9, 13, rng, count=2), 13, Plain())
    truth = Pupil()(LAB, 4.9, 13)
    assert sharp.psf[6, 6] == pytest.approx(truth[6, 6], abs=0.05)


def test_the_imager_is_taken_out(rng):
    imager, truth = Laplacian(), Pupil()(LAB, 1.63, 25)
    found = Point().measure(shots(1.63, 25, rng, imager=imager), 25, imager)
    assert found.used == 18
    assert wrong(found, truth) < 0.15
    assert 1 / 2 < np.sqrt(np.mean(((found.psf - truth) / found.std) ** 2)) < 2


def test_a_pinhole_is_taken_out(rng):
    frames, truth = shots(1.63, 25, rng, pinhole=4.0), Pupil()(LAB, 1.63, 25)
    sharp, blurred = (Point(pinhole=d).measure(frames, 25, Plain()) for d in (4.0, 0.0))
    assert wrong(sharp, truth) < 0.15
    assert wrong(blurred, truth) > 1.7 * wrong(sharp, truth)


def test_what_is_not_a_good_point_is_left_out_with_its_reason(rng):
    picture = photograph(1.63, 25, rng, points=4)
    cell = 48
    centres = 8 + cell // 2 + cell * np.moveaxis(np.indices((4, 4)), 0, -1)
    y, x = centres[0, 0]
    picture[y, x] = np.nan
    y, x = centres[1, 1]
    picture[y - 9 : y + 10, x - 5 : x + 3] += 0.3
    y, x = centres[2, 2]
    picture[y - 20 : y + 20, x + 18 : x + 24] = picture[y - 20 : y + 20, x - 3 : x + 3]
    found = Point().measure([Shot(picture, 1.63, "shot")], 25, Plain())
    reasons = " ".join(found.rejected)
    assert "saturated" in reasons
    assert "shape unlike the rest" in reasons
    assert "too near to another point" in reasons
    assert found.used == 13
    assert wrong(found, Pupil()(LAB, 1.63, 25)) < 0.05


def test_the_manifest_may_say_where_the_point_is(rng):
    picture = photograph(1.63, 25, rng)
    found = Point().measure([Shot(picture, 1.63, "shot", centre=(33.0, 31.0))], 25, Plain())
    assert found.used == 1
    assert wrong(found, Pupil()(LAB, 1.63, 25)) < 0.15


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (lambda p, rng: 0.03 + 0.002 * rng.standard_normal(p.shape), "no point was found in shot"),
        (lambda p, rng: np.where(p > 0.4, np.nan, p), "every point was rejected.*saturated"),
        (lambda p, rng: p[16:48, 16:48], "too near to the border"),
    ],
)
def test_a_target_that_cannot_be_measured_is_refused(rng, spoil, sentence):
    picture = spoil(photograph(1.63, 25, rng), rng)
    with pytest.raises(PsflutError, match=sentence):
        Point().measure([Shot(picture, 1.63, "shot")], 25, Plain())


def test_a_brighter_neighbour_is_not_measured_in_a_points_place(rng):
    picture = photograph(2.37, 21, rng)
    picture = picture + 3 * np.roll(picture, 11, axis=1)
    with pytest.raises(PsflutError, match="other light beside it"):
        Point().measure([Shot(picture, 2.37, "shot", centre=(28.0, 28.0))], 21, Plain())
