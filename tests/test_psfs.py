"""The contract of the family; each model against analysis; the pupil against prysm, written by others."""

import dataclasses

import numpy as np
import pytest
from prysm.coordinates import cart_to_polar, make_xy_grid
from prysm.geometry import circle
from prysm.polynomials import zernike_nm
from prysm.propagation import Wavefront
from scipy.integrate import quad
from scipy.special import erfinv, j1

from psflut import family
from psflut.errors import PsflutError
from psflut.optics import Camera, blur_radius, defocus_wavefront, distance_at_blur
from psflut.psfs.gaussian import Gaussian
from psflut.psfs.pillbox import Pillbox
from psflut.psfs.pupil import Pupil

THESIS = Camera(focal_length=0.1, aperture_diameter=6e-3, detector_distance=0.101, pixel_pitch=25e-6)
LAB = Camera.of(focus_distance=6.0, focal_length=16e-3, aperture_diameter=8e-3, pixel_pitch=6e-6)
FINE = Camera.of(focus_distance=6.0, focal_length=16e-3, aperture_diameter=8e-3, pixel_pitch=0.15e-6)
AT_INFINITY = Camera(focal_length=0.05, aperture_diameter=0.02, detector_distance=0.05, pixel_pitch=5e-6)
AIRY = FINE.wavelength * FINE.detector_distance / FINE.aperture_diameter
"""lambda zd / D of FINE, in metres: the first dark ring of the Airy pattern has 1.22 times this radius."""


def at_radius(camera, pixels):
    """Distance at which the geometric blur disc has this signed radius, in pixels."""
    return float(distance_at_blur(camera, pixels * camera.pixel_pitch))


def moments(psf):
    """Centroid (x, y) and second moments (xx, yy, xy) about it, in pixels from the central one."""
    y, x = np.mgrid[: len(psf), : len(psf)] - len(psf) // 2
    mx, my = np.sum(psf * x), np.sum(psf * y)
    second = [np.sum(psf * a) for a in ((x - mx) ** 2, (y - my) ** 2, (x - mx) * (y - my))]
    return mx, my, *second


# --- the contract, over whatever files the folder holds ---

every_model = pytest.mark.parametrize("name", family.names("psflut.psfs"))


@every_model
@pytest.mark.parametrize(
    ("camera", "distance", "size"),
    [
        (THESIS, 3.2, 13),
        (THESIS, 4.5, 9),
        (THESIS, 10.1, 7),
        (THESIS, 40.0, 15),
        (LAB, 0.8, 51),
        (LAB, 1.83, 25),
        (LAB, 6.0, 9),
        (LAB, np.inf, 15),
        (AT_INFINITY, 40.0, 21),
        (AT_INFINITY, np.inf, 5),
    ],
)
def test_psf_is_a_centred_distribution_of_the_size_asked_for(name, camera, distance, size):
    psf = family.load("psflut.psfs", name)()(camera, distance, size)
    assert psf.shape == (size, size)
    assert psf.dtype == np.float64
    assert np.all(psf >= 0.0)
    assert psf.sum() == pytest.approx(1.0, abs=1e-12)
    mx, my, *_ = moments(psf)
    assert (mx, my) == pytest.approx((0.0, 0.0), abs=1e-9)
    # Without settings a lens is round: eight-fold symmetric on the pixels.
    np.testing.assert_allclose(psf, psf[::-1], atol=1e-12)
    np.testing.assert_allclose(psf, psf.T, atol=1e-12)


@every_model
def test_psf_widens_away_from_the_focus_on_both_sides(name):
    model = family.load("psflut.psfs", name)()
    for distances in ((6.0, 3.0, 1.5, 1.0), (6.0, 12.0, np.inf)):
        widths = [moments(model(LAB, distance, 49))[2] for distance in distances]
        assert np.all(np.diff(widths) > 0.2)


def cropped(psf, size):
    """The middle of a larger window, renormalised."""
    edge = (len(psf) - size) // 2
    return psf[edge:-edge, edge:-edge] / psf[edge:-edge, edge:-edge].sum()


@every_model
def test_a_larger_window_shows_the_same_psf(name):
    model = family.load("psflut.psfs", name)()
    psf, wide = model(LAB, 1.83, 17), model(LAB, 1.83, 61)
    np.testing.assert_allclose(psf, cropped(wide, 17), atol=2e-3 * psf.max())


@every_model
def test_a_model_is_its_settings_and_its_psf_is_the_same_every_time(name):
    model = family.load("psflut.psfs", name)()
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(model, dataclasses.fields(model)[0].name if dataclasses.fields(model) else "new", 1)
    np.testing.assert_array_equal(model(LAB, 1.83, 21), model(LAB, 1.83, 21))
    assert family.parse("psflut.psfs", family.describe(model)) == model


@every_model
def test_a_window_too_small_for_the_blur_is_refused(name):
    with pytest.raises(PsflutError, match=r"15 pixels.*take a larger size"):
        family.load("psflut.psfs", name)()(LAB, 0.8, 15)


# --- pillbox ---


@pytest.mark.parametrize("radius", [0.3, 0.5, 0.61, 0.75, 1.5, 2.7, -3.33, 4.5])
def test_pillbox_is_the_area_of_the_disc_in_each_pixel(radius):
    size, fine = 9, 300
    line = (np.arange(size * fine) + 0.5) / fine - size / 2
    inside = line[:, None] ** 2 + line[None, :] ** 2 <= radius**2
    counted = inside.reshape(size, fine, size, fine).sum(axis=(1, 3)) / (fine**2 * np.pi * radius**2)
    psf = Pillbox()(LAB, at_radius(LAB, radius), size)
    np.testing.assert_allclose(psf, counted / counted.sum(), atol=3e-4 * psf.max())


def transfer(psf, fx, fy):
    """Fourier transform of the pixels, centred, at frequencies in cycles a pixel."""
    n = np.arange(len(psf)) - len(psf) // 2
    return np.einsum("ky,yx,kx->k", np.exp(-2j * np.pi * np.outer(fy, n)), psf, np.exp(-2j * np.pi * np.outer(fx, n)))


def sampled(otf, fx, fy, orders):
    """An OTF as square pixels sample it: times the sinc of the pixel, repeated at every cycle a pixel."""
    k = np.arange(-orders, orders + 1)
    gx, gy = (fx[:, None, None] + k[None, None, :]), (fy[:, None, None] + k[None, :, None])
    return np.sum(otf(np.hypot(gx, gy)) * np.sinc(gx) * np.sinc(gy), axis=(1, 2))


FX = np.array([0.0, 0.05, 0.13, 0.2, 0.31, 0.5, 0.37, 0.02])
FY = np.array([0.0, 0.0, 0.07, 0.2, 0.0, 0.11, 0.37, 0.48])


@pytest.mark.parametrize("radius", [0.8, 2.3, 6.44])
def test_pillbox_has_the_bessel_otf(radius):
    """Equation 2.5.5, rho in radians a metre and r in metres."""
    distance = at_radius(LAB, radius)

    def bessel(cycles_per_pixel):
        a = blur_radius(LAB, distance) * 2.0 * np.pi * cycles_per_pixel / LAB.pixel_pitch
        return 2.0 * j1(a + 1e-12) / (a + 1e-12)

    psf = Pillbox()(LAB, distance, 21)
    np.testing.assert_allclose(transfer(psf, FX, FY), sampled(bessel, FX, FY, 40), atol=2e-4)


# --- Gaussian ---


@pytest.mark.parametrize("radius", [0.5, 1.5, -4.0])
def test_gaussian_has_the_gaussian_otf(radius):
    """Equation 2.5.7, rho in radians a metre and r in metres."""
    distance = at_radius(LAB, radius)

    def gaussian(cycles_per_pixel):
        rho = 2.0 * np.pi * cycles_per_pixel / LAB.pixel_pitch
        return np.exp(-0.25 * blur_radius(LAB, distance) ** 2 * rho**2)

    psf = Gaussian()(LAB, distance, 49)
    np.testing.assert_allclose(transfer(psf, FX, FY), sampled(gaussian, FX, FY, 5), atol=1e-9)


def test_gaussian_is_refused_just_when_the_window_cuts_off_one_per_cent():
    def cutting(share, size=9):
        return at_radius(LAB, size / 2 / erfinv(np.sqrt(1.0 - share)))

    assert Gaussian()(LAB, cutting(0.0099), 9).sum() == pytest.approx(1.0)
    with pytest.raises(PsflutError, match=r"9 pixels must hold 99 % .* cuts off 1\.[01] %"):
        Gaussian()(LAB, cutting(0.0101), 9)


@pytest.mark.parametrize(("distance", "per_cent"), [(3.2, 31), (4.0, 10), (4.5, 4)])
def test_five_pixels_cut_off_what_the_docstring_says(distance, per_cent):
    energy = Gaussian()(THESIS, distance, 41)[18:23, 18:23].sum()
    assert round(100 * (1.0 - energy)) == per_cent
    assert f"{31}, {10} and {4} % of the energy" in Gaussian.__doc__


@pytest.mark.parametrize("radius", [0.0, 0.6, 1.49, 2.59])
@pytest.mark.parametrize("fir", [3, 5, 7])
def test_fir_is_the_inverse_transform_of_the_otf_times_the_window(radius, fir):
    """The integral over one cycle a pixel, by quadrature; the window in two dimensions, by its radius."""

    def tap(n):
        return quad(lambda f: np.exp(-((np.pi * radius * f) ** 2)) * np.cos(2 * np.pi * f * n), -0.5, 0.5)[0]

    half = fir // 2
    taps = np.array([tap(n) for n in range(-half, half + 1)])
    y, x = np.mgrid[-half : half + 1, -half : half + 1]
    expected = np.maximum(np.outer(taps, taps) * np.exp(-0.5 * (2.5 * np.hypot(x, y) / half) ** 2), 0.0)
    # The OTF ends at half a cycle a pixel, so taps of a narrow spot ring below zero; two such make no weight.
    expected[(taps < 0)[:, None] & (taps < 0)[None, :]] = 0.0
    psf = Gaussian(fir=fir)(THESIS, at_radius(THESIS, radius), 11)
    middle = slice(5 - half, 6 + half)
    np.testing.assert_allclose(psf[middle, middle], expected / expected.sum(), atol=1e-5)
    assert np.count_nonzero(psf) == np.count_nonzero(psf[middle, middle])
    assert psf.sum() == pytest.approx(1.0, abs=1e-12)


def test_thesis_filter_fills_five_pixels_and_follows_a_narrower_gaussian():
    """Gaussian times Gaussian window: 1 / r^2 + 0.78 takes the place of 1 / r^2."""
    for distance in (3.2, 4.0, 4.5):
        psf = Gaussian(fir=5)(THESIS, distance, 9)
        assert np.count_nonzero(psf) == np.count_nonzero(psf[2:7, 2:7]) == 25
        r = blur_radius(THESIS, distance) / THESIS.pixel_pitch
        fall = np.log(psf[4, 4] / psf[4, 5:7])
        np.testing.assert_allclose(fall, np.array([1, 4]) * (1 / r**2 + 0.5 * 1.25**2), rtol=0.02)


def test_fir_must_be_odd_and_fit():
    for fir in (4, 0, -3):
        with pytest.raises(PsflutError, match="fir must be odd"):
            Gaussian(fir=fir)
    np.testing.assert_array_equal(Gaussian(fir=1)(THESIS, 4.0, 1), [[1.0]])
    assert Gaussian(fir=5)(THESIS, 4.0, 5).shape == (5, 5)
    with pytest.raises(PsflutError, match="at least fir = 5 pixels, got 3"):
        Gaussian(fir=5)(THESIS, 4.0, 3)


# --- pupil: analysis ---


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


# --- pupil: orientation ---


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


# --- pupil: refusals ---


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


# --- pupil: prysm, an independent implementation ---

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
