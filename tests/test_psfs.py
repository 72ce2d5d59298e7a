"""The contract of the family; pillbox and Gaussian against analysis; the pupil has a file of its own."""

import dataclasses

import numpy as np
import pytest
from lenses import LAB, THESIS, at_radius, cropped, moments
from scipy.integrate import quad
from scipy.special import erfinv, j1

from psflut import family
from psflut.errors import PsflutError
from psflut.optics import Camera, blur_radius
from psflut.psfs.gaussian import Gaussian
from psflut.psfs.pillbox import Pillbox

AT_INFINITY = Camera(focal_length=0.05, aperture_diameter=0.02, detector_distance=0.05, pixel_pitch=5e-6)


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
