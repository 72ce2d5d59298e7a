"""Where an estimate's uncertainty comes from, against the posterior itself and against what is turned on and off."""

from dataclasses import replace

import numpy as np
import pytest

from psflut.budget import budget
from psflut.capture import Setup, simulate
from psflut.estimation import Observation, Problem, estimate
from psflut.estimators.wiener import Wiener
from psflut.grid import grid
from psflut.imagers.plain import Plain
from psflut.noise import Noise


def parts(scene, table, sigma, distance=1.63):
    """The budget, and half the posterior's 68 % interval (metres)."""
    image = simulate(scene, table, distance, Setup(noise=str(sigma)), 3)[0][64:192, 64:192]
    found = grid(Problem(image, table, Plain(), Noise(sigma), "given", 0.95), 200)
    return budget(found, table, found.density.modes()[0].distance), np.ptp(found.density.interval(0.6827)) / 2


def total(found):
    return np.sqrt(sum(sd**2 for sd in found.values()))


@pytest.mark.parametrize("sigma", [0.001, 0.01])
def test_the_squares_add_up_to_the_posteriors_variance(lab16mm, scene, sigma):
    found, width = parts(scene, lab16mm, sigma)
    assert total(found) == pytest.approx(width, rel=0.3)


def test_more_noise_is_charged_to_the_photons(lab16mm, scene):
    quiet, loud = (parts(scene, lab16mm, sigma)[0] for sigma in (0.001, 0.01))
    assert loud["photons"] > 2 * quiet["photons"]
    assert loud["texture"] == pytest.approx(quiet["texture"], rel=0.5)


def test_the_tables_errors_are_charged_to_the_table(lab16mm, scene):
    assert parts(scene, lab16mm, 0.005)[0]["placement"] == 0
    placed = replace(lab16mm, axis_std=np.full(len(lab16mm.axis), 0.02))
    blurred = replace(lab16mm, psf_std=0.05 * lab16mm.psf.max(axis=(1, 2), keepdims=True) * np.ones_like(lab16mm.psf))
    sure, table = parts(scene, placed, 0.005)[0], parts(scene, blurred, 0.005)[0]
    assert sure["placement"] == pytest.approx(0.02, rel=0.05)
    assert table["table"] > 3 * sure["table"]


def test_an_estimate_tells_it(lab16mm, lab_patch):
    told = estimate(Observation(lab_patch, Noise(0.005)), lab16mm, Wiener()).stats["budget"]
    assert set(told) == {"photons", "texture", "table", "placement"}
    assert all(np.isfinite(sd) and sd >= 0 for sd in told.values())
