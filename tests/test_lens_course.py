"""Tables smoothed about the lens that fits their measurements: nearer to the truth, and their errors known."""

import numpy as np
import pytest

from calib.build import Guess, smooth
from calib.fit_errors import fit_errors
from calib.lens_course import guess_of
from calib.pupil_fit import Lens, fit_lens
from calib.radial import rings
from calib.targets import Measurement
from psflut.optics import Camera
from psflut.psfs.pupil import Pupil

CAMERA = Camera.of(16e-3, 6e-6, f_number=2, focus_distance=6.0)
EVEN, SIZE, NOISE, DRAWS = np.linspace(1 / 4.4, 1 / 1.2, 14), 25, 0.05, 5
"""To near focus, where PSFs change fastest."""


@pytest.fixture(scope="module")
def truth():
    return np.stack([Pupil()(CAMERA, float(1 / u), SIZE) for u in EVEN])


def measured(truth, seed):
    """As edges err: alike at all pixels of a ring; where there is hardly light, they know it."""
    ring, rng = rings(SIZE), np.random.default_rng(seed)
    light = np.sqrt(truth * truth.max(axis=(1, 2), keepdims=True))
    std = NOISE * np.stack(
        [(np.bincount(ring.ravel(), plane.ravel()) / np.bincount(ring.ravel()))[ring] for plane in light]
    )
    noise = rng.standard_normal((len(truth), ring.max() + 1))[:, ring]
    return truth + std * noise, std


@pytest.fixture(scope="module")
def courses(truth):
    """By the spline alone, about a lens, and about a lens that is taken for exact: (3 kinds, draws)."""
    rows = []
    for seed in range(DRAWS):
        psf, std = measured(truth, seed)
        lens = fit_lens(EVEN, psf, std, Lens.of_camera(CAMERA))
        guess = guess_of(lens, EVEN, psf, std)
        shots = [Measurement(*each, 1) for each in zip(psf, std, strict=True)]
        rows.append([smooth(EVEN, shots, each) for each in (None, guess, Guess(guess.psf, 0 * guess.errors))])
    return list(zip(*rows, strict=True))


def test_a_table_smoothed_about_a_lens_is_nearer_to_the_truth(truth, courses):
    alone, about, _ = [np.mean([np.abs(one.psf - truth).sum(axis=(1, 2)) for one in kind]) for kind in courses]
    assert about < 0.7 * alone


def test_its_errors_are_honest_and_those_of_the_lens_are_needed(truth, courses):
    lit = truth > 0.05 * truth.max(axis=(1, 2), keepdims=True)
    _, about, exact = [
        np.sqrt(
            sum(np.sum((one.psf - truth)[lit] ** 2) for one in kind) / sum(np.sum(one.std[lit] ** 2) for one in kind)
        )
        for kind in courses
    ]
    assert 1 / 1.3 < about < 1.3
    assert exact > 1.3  # the control


def test_pixels_that_err_as_one_count_as_one(truth, rng):
    ring, std = rings(SIZE), 0.3 * truth.max(axis=(1, 2), keepdims=True) * np.ones_like(truth)
    alike, alone = rng.standard_normal((len(truth), ring.max() + 1))[:, ring], rng.standard_normal(std.shape)
    as_one, apart = [(fit_errors(truth + std * noise, std) / std)[:, ring == 8].mean() for noise in (alike, alone)]
    assert as_one == pytest.approx(np.sqrt(np.sum(ring == 8)), rel=0.05)
    assert apart < 2.0
