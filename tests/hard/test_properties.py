"""What must not matter to an estimate does not, and what must does: the evidence methods on captures of a model."""

from dataclasses import replace

import numpy as np
import pytest

from psflut import capture
from psflut.estimation import Observation, estimate
from psflut.noise import Noise

METHODS = ("wiener", "posterior:steps=150")
"""Both read the evidence; the chain's own scatter is allowed for by `SLACK`."""

SLACK = {"wiener": 0.02, "posterior:steps=150": 0.5}
"""Of the interval's width: how far a distance may move by rounding, or by a short chain's chance."""

SIGMA = 0.004


def captured(table, scene, distance, seed=3, sigma=SIGMA, side=96, corner=60):
    image = capture.simulate(scene, table, distance, capture.Setup(noise=str(sigma)), seed)[0]
    return image[corner : corner + side, corner : corner + side]


def told(image, table, method, sigma=SIGMA):
    found = estimate(Observation(image, Noise(sigma)), table, method)
    return found.distance, *found.interval


def moved(one, other):
    """Change of the distance in widths of the interval."""
    return abs(other[0] - one[0]) / (one[2] - one[1])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("gain", "offset"), [(0.4, 0.0), (2.5, 0.3)])
def test_gain_and_offset_do_not_move_the_distance(lab16mm, scene, method, gain, offset):
    image = captured(lab16mm, scene, 1.37)
    one = told(image, lab16mm, method)
    other = told(gain * image + offset, lab16mm, method, gain * SIGMA)
    # The prior on ln contrast has a standard deviation of `FREE_CONTRAST`, so that a gain pulls the posterior of one of
    # sd s by 2 |ln gain| (s / 3)^2; with s below 0.5 that is 0.1 sd, and no more of the distance: 0.026 of a width.
    assert moved(one, other) < SLACK[method] + (0.0 if gain == 1 else 0.026)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("shift", [(0, 1), (7, -5)])
def test_translation_does_not_move_the_distance(lab16mm, scene, method, shift):
    """The scene slides under the patch: what enters at a border is new, the rest is the same.

    A width is 3.9 standard errors, or 2.8 of the difference of two patches that have nothing in common: 1 in 200 of
    those would be further apart.
    """
    image = captured(lab16mm, scene, 1.37)
    slid = captured(lab16mm, np.roll(scene, shift, (0, 1)), 1.37)
    one, other = told(image, lab16mm, method), told(slid, lab16mm, method)
    assert moved(one, other) < 1.0
    assert other[1] < one[0] < other[2]
    assert one[1] < other[0] < one[2]


@pytest.mark.parametrize("turn", ["flipud", "rot90"])
def test_image_and_psf_turned_together_change_nothing(lab16mm, scene, turn):
    turning = getattr(np, turn)  # all others are made of these two
    lopsided = replace(lab16mm, psf=_skewed(lab16mm.psf))
    image = captured(lab16mm, scene, 1.37)
    turned = replace(lopsided, psf=np.stack([turning(plane) for plane in lopsided.psf]))
    one, other = told(image, lopsided, "wiener"), told(turning(image).copy(), turned, "wiener")
    np.testing.assert_allclose(one, other, atol=1e-3 * np.ptp(one[1:]))  # not quite the same distances are looked at


def _skewed(psf):
    """PSFs without any symmetry."""
    skew = psf * (1 + 0.3 * np.linspace(-1, 1, psf.shape[-1]) + 0.2 * np.linspace(-1, 1, psf.shape[-1])[:, None])
    return skew / skew.sum(axis=(1, 2), keepdims=True)


def test_more_noise_never_narrows_the_interval_on_average(lab16mm, scene):
    widths = [
        np.mean(
            [
                np.log(np.ptp(told(captured(lab16mm, scene, z, seed, sigma, corner=at), lab16mm, "wiener", sigma)[1:]))
                for seed, (z, at) in enumerate([(1.1, 20), (1.37, 60), (1.8, 90), (2.3, 40)])
            ]
        )
        for sigma in (0.001, 0.004, 0.016, 0.064)
    ]
    assert np.all(np.diff(widths) > 0), widths


def test_a_doubled_patch_narrows_it(lab16mm, scene):
    widths = [
        np.mean(
            [
                np.log(np.ptp(told(captured(lab16mm, scene, z, 5, side=side, corner=40), lab16mm, "wiener")[1:]))
                for z in (1.1, 1.37, 1.8, 2.3)
            ]
        )
        for side in (64, 128)
    ]
    assert widths[1] < widths[0] - 0.2, widths


def test_the_control_another_distance_does_move_it(lab16mm, scene):
    near, far = (told(captured(lab16mm, scene, z), lab16mm, "wiener") for z in (1.30, 1.45))
    assert moved(near, far) > 1.0
