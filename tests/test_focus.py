"""The measure of focus is the power of the tapered spectrum, falls with blur, and knows what noise adds."""

import numpy as np
import pytest
from scipy import fft, ndimage

from psflut import focus
from psflut.errors import PsflutError
from psflut.imagers.laplacian import Laplacian


@pytest.fixture
def picture():
    return np.random.default_rng(5).random((48, 60)).cumsum(axis=0).cumsum(axis=1) / 100 % 1


def test_the_window_has_its_width_in_fractions_of_each_side():
    window = focus.gaussian_window((101, 201), 0.2)
    assert window[50, 100] == pytest.approx(1)
    np.testing.assert_allclose(window, window[::-1, ::-1])
    # One sd from the middle: 0.2 x 101 rows, 0.2 x 201 columns.
    assert np.interp(50 + 20.2, np.arange(101), window[:, 100]) == pytest.approx(np.exp(-0.5), abs=1e-3)
    assert np.interp(100 + 40.2, np.arange(201), window[50]) == pytest.approx(np.exp(-0.5), abs=1e-3)


@pytest.mark.parametrize("sd", [0.0, -1.0, np.nan])
def test_a_window_without_width_is_refused(sd):
    with pytest.raises(PsflutError, match="positive fraction"):
        focus.gaussian_window((8, 8), sd)


def test_it_is_the_power_of_the_spectrum(picture):
    window = focus.gaussian_window(picture.shape, 0.2)
    mean = np.average(picture, weights=window)
    spectrum = fft.fft2(window * (picture - mean))
    assert abs(spectrum[0, 0]) < 1e-10
    assert focus.focus_measure(picture, window) == pytest.approx((abs(spectrum) ** 2).sum() / picture.size)


def test_the_level_does_not_count_and_the_contrast_does(picture):
    window = focus.gaussian_window(picture.shape, 0.2)
    measures = focus.focus_measure(np.stack([picture, picture + 7, 3 * picture]), window)
    assert measures.shape == (3,)
    np.testing.assert_allclose(measures / measures[0], [1, 1, 9])


def test_it_falls_with_blur(picture):
    window = focus.gaussian_window(picture.shape, 0.35)
    edges = Laplacian().response(picture)
    blurred = [ndimage.gaussian_filter(edges, sigma) for sigma in np.linspace(0.3, 4, 20)]
    assert np.all(np.diff(focus.focus_measure(np.stack(blurred), window)) < 0)


@pytest.mark.parametrize("sd", [0.1, 0.35])
@pytest.mark.parametrize("kernel", [np.ones((1, 1)), Laplacian().kernel(), np.arange(15).reshape(3, 5) / 60])
def test_noise_is_subtracted_without_bias(picture, kernel, sd):
    """Over 400 draws the mean of Phi less `noise_power` is Phi of the clean picture, within 4 errors."""
    rng = np.random.default_rng(11)
    window = focus.gaussian_window(picture.shape, sd)
    white = rng.normal(0, 0.3, (400, picture.shape[0] + 8, picture.shape[1] + 8))
    noise = ndimage.convolve(white, kernel[None])[:, 4:-4, 4:-4]
    expected = focus.noise_power(window, 0.3, kernel)
    draws = focus.focus_measure(picture + noise, window) - focus.focus_measure(picture, window)
    error = draws.std() / np.sqrt(len(draws))
    assert abs(draws.mean() - expected) < 4 * error
    assert expected > 20 * error  # the control: what is subtracted is far from nothing


def test_noise_power_takes_off_the_mean_exactly():
    """Under a flat window Phi of white noise is (N - 1) sigma^2, the sum of squares about the sample mean."""
    assert focus.noise_power(np.ones((6, 7)), 0.5) == pytest.approx(41 * 0.25)


def test_noise_power_is_the_trace_of_the_whole_chain():
    """Phi of noise is |A n|^2 with a matrix A, so its expectation is sigma^2 times the squares in A."""
    kernel, window = np.arange(1.0, 16).reshape(3, 5) / 60, focus.gaussian_window((6, 7), 0.3)
    impulses = np.eye(10 * 13).reshape(-1, 10, 13)
    columns = ndimage.convolve(impulses, kernel[None], mode="constant")[:, 2:-2, 3:-3]
    expected = focus.focus_measure(columns, window).sum()
    assert focus.noise_power(window, 0.7, kernel) == pytest.approx(0.7**2 * expected)
