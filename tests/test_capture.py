"""The forward model (4.1.1): border, order of filters, noise through the imager, normalisation."""

import numpy as np
import pytest
from scipy import ndimage

from psflut import family
from psflut.capture import Setup, capture, ideal_image, psf_of, simulate
from psflut.errors import PsflutError
from psflut.imagers.laplacian import Laplacian
from psflut.imagers.plain import Plain
from psflut.noise import Noise
from psflut.optics import Camera
from psflut.psfs.pupil import Pupil


@pytest.fixture(scope="module")
def crooked():
    """A PSF without any symmetry, (9, 9)."""
    psf = np.random.default_rng(0).random((9, 9)) * np.linspace(0, 1, 9)
    return psf / psf.sum()


def test_a_scene_is_continued_by_mirroring(rng, crooked):
    picture = rng.random((40, 50))
    ours = capture(picture, crooked, None, rng, imager=Plain())
    theirs = ndimage.convolve(picture, crooked, mode="reflect")  # scipy's name for d c b a | a b c d | d c b a
    np.testing.assert_allclose(ours, theirs, atol=1e-12)


def test_only_the_border_knows_the_border_rule(rng, crooked):
    picture = rng.random((60, 60))
    whole = capture(picture, crooked, None, rng, imager=Laplacian())
    part = capture(picture[10:50, 10:50], crooked, None, rng, imager=Laplacian())
    margin = 4 + 1
    inner = slice(margin, 40 - margin)
    np.testing.assert_allclose(part[inner, inner], whole[10:50, 10:50][inner, inner], atol=1e-12)


def test_an_impulse_shows_the_psf_upright(crooked, rng):
    picture = np.zeros((31, 31))
    picture[15, 15] = 1.0
    seen = capture(picture, crooked, None, rng, imager=Plain())
    np.testing.assert_allclose(seen[11:20, 11:20], crooked, atol=1e-12)


def test_normalising_scales_the_ideal_image_to_the_unit_range(scene, rng):
    setup = Setup(imager="laplacian:0.2", normalise=True)
    ideal = ideal_image(scene, setup)
    assert (ideal.min(), ideal.max()) == (0.0, 1.0)
    narrow = np.zeros((3, 3))
    narrow[1, 1] = 1.0
    seen = capture(scene, narrow, None, rng, imager=Laplacian(), normalise=True)
    np.testing.assert_allclose(seen, ideal, atol=1e-12)


def test_a_raw_laplacian_capture_is_signed_and_not_clipped(scene, rng, crooked):
    seen = capture(scene, crooked, Noise(0.001), rng, imager=Laplacian())
    assert seen.min() < -0.05
    assert seen.max() > 0.05


@pytest.mark.parametrize("imager", family.names("psflut.imagers"))
def test_photon_noise_is_coloured_by_the_imager_and_read_noise_is_not(imager, rng):
    part = family.parse("psflut.imagers", imager)
    grey = np.full((256, 256), 0.5)
    dot = np.ones((1, 1))
    kernel = part.kernel()
    for noise, expected in (
        (Noise(1e-9, gain=1000.0), 0.5 / 1000 * np.sum(kernel**2)),
        (Noise(0.02), 0.02**2),
    ):
        seen = capture(grey, dot, noise, rng, imager=part)
        assert seen.var() == pytest.approx(expected, rel=0.05)
    shot = capture(grey, dot, Noise(1e-9, gain=1000.0), rng, imager=part)
    power = np.abs(np.fft.rfft2(shot - shot.mean())) ** 2 / shot.size
    model = part.transfer(shot.shape) ** 2 * 0.5 / 1000
    passed = model > 0.05 * model.max()
    assert np.mean(power[passed] / model[passed]) == pytest.approx(1.0, rel=0.05)


def test_quantised_values_are_levels_and_signed_output_is_refused(scene, rng, crooked):
    seen = capture(scene, crooked, Noise(0.01), rng, imager=Plain(), bits=8)
    assert np.all(np.abs(seen * 255 - np.round(seen * 255)) < 1e-9)
    with pytest.raises(PsflutError, match="signed"):
        capture(scene, crooked, None, rng, imager=Laplacian(), bits=8)


def test_the_same_seed_gives_the_same_bytes(scene, lab16mm):
    setup = Setup(noise="0.01", gain=2000.0)
    first, second, other = (simulate(scene, lab16mm, 1.3, setup, seed)[0] for seed in (1, 1, 2))
    assert first.tobytes() == second.tobytes()
    assert first.tobytes() != other.tobytes()


def test_quantisation_counts_as_read_noise(scene, lab16mm):
    _, noise = simulate(scene, lab16mm, 1.3, Setup(noise="0.001", bits=8), seed=0)
    assert noise.read == pytest.approx(np.hypot(0.001, 1 / 255 / np.sqrt(12)))


def test_a_capture_through_a_built_table_comes_from_its_model(lab16mm):
    distance = float(1 / np.mean(1 / lab16mm.axis[:2]))
    model = Pupil(wavelengths=tuple(np.linspace(470e-9, 630e-9, 5)))(lab16mm.camera, distance, lab16mm.size)
    np.testing.assert_allclose(psf_of(lab16mm, distance), model, atol=1e-15)
    assert np.abs(psf_of(lab16mm, distance) - lab16mm.at(distance)).max() > 1e-7


def test_a_bare_camera_blurs_with_the_pupil_model():
    camera = Camera.of(focus_distance=6.0, focal_length=0.016, aperture_diameter=0.008, pixel_pitch=6e-6)
    psf = psf_of(camera, 1.0)
    np.testing.assert_allclose(psf, Pupil()(camera, 1.0, len(psf)), atol=1e-15)


def test_what_cannot_be_taken_is_refused(rng, crooked, lab16mm, scene):
    with pytest.raises(PsflutError, match="smaller than its PSF"):
        capture(rng.random((5, 5)), crooked, None, rng, imager=Plain())
    with pytest.raises(PsflutError, match="contrast"):
        capture(np.ones((32, 32)), crooked, None, rng, imager=Laplacian(), normalise=True)
    with pytest.raises(PsflutError, match="outside the table"):
        simulate(scene, lab16mm, 7.0, Setup(), 0)
    with pytest.raises(PsflutError, match="read noise"):
        Setup(gain=100.0)
