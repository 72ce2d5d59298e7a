"""Inverse pairs, the thesis' own numbers, geometry done another way, and cameras that cannot be."""

import numpy as np
import pytest

from psflut.errors import PsflutError
from psflut.optics import (
    Camera,
    blur_radius,
    defocus,
    defocus_wavefront,
    distance_at_blur,
    image_distance,
    object_distance,
    vergence,
)

THESIS = Camera(focal_length=0.1, aperture_diameter=6e-3, detector_distance=0.101, pixel_pitch=25e-6)
LAB = Camera.of(focus_distance=6.0, focal_length=16e-3, aperture_diameter=8e-3, pixel_pitch=6e-6)
AT_INFINITY = Camera(focal_length=0.05, aperture_diameter=0.02, detector_distance=0.05, pixel_pitch=5e-6)
cameras = pytest.mark.parametrize("camera", [THESIS, LAB, AT_INFINITY], ids=["thesis", "lab", "infinity"])

DISTANCES = np.array([0.7, 1.83, 3.2, 4.0, 4.5, 7.0, 60.0])


@cameras
def test_object_and_image_distance_are_inverse(camera):
    images = image_distance(camera.focal_length, DISTANCES)
    assert np.all(images > camera.focal_length)
    np.testing.assert_allclose(object_distance(camera.focal_length, images), DISTANCES, rtol=1e-9)


def test_a_lens_images_two_focal_lengths_onto_two_focal_lengths_and_infinity_onto_one():
    np.testing.assert_allclose(image_distance(0.05, [0.1, np.inf]), [0.1, 0.05], rtol=1e-12)


@cameras
def test_blur_radius_and_distance_are_inverse_on_both_sides_of_the_focus(camera):
    np.testing.assert_allclose(distance_at_blur(camera, blur_radius(camera, DISTANCES)), DISTANCES, rtol=1e-9)


@cameras
def test_blur_radius_is_that_of_the_similar_triangles(camera):
    """The cone from the aperture to the image, cut at the detector: r = D (zi - zd) / (2 zi)."""
    images = image_distance(camera.focal_length, DISTANCES)
    cone = 0.5 * camera.aperture_diameter * (images - camera.detector_distance) / images
    np.testing.assert_allclose(blur_radius(camera, DISTANCES), cone, rtol=1e-9, atol=1e-15)


@cameras
def test_blur_vanishes_at_the_focus_and_changes_sign_there(camera):
    focus = camera.focus_distance
    assert blur_radius(camera, focus) == pytest.approx(0.0, abs=1e-14)
    assert blur_radius(camera, min(0.9 * focus, 100.0)) > 1e-8
    if np.isfinite(focus):
        assert blur_radius(camera, 1.1 * focus) < -1e-8


@pytest.mark.parametrize(("distance", "micrometres"), [(3.2, 64.7), (4.0, 45.7), (4.5, 37.3)])
def test_thesis_blur_radii(distance, micrometres):
    assert 1e6 * blur_radius(THESIS, distance) == pytest.approx(micrometres, abs=0.06)


def test_thesis_camera_is_in_focus_at_ten_metres_and_not_at_its_farthest_distance():
    assert THESIS.focus_distance == pytest.approx(10.1)


def test_a_camera_of_a_focus_keeps_the_focus_and_the_other_lengths():
    assert LAB.focus_distance == pytest.approx(6.0)
    assert (LAB.f_number, LAB.pixel_pitch, LAB.wavelength) == (2.0, 6e-6, 550e-9)
    assert AT_INFINITY.focus_distance == np.inf


@cameras
def test_defocus_is_a_difference_of_vergences(camera):
    np.testing.assert_allclose(defocus(camera, DISTANCES) - defocus(camera, np.inf), 1.0 / DISTANCES, rtol=1e-9)
    np.testing.assert_allclose(vergence(vergence(DISTANCES)), DISTANCES, rtol=1e-15)


@cameras
def test_defocus_wavefront_is_the_gap_between_two_spheres_at_the_rim(camera):
    """Paths from the rim to the image and from the rim to the detector, not the paraxial formula."""
    rim = 0.5 * camera.aperture_diameter
    for distance in (1.83, 4.0):
        image, detector = float(image_distance(camera.focal_length, distance)), camera.detector_distance
        gap = (np.hypot(rim, detector) - detector) - (np.hypot(rim, image) - image)
        # A sphere is not a paraboloid: at f/2 they part by some 3 %.
        assert defocus_wavefront(camera, distance) == pytest.approx(gap, rel=2.0 * (rim / detector) ** 2)


@cameras
def test_slope_of_the_wavefront_at_the_rim_is_the_blur_radius(camera):
    slope = 2.0 * defocus_wavefront(camera, DISTANCES) / (0.5 * camera.aperture_diameter)
    np.testing.assert_allclose(camera.detector_distance * slope, blur_radius(camera, DISTANCES), rtol=1e-9)


LENGTHS = {
    "focal_length": 0.1,
    "aperture_diameter": 6e-3,
    "detector_distance": 0.101,
    "pixel_pitch": 25e-6,
    "wavelength": 550e-9,
}


@pytest.mark.parametrize("name", LENGTHS)
@pytest.mark.parametrize("value", [0.0, -0.1, np.nan, np.inf])
def test_a_camera_with_an_impossible_length_is_refused_by_name(name, value):
    with pytest.raises(PsflutError, match=f"{name} must be a positive length"):
        Camera(**{**LENGTHS, name: value})


def test_a_detector_before_the_focal_plane_is_refused():
    assert Camera(**{**LENGTHS, "detector_distance": 0.1}).focus_distance == np.inf
    with pytest.raises(PsflutError, match="nothing is ever in focus"):
        Camera(**{**LENGTHS, "detector_distance": 0.0999})


@pytest.mark.parametrize("focus", [0.05, 0.02, -6.0, np.nan])
def test_a_focus_within_the_focal_length_is_refused(focus):
    with pytest.raises(PsflutError, match="must exceed focal_length"):
        Camera.of(focus_distance=focus, focal_length=0.05, aperture_diameter=0.02, pixel_pitch=5e-6)


def test_f_number_and_aperture_say_the_same():
    terms = {"focal_length": 16e-3, "pixel_pitch": 6e-6, "focus_distance": 6.0}
    assert Camera.of(f_number=2, **terms) == Camera.of(aperture_diameter=8e-3, **terms)
    assert Camera.of(f_number=2, **terms).f_number == pytest.approx(2)
    for pair in ({}, {"f_number": 2, "aperture_diameter": 8e-3}):
        with pytest.raises(PsflutError, match="either aperture_diameter or f_number"):
            Camera.of(**terms, **pair)
