"""Every imager keeps the contract of the family; the Laplacian and the ganglion's hat are what they say."""

import numpy as np
import pytest
from scipy import fft, ndimage

from psflut import family
from psflut.errors import PsflutError

FAMILY = "psflut.imagers"
NAMES = family.names(FAMILY)


@pytest.fixture(params=NAMES)
def imager(request):
    return family.make(FAMILY, request.param, {})


def test_kernel_is_odd_and_symmetric(imager):
    kernel = imager.kernel()
    assert kernel.dtype == np.float64
    assert kernel.ndim == 2
    assert kernel.shape[0] == kernel.shape[1]
    assert kernel.shape[0] % 2 == 1
    for other in (kernel[::-1], kernel[:, ::-1], kernel.T):
        np.testing.assert_allclose(kernel, other, rtol=0, atol=1e-15)


@pytest.mark.parametrize("shape", [(40, 40), (41, 52)])
def test_transfer_is_that_of_the_response_to_an_impulse(imager, shape):
    impulse = np.zeros(shape)
    middle = (shape[0] // 2, shape[1] // 2)
    impulse[middle] = 1
    response = np.roll(imager.response(impulse), (-middle[0], -middle[1]), axis=(0, 1))
    transfer = imager.transfer(shape)
    assert transfer.shape == (shape[0], shape[1] // 2 + 1)
    np.testing.assert_allclose(transfer, fft.rfft2(response), rtol=0, atol=1e-12)


def test_a_flat_picture_stays_flat_to_its_border_and_vanishes_on_a_signed_imager(imager):
    kernel, flat = imager.kernel(), np.full((30, 33), 0.7)
    np.testing.assert_allclose(imager.response(flat), 0.7 * kernel.sum(), rtol=0, atol=1e-13)
    if imager.signed:
        assert abs(kernel.sum()) < 1e-14
        assert abs(imager.transfer((30, 33))[0, 0]) < 1e-14
        assert kernel[kernel.shape[0] // 2, kernel.shape[0] // 2] == kernel.max() > 0
    else:
        assert kernel.sum() == pytest.approx(1)


def test_an_imager_describes_itself(imager):
    assert family.parse(FAMILY, family.describe(imager)) == imager


def test_the_plain_imager_changes_nothing():
    picture = np.random.default_rng(0).random((9, 12)).astype(np.float32)
    np.testing.assert_array_equal(family.parse(FAMILY, "plain").response(picture), picture)


def test_laplacian_has_the_coefficients_of_the_thesis():
    sixths = np.array([[-1, -4, -1], [-4, 20, -4], [-1, -4, -1]]) / 6
    np.testing.assert_allclose(family.parse(FAMILY, "laplacian").kernel(), sixths, rtol=1e-14)


@pytest.mark.parametrize("alpha", [0.01, 0.2, 0.5, 0.99])
def test_laplacian_is_the_second_derivative(alpha):
    laplacian = family.parse(FAMILY, f"laplacian:{alpha}")
    y, x = np.mgrid[:20, :24].astype(float)
    inside = laplacian.response(1.5 * x**2 - 0.4 * y**2 + 0.3 * x * y)[1:-1, 1:-1]
    np.testing.assert_allclose(inside, -2 * (1.5 - 0.4), atol=1e-10)
    u, v = fft.rfftfreq(512), fft.fftfreq(512)[:, None]
    low = laplacian.transfer((512, 512)) / np.where(u + abs(v), (2 * np.pi) ** 2 * (u**2 + v**2), np.nan)
    assert abs(low[:4, :4].ravel()[1:] - 1).max() < 1e-3


@pytest.mark.parametrize("alpha", [0.0, 1.0, -0.1, 1.5, np.nan])
def test_laplacian_refuses_alpha_outside_its_range(alpha):
    with pytest.raises(PsflutError, match="alpha must lie between 0 and 1"):
        family.make(FAMILY, "laplacian", {"alpha": alpha})


@pytest.mark.parametrize(("centre", "surround"), [(1.0, 1.6), (0.8, 3.0)])
def test_dog_is_the_difference_of_two_gaussian_blurs(centre, surround):
    picture = np.random.default_rng(1).random((60, 50))
    dog = family.make(FAMILY, "dog", {"centre": centre, "surround": surround})
    blurs = [ndimage.gaussian_filter(picture, sigma, truncate=8.0) for sigma in (centre, surround)]
    np.testing.assert_allclose(dog.response(picture), blurs[0] - blurs[1], atol=2e-4)


@pytest.mark.parametrize("widths", [(0.0, 1.0), (1.6, 1.6), (2.0, 1.0), (1.0, np.inf), (np.nan, 1.0)])
def test_dog_refuses_widths_that_make_no_hat(widths):
    with pytest.raises(PsflutError, match="0 < centre < surround"):
        family.make(FAMILY, "dog", {"centre": widths[0], "surround": widths[1]})
