"""Many patches at once, against each alone."""

import numpy as np
import pytest

from psflut.batch import OUTCOMES, estimate_all
from psflut.capture import capture, psf_of
from psflut.errors import PsflutError
from psflut.estimation import Observation, Outcome, estimate
from psflut.imagers.plain import Plain
from psflut.noise import Noise

NOISE = Noise(0.005)


@pytest.fixture(scope="module")
def patches(lab16mm, scene):
    """(8, 64, 64): of several distances and textures; the last three blank, saturated and beyond the table."""
    rng = np.random.default_rng(2)
    places = ((0.9, 40, 30), (1.2, 90, 80), (1.9, 150, 60), (2.7, 20, 150), (3.8, 120, 120), (4.95, 60, 170))
    shots = [
        capture(scene, psf_of(lab16mm, z), NOISE, rng, imager=Plain())[y : y + 64, x : x + 64] for z, y, x in places
    ]
    bright = np.where(np.arange(64 * 64).reshape(64, 64) < 40, 1.0, shots[1])
    return np.stack([*shots, 0.5 + 0.005 * rng.standard_normal((64, 64)), bright])


@pytest.mark.parametrize("threads", [1, 2])
def test_each_patch_has_the_estimate_that_it_has_alone(lab16mm, patches, threads):
    together = estimate_all(patches, lab16mm, NOISE, threads=threads)
    for k, patch in enumerate(patches):
        alone = estimate(Observation(patch, NOISE), lab16mm, "wiener")
        assert OUTCOMES[together.outcome[k]] is alone.outcome
        assert together.distance[k] == pytest.approx(alone.distance, rel=1e-9)
        np.testing.assert_allclose(together.interval[k], alone.interval, rtol=1e-9)
        assert together.weight[k] == pytest.approx(alone.modes[0].weight, rel=1e-9)
        assert together.misfit[k] == pytest.approx(alone.stats.get("misfit", np.nan), rel=1e-9, nan_ok=True)
    assert {OUTCOMES[k] for k in together.outcome} >= {Outcome.OK, Outcome.FLAT, Outcome.SATURATED}


def test_no_patches_make_an_empty_batch(lab16mm):
    assert estimate_all(np.empty((0, 64, 64)), lab16mm, NOISE).interval.shape == (0, 2)


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda p: p[0], "stack"),
        (lambda p: p[:, :16], "smaller than the table's PSF"),
        (lambda p: np.where(p == p[3, 5, 5], np.nan, p), "not finite"),
        (lambda p: np.where(p == p[3, 5, 5], -np.inf, p), "not finite"),
        (lambda p: p - 0.5, "not negative"),
        (lambda p: p.astype(complex), "real"),
    ],
)
def test_bad_patches_are_refused_in_a_sentence(lab16mm, patches, spoil, says):
    with pytest.raises(PsflutError, match=says):
        estimate_all(spoil(patches), lab16mm, NOISE)
