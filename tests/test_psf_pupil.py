"""The pupil's PSFs against analysis and orientation, and against prysm, written by others."""

import numpy as np
import pytest
from lenses import LAB, THESIS, at_radius, cropped, moments
from prysm.coordinates import cart_to_polar, make_xy_grid
from prysm.geometry import circle
from prysm.polynomials import zernike_nm
from prysm.propagation import Wavefront
from scipy.special import j1

from psflut.errors import PsflutError
from psflut.optics import Camera, defocus_wavefront, distance_at_blur
from psflut.psfs.pillbox import Pillbox
from psflut.psfs.pupil import Pupil

FINE = Camera.of(focus_distance=6.0, focal_length=16e-3, aperture_diameter=8e-3, pixel_pitch=0.15e-6)
AIRY = FINE.wavelength * FINE.detector_distance / FINE.aperture_diameter
"""lambda zd / D of FINE, in metres: the first dark ring of the Airy pattern has 1.22 times this radius."""


# --- analysis ---


def airy(camera, size, fine=25):
    """Energy of (2 J1(v) / v)^2 in each pixel, v = pi r in units of lambda zd / D, by subdivision."""
    line = ((np.arange(size * fine) + 0.5) / fine - size / 2) * camera.pixel_pitch
    v = np.pi / AIRY * np.hypot(line[:, None], line[None, :]) + 1e-12
    return ((2 * j1(v) / v) ** 2).reshape(size, fine, size, fine).sum(axis=(1, 3))


def test_pupil_in_focus_is_the_airy_pattern():
    psf, expected = Pupil()(FINE, 6.0, 41), airy(FINE, 41)
    np.testing.assert_allclose(psf, expected / expected.sum(), atol=1e-4 * psf.max())
    # The first dark ring, 1.22 lambda zd / D from the centre.
    ring = round(1.22 * AIRY / FINE.pixel_pitch)
    assert psf[20, 20 + ring] < 2e-3 * psf.max() < psf[20, 20 + ring + 3]


@pytest.mark.parametrize("waves", [1, 2, -3])
def test_whole_waves_of_defocus_darken_the_centre_and_halves_do_not(waves):
    """On the axis the intensity is sinc^2 of W020 in waves."""

    def centre(w020):
        radius = 4.0 * FINE.detector_distance / FINE.aperture_diameter * w020 * FINE.wavelength
        psf = Pupil()(FINE, float(distance_at_blur(FINE, radius)), 201)
        return psf[100, 100] / psf.max()

    assert centre(waves) < 0.03
    assert centre(waves + 0.5) > 0.3


def test_defocus_is_the_zernike_term_two_zero_with_the_sign_of_a_nearer_object():
    """2 rho^2 - 1: w waves of it are 2 w waves of W020. Spherical aberration tells the two signs apart."""
    for waves in (0.8, -0.8):
        radius = 8.0 * LAB.detector_distance / LAB.aperture_diameter * waves * LAB.wavelength
        distance = float(distance_at_blur(LAB, radius))
        assert (distance < 6.0) == (waves > 0)
        by_distance = Pupil(zernikes=((4, 0, 0.3),))(LAB, distance, 15)
        by_term = Pupil(zernikes=((4, 0, 0.3), (2, 0, waves)))(LAB, 6.0, 15)
        wrong = Pupil(zernikes=((4, 0, 0.3), (2, 0, -waves)))(LAB, 6.0, 15)
        np.testing.assert_allclose(by_term, by_distance, atol=1e-3 * by_distance.max())
        assert np.abs(wrong - by_distance).max() > 0.1 * by_distance.max()


def test_equal_blur_before_and_behind_the_focus_is_one_psf_until_spherical_aberration_parts_them():
    near, far = at_radius(LAB, 1.5), at_radius(LAB, -1.5)
    np.testing.assert_allclose(Pupil()(LAB, near, 15), Pupil()(LAB, far, 15), atol=1e-9)
    aberrated = Pupil(zernikes=((4, 0, 0.2),))
    assert np.abs(aberrated(LAB, near, 15) - aberrated(LAB, far, 15)).max() > 0.02


@pytest.mark.parametrize(
    ("zernikes", "distance", "size"),
    [((), 0.8, 25), (((4, 0, 1.5),), 2.0, 15), (((4, 0, 4.0),), 6.0, 19), (((3, 1, 5.0),), 6.0, 19)],
)
def test_light_that_leaves_the_window_does_not_come_back_on_the_other_side(zernikes, distance, size):
    model = Pupil(zernikes=zernikes)
    psf = model(LAB, distance, size)
    np.testing.assert_allclose(psf, cropped(model(LAB, distance, 61), size), atol=5e-3 * psf.max())


def test_pupil_tends_to_the_pillbox_as_the_wavelength_shrinks():
    """The share of the energy that lies elsewhere than in the pillbox: half the sum of |difference|."""
    distance = at_radius(LAB, 4.0)
    moved = []
    for mean in (2200e-9, 550e-9, 137e-9):
        model = Pupil(wavelengths=tuple(mean * np.linspace(0.85, 1.15, 5)))
        moved.append(0.5 * np.abs(model(LAB, distance, 21) - Pillbox()(LAB, distance, 21)).sum())
    assert moved[2] < 0.04
    assert moved[2] < 0.5 * moved[1] < 0.25 * moved[0]


def test_wavelengths_are_of_equal_energy_and_default_to_that_of_the_camera():
    blue, red = (Pupil(wavelengths=(w,))(LAB, 6.0, 41) for w in (450e-9, 650e-9))
    both = Pupil(wavelengths=(450e-9, 650e-9))(LAB, 6.0, 41)
    np.testing.assert_allclose(both, 0.5 * (blue + red), atol=1e-4)
    assert blue.max() - red.max() > 0.02
    green = Pupil(wavelengths=(LAB.wavelength,))(LAB, 3.0, 15)
    np.testing.assert_array_equal(green, Pupil()(LAB, 3.0, 15))


# --- orientation ---


@pytest.mark.parametrize(("term", "shift"), [((1, 1), (0, 3)), ((1, -1), (3, 0))], ids=["to +x", "to +y"])
def test_a_tilt_moves_the_psf_whole(term, shift):
    """A slope of W in waves per unit of rho moves the PSF by 2 zd / D times it."""
    waves = 3 * LAB.pixel_pitch / (2.0 * LAB.detector_distance / LAB.aperture_diameter * LAB.wavelength)
    still = Pupil()(LAB, 2.5, 31)
    moved = Pupil(zernikes=((*term, waves),))(LAB, 2.5, 31)
    back = Pupil(zernikes=((*term, -waves),))(LAB, 2.5, 31)
    np.testing.assert_allclose(moved, np.roll(still, shift, axis=(0, 1)), atol=2e-3 * still.max())
    np.testing.assert_allclose(back, np.roll(still, (-shift[0], -shift[1]), axis=(0, 1)), atol=2e-3 * still.max())


def test_coma_pulls_the_centroid_by_the_mean_slope_of_the_wavefront_and_flips_with_its_sign():
    """The mean of d(3 rho^3 cos theta - 2 rho cos theta)/dx over the pupil is 1, that of a tilt."""
    plus = Pupil(zernikes=((3, 1, 0.6),))(LAB, 2.5, 31)
    minus = Pupil(zernikes=((3, 1, -0.6),))(LAB, 2.5, 31)
    mx, my, *_ = moments(plus)
    slope = 2.0 * LAB.detector_distance / LAB.aperture_diameter * 0.6 * LAB.wavelength / LAB.pixel_pitch
    assert mx == pytest.approx(slope, rel=0.1)
    assert my == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(minus, plus[:, ::-1], atol=1e-9)
    assert np.abs(minus - plus).max() > 0.1 * plus.max()


def test_sine_terms_are_the_cosine_terms_turned_towards_y():
    along_x = Pupil(zernikes=((3, 1, 0.4),))(LAB, 2.5, 25)
    along_y = Pupil(zernikes=((3, -1, 0.4),))(LAB, 2.5, 25)
    np.testing.assert_allclose(along_y, along_x.T, atol=1e-9)
    assert moments(along_y)[1] > 0.1


def test_astigmatism_stretches_a_near_object_along_x_and_its_sine_term_along_the_diagonal():
    """Near, W020 > 0: adding w (x^2 - y^2) to W020 rho^2 is steepest along x, 2 w x y along x = y."""
    _, _, xx, yy, xy = moments(Pupil(zernikes=((2, 2, 0.4),))(LAB, 2.5, 25))
    assert xx > 1.3 * yy
    assert xy == pytest.approx(0.0, abs=1e-9)
    _, _, xx, yy, xy = moments(Pupil(zernikes=((2, -2, 0.4),))(LAB, 2.5, 25))
    assert xx == pytest.approx(yy)
    assert xy > 0.1 * xx


# --- refusals ---


@pytest.mark.parametrize("term", [(2, 1, 0.1), (1, 3, 0.1), (1, -3, 0.1), (-1, 1, 0.1), (4, 0, np.nan)])
def test_a_zernike_term_that_does_not_exist_is_refused(term):
    with pytest.raises(PsflutError, match="a Zernike term is"):
        Pupil(zernikes=((4, 0, 0.1), term))


@pytest.mark.parametrize("wavelength", [0.0, -550e-9, np.inf, np.nan])
def test_a_wavelength_that_is_no_length_is_refused(wavelength):
    with pytest.raises(PsflutError, match="wavelengths must be positive"):
        Pupil(wavelengths=(550e-9, wavelength))


def test_a_tilt_is_refused_when_it_moves_half_of_the_energy_out_of_the_window():
    """A tilt that puts the PSF on the window's edge leaves half of it inside."""
    edge = 4.5 * LAB.pixel_pitch / (2.0 * LAB.detector_distance / LAB.aperture_diameter * LAB.wavelength)
    assert Pupil(zernikes=((1, 1, 0.996 * edge),))(LAB, 6.0, 9).sum() == pytest.approx(1.0)
    with pytest.raises(PsflutError, match=r"9 pixels must hold half of the energy at 6.0 m, got 4\d %"):
        Pupil(zernikes=((1, 1, 1.004 * edge),))(LAB, 6.0, 9)


# --- prysm, an independent implementation ---

SUBDIVIDED = 21  # odd, so that prysm's central sample is the middle of the central pixel


def prysm_psf(camera, distance, size, zernikes, wavelengths):
    """The PSF by prysm (in mm, um and nm): sharp mask, matrix Fourier transforms, subdivided pixels."""
    diameter = 1e3 * camera.aperture_diameter
    x, y = make_xy_grid(512, diameter=diameter)
    radius, angle = cart_to_polar(x, y)
    rho = radius / (0.5 * diameter)
    path = 1e9 * defocus_wavefront(camera, distance) * rho**2
    for n, m, waves in zernikes:
        path = path + 1e9 * camera.wavelength * waves * zernike_nm(n, m, rho, angle, norm=False)
    total = np.zeros((size, size))
    for wavelength in wavelengths:
        lens = Wavefront.from_amp_and_phase(circle(0.5 * diameter, radius), path, 1e6 * wavelength, x[0, 1] - x[0, 0])
        image = lens.focus_fixed_sampling(
            1e3 * camera.detector_distance, 1e6 * camera.pixel_pitch / SUBDIVIDED, size * SUBDIVIDED
        )
        total += image.intensity.data.reshape(size, SUBDIVIDED, size, SUBDIVIDED).sum(axis=(1, 3))
    return total / total.sum()


ABERRATED = ((4, 0, 0.25), (3, 1, 0.3), (3, -1, 0.2), (2, 2, 0.2), (2, -2, -0.3), (5, -3, 0.1))


@pytest.mark.parametrize("zernikes", [((4, 0, -0.3),), ABERRATED], ids=["spherical", "aberrated"])
@pytest.mark.parametrize(
    ("camera", "distance", "size"),
    [(LAB, 1.3, 19), (LAB, 3.0, 11), (LAB, np.inf, 9), (THESIS, 3.2, 9)],
)
def test_pupil_agrees_with_prysm(camera, distance, size, zernikes):
    wavelengths = (470e-9, 550e-9, 630e-9)
    ours = Pupil(zernikes=zernikes, wavelengths=wavelengths)(camera, distance, size)
    theirs = prysm_psf(camera, distance, size, zernikes, wavelengths)
    np.testing.assert_allclose(ours, theirs, atol=4e-3 * theirs.max())
