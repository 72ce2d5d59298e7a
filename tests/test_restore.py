"""Restoration undoes blur, agrees with scikit-image, keeps borders, and blind does what it says."""

import numpy as np
import pytest
from scipy import fft, ndimage, signal
from skimage import data, restoration
from skimage.restoration import uft

from psflut import restore
from psflut.errors import PsflutError


def gaussian(sigma, size=17, stretch=1.0, shift=0.0):
    """A Gaussian spot, sum 1; `stretch` and `shift` (pixels, down) make it lopsided."""
    y, x = np.mgrid[:size, :size] - size // 2
    spot = np.exp(-0.5 * ((y - shift) ** 2 / stretch**2 + x**2) / sigma**2)
    return spot / spot.sum()


def rms(error):
    return np.sqrt(np.mean(np.square(error)))


@pytest.fixture(scope="module")
def big():
    return data.camera()[::2, ::2] / 255.0


def capture(big, psf, noise=0.0):
    """A scene of 128 x 128 and its capture, whose border saw what lies beyond."""
    window = slice(60, 188), slice(60, 188)
    image = ndimage.convolve(big, psf, mode="reflect")[window]
    image = image + np.random.default_rng(3).normal(0, noise, image.shape)
    return big[window], np.maximum(image, 0)


# --- what is shared


@pytest.mark.parametrize("shape", [(20, 31), (9, 9)])
def test_an_image_is_continued_without_a_seam(shape):
    rows = np.linspace(1, 4, shape[0])[:, None] * np.linspace(0.5, 1, shape[1])
    grid = restore.padded_shape(shape, 9)
    for total, side in zip(grid, shape, strict=True):
        assert fft.next_fast_len(total, real=True) == total >= side + 18
    around = restore.continued(rows, grid)
    np.testing.assert_array_equal(around[: shape[0], : shape[1]], rows)
    steps = [abs(np.diff(around, axis=axis, append=around.take([0], axis))).max() for axis in (0, 1)]
    assert max(steps) < 0.5  # the jump from end to end is 3
    assert around.min() >= rows.min()
    assert around.max() <= rows.max()


def test_transfer_convolves_about_the_middle(big):
    """With a lopsided PSF, which tells convolution from correlation and catches an offset."""
    psf = gaussian(1.5, 9, stretch=1.4, shift=1.0)
    image = big[:40, :45]
    blurred = fft.irfft2(fft.rfft2(image) * restore.transfer(psf, image.shape), image.shape)
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
    around = restore.continued(image, restore.padded_shape(image.shape, 9))
    laplacian, _ = uft.laplacian(2, around.shape)
    theirs = restoration.wiener(around, psf, 0.1, clip=False)[: image.shape[0], : image.shape[1]]
    ours = restore.wiener(image, psf, 0.1 * abs(laplacian) ** 2)
    np.testing.assert_allclose(ours, theirs, atol=1e-10)


def test_wiener_with_the_true_ratio_beats_other_ratios():
    """A scene and noise of known spectra, whose least mean square error is then known too."""
    rng, psf, noise = np.random.default_rng(8), gaussian(1.5, 9), 0.05
    grid = restore.padded_shape((90, 90), 9)
    frequency = np.hypot(fft.fftfreq(grid[0])[:, None], fft.rfftfreq(grid[1]))
    power = 1 / (1e-4 + frequency**2.5)
    scene = fft.irfft2(fft.rfft2(rng.normal(size=grid)) * np.sqrt(power), grid)
    otf = restore.transfer(psf, grid)
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


# --- Richardson-Lucy


@pytest.mark.parametrize("filter_epsilon", [0.0, 0.2])
def test_richardson_lucy_equals_scikit_image_inside(big, filter_epsilon):
    psf = gaussian(1.2, 11, stretch=1.3, shift=0.5)
    _, image = capture(big, psf, 0.003)
    ours = restore.richardson_lucy(image, psf, 20, acceleration=False, filter_epsilon=filter_epsilon)
    theirs = restoration.richardson_lucy(image, psf, 20, clip=False, filter_epsilon=filter_epsilon)
    inside = slice(33, -33), slice(33, -33)
    np.testing.assert_allclose(ours[inside], theirs[inside], rtol=1e-3, atol=1e-9)


def test_richardson_lucy_inverts_blur_that_it_knows(big):
    scene, image = capture(big, gaussian(1.0, 9))
    inside = slice(20, -20), slice(20, -20)
    before, plain, fast = (
        rms((estimate - scene)[inside])
        for estimate in (
            image,
            restore.richardson_lucy(image, gaussian(1.0, 9), 50, acceleration=False),
            restore.richardson_lucy(image, gaussian(1.0, 9), 50),
        )
    )
    assert fast < plain < before
    assert fast < 0.5 * before


def likelihood(image, scene, psf):
    """Poisson log likelihood of the image inside half a PSF from the border."""
    half = len(psf) // 2
    reblurred = signal.convolve(scene, psf, mode="valid")
    return np.sum(image[half:-half, half:-half] * np.log(reblurred) - reblurred)


def test_likelihood_rises_and_acceleration_gets_further(big):
    psf = gaussian(2.0, 13)
    _, image = capture(big, psf, 0.005)
    plain = [
        likelihood(image, restore.richardson_lucy(image, psf, n, acceleration=False), psf) for n in (1, 2, 5, 10, 20)
    ]
    assert np.all(np.diff(plain) > 0)
    assert likelihood(image, restore.richardson_lucy(image, psf, 10), psf) > plain[-1]


def test_the_truth_is_a_fixed_point(big):
    """Where nothing is left to explain nothing moves, but along the border, whose outside is unknown."""
    psf = gaussian(1.5, 11)
    scene, image = capture(big, psf)
    restored = restore.richardson_lucy(image, psf, 5, start=scene, acceleration=False)
    np.testing.assert_allclose(restored[60:-60, 60:-60], scene[60:-60, 60:-60], rtol=1e-12)


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


# --- blind


def test_one_blind_step_is_the_textbook_one():
    """Against sums written out pixel by pixel, with a lopsided PSF and the border unknown."""
    rng = np.random.default_rng(2)
    image, psf = rng.random((10, 12)) + 0.2, rng.random((3, 3))
    psf /= psf.sum()
    around = restore.continued(image, restore.padded_shape(image.shape, 1))
    scene = np.pad(image, 1)  # room for the pixel beyond each border
    scene[0, 1:-1], scene[-1, 1:-1] = around[-1, :12], around[10, :12]
    scene[1:-1, 0], scene[1:-1, -1] = around[:10, -1], around[:10, 12]
    scene[0, 0], scene[0, -1], scene[-1, 0], scene[-1, -1] = (
        around[-1, -1],
        around[-1, 12],
        around[10, -1],
        around[10, 12],
    )
    ratio = image / signal.convolve(scene, psf, mode="valid")
    likelier = np.zeros((3, 3))
    gain, seen = np.zeros_like(scene), np.zeros_like(scene)
    for i, j in np.ndindex(3, 3):  # pixel (y, x) of the image takes psf[i, j] of scene pixel (y + 2 - i, x + 2 - j)
        light = scene[2 - i : 12 - i, 2 - j : 14 - j]
        likelier[i, j] = psf[i, j] * (light * ratio).sum() / light.sum()
        gain[2 - i : 12 - i, 2 - j : 14 - j] += psf[i, j] * ratio
        seen[2 - i : 12 - i, 2 - j : 14 - j] += psf[i, j]
    restored, spot = restore.blind_richardson_lucy(image, psf, 1)
    np.testing.assert_allclose(restored, (scene * gain / seen)[1:-1, 1:-1], rtol=1e-10)
    np.testing.assert_allclose(spot, likelier / likelier.sum(), rtol=1e-10)


@pytest.mark.parametrize("acceleration", [True, False])
def test_blind_keeps_light_and_signs(big, acceleration):
    _, image = capture(big, gaussian(1.5), 0.005)
    restored, psf = restore.blind_richardson_lucy(image, np.full((5, 5), 0.04), 20, acceleration=acceleration)
    assert restored.shape == image.shape
    assert psf.shape == (5, 5)
    assert restored.min() >= 0
    assert psf.min() >= 0
    assert psf.sum() == pytest.approx(1)
    assert restored.sum() == pytest.approx(image.sum(), rel=2e-3)


def test_blind_acceleration_reaches_a_lower_residual(big):
    _, image = capture(big, gaussian(1.5), 0.002)

    def residual(acceleration):
        scene, psf = restore.blind_richardson_lucy(image, np.full((7, 7), 1 / 49), 20, acceleration=acceleration)
        return rms(signal.convolve(scene, psf, mode="valid") - image[3:-3, 3:-3])

    assert residual(True) < 0.8 * residual(False)


def test_a_flat_start_moves_towards_the_blur_and_a_point_cannot(big):
    truth = gaussian(2.0, 7)
    _, image = capture(big, truth)
    flat, point = np.full((7, 7), 1 / 49), np.zeros((7, 7))
    point[3, 3] = 1
    _, found = restore.blind_richardson_lucy(image, flat, 20)
    assert rms(found - truth) < 0.9 * rms(flat - truth)
    restored, still = restore.blind_richardson_lucy(image, point, 5)
    np.testing.assert_allclose(still, point, atol=1e-12)
    np.testing.assert_allclose(restored, image, rtol=1e-9, atol=1e-12)


def test_the_size_of_a_flat_start_decides_whatever_the_blur(big):
    """What sinks the thesis' baseline: the PSF found is as wide as the start, not as the blur."""

    def width(sigma, size):
        _, image = capture(big, gaussian(sigma))
        _, psf = restore.blind_richardson_lucy(image, np.full((size, size), 1 / size**2), 20)
        return np.sqrt((psf * np.square(np.mgrid[:size, :size] - size // 2).sum(axis=0)).sum())

    narrow, wide = np.array([[width(sigma, size) for size in (3, 7)] for sigma in (1.0, 2.0)])
    start = np.sqrt([(size**2 - 1) / 6 for size in (3, 7)])
    assert abs(narrow / start - 1).max() < 0.1
    assert abs(wide / start - 1).max() < 0.1


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
