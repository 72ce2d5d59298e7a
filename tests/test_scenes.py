"""Captures of scenes with depth: a plane, a slant and a step are what optics make of them."""

import numpy as np
import pytest

from psflut import scenes
from psflut.capture import Setup, capture, psf_of
from psflut.errors import PsflutError
from psflut.imagers.plain import Plain


@pytest.fixture(scope="module")
def texture():
    return np.random.default_rng(3).random((96, 112))


def plane(scene, table, metres):
    return capture(scene, psf_of(table, metres), None, np.random.default_rng(0), imager=Plain())


def test_a_plane_is_captured_as_a_plane_always_is(lab16mm, texture):
    setup = Setup(noise="0.005", bits=12)
    ours, noise = scenes.simulate(texture, np.full(texture.shape, 1.7), lab16mm, setup, 5)
    theirs = capture(
        texture, psf_of(lab16mm, 1.7), scenes.Noise(0.005), np.random.default_rng(5), imager=Plain(), bits=12
    )
    np.testing.assert_allclose(ours, theirs, atol=1.5 / 2**12)
    assert noise.read > 0.005


def test_a_slant_has_everywhere_the_blur_of_its_own_distance(lab16mm, texture):
    vergence = np.linspace(0.55, 0.75, texture.shape[1]) * np.ones(texture.shape)
    ours = scenes.blurred(texture, 1 / vergence, lab16mm, layers=12)
    column = 56
    there, wrong = (plane(texture, lab16mm, factor / vergence[0, column]) for factor in (1.0, 1.1))
    error, control = (np.std(ours[:, column] - other[:, column]) for other in (there, wrong))
    assert error < 0.1 * control


def test_a_near_object_covers_what_lies_behind_by_its_share_of_the_lens(lab16mm):
    near = np.arange(160) < 80
    scene, distance = np.where(near, 0.2, 0.8) * np.ones((64, 160)), np.where(near, 1.2, 4.0) * np.ones((64, 160))
    ours = scenes.blurred(scene, distance, lab16mm, layers=2)
    cover = plane(near * np.ones((64, 160)), lab16mm, 1.2)
    expected = 0.2 * cover + 0.8 * (1 - cover)
    beyond = slice(80 + 4, None)  # past the background's own blur at the step
    np.testing.assert_allclose(ours[:, beyond], expected[:, beyond], atol=2e-3)
    assert np.ptp(ours[:, :60]) < 1e-7


def test_the_motorcycle_has_a_distance_everywhere():
    scene, distance = scenes.motorcycle()
    assert scene.shape == distance.shape == (500, 741)
    assert (distance.min(), distance.max()) == pytest.approx((1.0, 4.0))
    assert distance[300, 400] < 1.3 < 2.5 < distance[40, 200]  # the engine, the wall behind


def test_scenes_that_cannot_be_are_refused(lab16mm, texture):
    for distance in (np.ones((3, 3)), np.zeros(texture.shape)):
        with pytest.raises(PsflutError, match="positive, finite distance for every pixel"):
            scenes.blurred(texture, distance, lab16mm)
