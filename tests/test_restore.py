"""Restoration keeps borders, precision and units; Wiener undoes blur and agrees with scikit-image."""

import numpy as np
import pytest
from blurs import capture, gaussian, rms
from scipy import fft, ndimage
from skimage import restoration
from skimage.restoration import uft

from psflut import fourier, restore
from psflut.errors import PsflutError

# --- what is shared


@pytest.mark.parametrize("shape", [(20, 31), (9, 9)])
def test_an_image_is_continued_without_a_seam(shape):
    rows = np.linspace(1, 4, shape[0])[:, None] * np.linspace(0.5, 1, shape[1])
    grid = fourier.padded_shape(shape, 9)
    for total, side in zip(grid, shape, strict=True):
        assert fft.next_fast_len(total, real=True) == total >= side + 18
    around = fourier.continued(rows, grid)
    np.testing.assert_array_equal(around[: shape[0], : shape[1]], rows)
    steps = [abs(np.diff(around, axis=axis, append=around.take([0], axis))).max() for axis in (0, 1)]
    assert max(steps) < 0.5  # the jump from end to end is 3
    assert around.min() >= rows.min()
    assert around.max() <= rows.max()


def test_transfer_convolves_about_the_middle(big):
    """With a lopsided PSF, which tells convolution from correlation and catches an offset."""
    psf = gaussian(1.5, 9, stretch=1.4, shift=1.0)
    image = big[:40, :45]
    blurred = fft.irfft2(fft.rfft2(image) * fourier.transfer(psf, image.shape), image.shape)
    np.testing.assert_allclose(blurred, ndimage.convolve(image, psf, mode="wrap"), atol=1e-13)


# --- Wiener


def test_wiener_inverts_blur_that_it_knows(big):
    psf = gaussian(1.0, 9, stretch=1.3, shift=0.7)
    scene, image = capture(big, psf)
    restored = restore.wiener(image, psf, 1e-6)
    inside = slice(40, -40), slice(40, -40)
    assert rms((restored - scene)[inside]) < 0.25 * rms((image - scene)[inside])
    point = np.zeros((9, 9))
    point[4, 4] = 1
    np.testing.assert_allclose(restore.wiener(image, point, 0.0), image, atol=1e-12)


def test_wiener_equals_scikit_image(big):
    """On the continued image, where the two border rules are one; the regulariser there is a Laplacian."""
    psf = gaussian(1.5, 9, stretch=1.4, shift=1.0)
    _, image = capture(big, psf, 0.01)
    around = fourier.continued(image, fourier.padded_shape(image.shape, 9))
    laplacian, _ = uft.laplacian(2, around.shape)
    theirs = restoration.wiener(around, psf, 0.1, clip=False)[: image.shape[0], : image.shape[1]]
    ours = restore.wiener(image, psf, 0.1 * abs(laplacian) ** 2)
    np.testing.assert_allclose(ours, theirs, atol=1e-10)


def test_wiener_with_the_true_ratio_beats_other_ratios():
    """A scene and noise of known spectra, whose least mean square error is then known too."""
    rng, psf, noise = np.random.default_rng(8), gaussian(1.5, 9), 0.05
    grid = fourier.padded_shape((90, 90), 9)
    frequency = np.hypot(fft.fftfreq(grid[0])[:, None], fft.rfftfreq(grid[1]))
    power = 1 / (1e-4 + frequency**2.5)
    scene = fft.irfft2(fft.rfft2(rng.normal(size=grid)) * np.sqrt(power), grid)
    otf = fourier.transfer(psf, grid)
    image = fft.irfft2(fft.rfft2(scene) * otf, grid) + rng.normal(0, noise, grid)
    ratio = noise**2 / power
    errors = []
    for factor in (0.1, 0.5, 1, 2, 10):
        filtered = fft.irfft2(fft.rfft2(image) * restore.wiener_filter(otf, factor * ratio), grid)
        errors.append(np.mean((filtered - scene) ** 2))
    assert np.argmin(errors) == 2
    weight = np.ones(frequency.shape)
    weight[:, 1 : (grid[1] + 1) // 2] = 2  # bins that rfft2 leaves out
    least = (weight * noise**2 / (abs(otf) ** 2 + ratio)).sum() / (grid[0] * grid[1])
    assert errors[2] == pytest.approx(least, rel=0.05)


def test_wiener_takes_many_psfs_at_once_and_passes_the_mean(big):
    _, image = capture(big, gaussian(1.5))
    psfs = np.stack([gaussian(1.0), gaussian(2.0)])
    both = restore.wiener(image - 0.5, psfs, 0.05)
    assert both.shape == (2, *image.shape)
    for restored, psf in zip(both, psfs, strict=True):
        np.testing.assert_allclose(restored, restore.wiener(image, psf, 0.05) - 0.5, atol=1e-12)
    np.testing.assert_allclose(restore.wiener(np.full((40, 40), 0.3), gaussian(2.0), 10.0), 0.3)


def test_what_neither_signal_nor_blur_holds_is_zero():
    np.testing.assert_array_equal(restore.wiener_filter(np.array([0j, 0.5 + 0j]), 0.0), [0, 2])


# --- borders


@pytest.mark.parametrize("method", ["wiener", "richardson_lucy", "blind_richardson_lucy"])
def test_borders_are_not_darkened(big, method):
    """An even scene stays even; along a photograph's border the error is at most 1.5 times that inside."""
    disc = (np.hypot(*np.mgrid[-8:9, -8:9]) <= 7.5).astype(float)
    disc /= disc.sum()
    solve = {
        "wiener": lambda image: restore.wiener(image, disc, 1e-3),
        "richardson_lucy": lambda image: restore.richardson_lucy(image, disc, 20),
        "blind_richardson_lucy": lambda image: restore.blind_richardson_lucy(image, disc, 20)[0],
    }[method]
    np.testing.assert_allclose(solve(np.full((60, 64), 0.8)), 0.8, rtol=1e-6)
    scene, image = capture(big, disc, 0.003)
    error = solve(image) - scene
    border = np.ones(error.shape, bool)
    border[8:-8, 8:-8] = False
    assert rms(error[border]) < 1.5 * rms(error[~border])
    assert abs(error[border].mean()) < 0.02
    if method == "richardson_lucy":  # the control: zeros beyond the border fail the same test
        theirs = restoration.richardson_lucy(image, disc, 20, clip=False) - scene
        assert rms(theirs[border]) > 3 * rms(theirs[~border])


# --- precision and refusals


def test_single_precision_gives_the_same_picture(big):
    psf = gaussian(1.5, 11)
    _, image = capture(big, psf, 0.005)
    for solve in (
        lambda g, h: restore.wiener(g, h, 1e-2),
        lambda g, h: restore.richardson_lucy(g, h, 20),
        lambda g, h: restore.blind_richardson_lucy(g, h, 20)[0],
    ):
        double, single = solve(image, psf), solve(image.astype(np.float32), psf)
        assert double.dtype == np.float64
        assert single.dtype == np.float32
        np.testing.assert_allclose(single, double, rtol=5e-3, atol=5e-4)


def test_nothing_is_clipped_and_units_do_not_matter(big):
    psf = gaussian(1.5, 11)
    _, image = capture(big, psf)
    for solve in (
        lambda g: restore.wiener(g, psf, 1e-2),
        lambda g: restore.richardson_lucy(g, psf, 10),
        lambda g: restore.blind_richardson_lucy(g, psf, 10)[0],
    ):
        np.testing.assert_allclose(solve(4095 * image), 4095 * solve(image), rtol=1e-6, atol=1e-6)


SPOT = gaussian(1.0, 5)


@pytest.mark.parametrize(
    ("image", "psf", "sentence"),
    [
        (np.ones((20, 20)) - 1.5, SPOT, "map a signed image by its minimum and maximum"),
        (np.zeros((20, 20)), SPOT, "nor all dark"),
        (np.full((20, 20), np.nan), SPOT, "must be finite"),
        (np.ones((20, 20)), 2 * SPOT, "must sum to 1"),
        (np.ones((20, 20)), SPOT[:4, :4], "must be odd"),
        (np.ones((20, 20)), SPOT[:, :3], "no larger"),
        (np.ones((4, 20)), SPOT, "no larger"),
        (np.ones((20, 20, 3)), SPOT, "expected an image"),
    ],
)
def test_unsound_input_is_refused(image, psf, sentence):
    with pytest.raises(PsflutError, match=sentence):
        restore.richardson_lucy(image, psf, 3)
    with pytest.raises(PsflutError, match=sentence):
        restore.blind_richardson_lucy(image, psf, 3)
    if "minimum" not in sentence and "dark" not in sentence:
        with pytest.raises(PsflutError, match=sentence):
            restore.wiener(image, psf, 0.1)


@pytest.mark.parametrize("ratio", [-0.1, np.nan, np.ones((20, 20))])
def test_an_unsound_noise_to_signal_is_refused(ratio):
    with pytest.raises(PsflutError, match="rfft2 grid"):
        restore.wiener(np.ones((20, 20)), SPOT, ratio)
