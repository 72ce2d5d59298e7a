"""Richardson-Lucy undoes blur and agrees with scikit-image; blind, it does what it says."""

import numpy as np
import pytest
from blurs import capture, gaussian, rms
from scipy import signal
from skimage import restoration

from psflut import fourier, restore

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


# --- blind


def test_one_blind_step_is_the_textbook_one():
    """Against sums written out pixel by pixel, with a lopsided PSF and the border unknown."""
    rng = np.random.default_rng(2)
    image, psf = rng.random((10, 12)) + 0.2, rng.random((3, 3))
    psf /= psf.sum()
    around = fourier.continued(image, fourier.padded_shape(image.shape, 1))
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
