"""Spectra by direction: annuli in sectors, and lenses whose PSFs are not round."""

from dataclasses import replace

import numpy as np
import pytest

from psflut.batch import estimate_all
from psflut.capture import Setup, simulate
from psflut.estimation import Observation, estimate
from psflut.noise import Noise
from psflut.photographs import SHIPPED, shipped
from psflut.psfs.pupil import Pupil
from psflut.spectrum import annular_power, annuli
from psflut.texture import SECTORS, learnt

NOISE, DISTANCES = Noise(0.005), (1.17, 1.83, 2.9)


@pytest.fixture(scope="module")
def astigmatic(lab16mm):
    """The table of the same lens with astigmatism; captures come from its model, at any distance."""
    zernikes = ((2, 2, 0.25),)
    some = replace(lab16mm, axis=lab16mm.axis[::2], psf=lab16mm.psf[::2])
    psf = np.stack([Pupil(zernikes=zernikes)(lab16mm.camera, float(z), lab16mm.size) for z in some.axis])
    return replace(some, psf=psf, provenance={"model": "pupil", "settings": {"zernikes": [list(zernikes[0])]}})


@pytest.mark.parametrize("shape", [(64, 64), (51, 73)])
def test_sectors_make_up_the_annulus_and_white_noise_is_even(shape, rng):
    rings = annuli(shape, SECTORS)
    images = 0.3 * rng.standard_normal((400, *shape))
    power = rings.power(images)
    np.testing.assert_allclose(rings.whole(power), annular_power(images), rtol=1e-9)
    expected = 0.09 * rings.white
    assert np.all(np.abs(power.mean(axis=0) - expected) < 6 * expected / np.sqrt(400 * rings.effective))


def test_values_are_put_by_sector_and_annulus_and_back(rng):
    rings = annuli((51, 73), SECTORS)
    values = rng.random((2, len(rings.frequency)))
    spread = rings.spread(values, np.nan)
    assert np.isnan(spread).any()  # in the plane's corners
    np.testing.assert_array_equal(rings.listed(spread), values)
    np.testing.assert_allclose(rings.listed(rings.spread(rings.direction, 0.0)), rings.direction)


def test_stripes_are_in_the_sector_that_they_run_across():
    rings, across = annuli((64, 64), SECTORS), np.arange(64)
    power = rings.power(np.sin(2 * np.pi * 0.2 * (across + across[:, None]) / np.sqrt(2)))
    assert rings.direction[np.argmax(power * rings.bins)] == pytest.approx(np.pi / 4)


def test_a_camera_on_its_side_has_the_same_prior():
    """Turned by a right angle alpha and beta change their signs, whose variances are what they were."""
    prior, frequency = learnt().over(SECTORS), np.array([0.02, 0.1, 0.4])
    parts = (prior.basis(frequency, np.full(3, 0.3 + turn)) for turn in (0.0, np.pi / 2))
    upright, aside = (np.einsum("ki,ij,kj->k", part, prior.covariance, part) for part in parts)
    np.testing.assert_allclose(upright, aside)


@pytest.fixture(scope="module")
def patches(astigmatic):
    """Of every photograph at every distance: truth, and a patch of 96 pixels."""
    out = []
    for k, name in enumerate(SHIPPED):
        for z in DISTANCES:
            image, _ = simulate(shipped(name), astigmatic, z, Setup(noise="0.005"), seed=k)
            out.append((z, image[20:116, 40:136]))
    return out


def test_astigmatic_blur_is_read_better_by_direction(astigmatic, patches):
    def read(method):
        found = [estimate(Observation(patch, NOISE), astigmatic, method) for _, patch in patches]
        truth = np.array([z for z, _ in patches])
        inside = [low <= z <= high for z, (low, high) in zip(truth, (each.interval for each in found), strict=True)]
        return np.median(np.abs([each.distance for each in found] / truth - 1)), np.mean(inside)

    (error, covers), (worse, fewer) = read("wiener"), read("wiener:sectors=1")
    assert error < 0.8 * worse
    assert covers >= max(0.85, fewer)


def test_maps_read_as_estimates_do(astigmatic, patches):
    some = np.stack([patch for _, patch in patches[:4]])
    together = estimate_all(some, astigmatic, NOISE)
    alone = [estimate(Observation(patch, NOISE), astigmatic, "wiener") for patch in some]
    np.testing.assert_allclose(together.distance, [each.distance for each in alone], rtol=1e-9)
    np.testing.assert_allclose(together.interval, [each.interval for each in alone], rtol=1e-9)


def test_methods_agree_on_an_astigmatic_table(astigmatic, patches):
    patch = patches[0][1]
    wiener, blind, drawn = (
        estimate(Observation(patch, NOISE), astigmatic, method)
        for method in ("wiener", "blind_rl", "posterior:steps=500")
    )
    width = np.diff(wiener.interval)[0]
    assert abs(blind.distance - wiener.distance) < 0.2 * width
    assert abs(drawn.distance - wiener.distance) < 0.2 * width
    assert drawn.detail["prediction"].power.shape == drawn.detail["prediction"].frequency.shape
    assert drawn.detail["names"][-1] == "gamma_2"
