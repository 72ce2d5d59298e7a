"""What calibration promises, for every target: 20 distances, PSFs from the pupil model, 12 bits, photon and read noise.

    python -m pytest -m benchmark tests/benchmarks/test_calibration.py -s

Prints a table, and fails where a promise is not kept.
"""

import sys
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from frames import DISTANCES, FRAMES, LENS, SIZE, truth

from calib.assess import Assessment
from calib.build import table_of
from calib.nearest import nearest
from psflut import Noise, Observation, Setup, estimate, family, simulate
from psflut.imagers.plain import Plain
from psflut.photographs import shipped

pytestmark = pytest.mark.benchmark
SHOTS, FRESH = 2, 40
DRAWS = (7, 21, 22, 23)
"""Seeds of frames: a table's errors hang together, those of one alone are 0.9 to 1.3 times the stated ones."""
SCENES = (1.03, 1.21, 1.37, 1.58, 1.79, 2.05, 2.47, 2.9)
PHOTOGRAPHS = ("astronaut", "brick", "camera", "grass", "gravel")
"""At each of these distances: 8 captures of one alone gave ratios from 0.80 to 1.28 for tables that are as good."""
L1_BAR = {"point": 0.05, "edge": 0.08, "pattern": 0.08}


class Row(NamedTuple):
    """Of a target: mean summed |error| of measured PSFs and of the table's, errors of lit pixels over the standard
    errors stated (of both), all over `DRAWS`; and of the first draw the error of wiener over that with the true
    table, and the error that check expects over that of fresh frames (medians); and these two in % of the distance."""

    measured: float
    table: float
    measured_honesty: float
    table_honesty: float
    wiener: float
    check: float
    expected: float
    true: float


TRUE = np.stack([truth(float(z)) for z in DISTANCES])
LIT = np.greater(TRUE, 0.05 * TRUE.max(axis=(1, 2), keepdims=True))


def test_every_target_has_its_frames():
    assert {name.split()[0] for name in FRAMES} == set(family.names("calib.targets"))


@pytest.fixture(scope="module", params=FRAMES)
def result(request, tmp_path_factory):
    factory, frame = FRAMES[request.param]
    target = factory(tmp_path_factory.mktemp("frames"))

    def measure(z, rng):
        return target.measure([frame(float(z), rng) for _ in range(SHOTS)], SIZE, Plain())

    rngs = [np.random.default_rng(seed) for seed in DRAWS]
    measured = [[measure(z, rng) for z in DISTANCES] for rng in rngs]
    tables = [Assessment().of(table_of(DISTANCES, "distance", each, LENS.pixel_pitch), each) for each in measured]
    fresh = 1 / np.random.default_rng(8).uniform(1 / DISTANCES[-1], 1 / DISTANCES[0], FRESH)
    errors = np.array([nearest(tables[0], measure(z, rngs[0]).psf) / z - 1 for z in fresh])
    alone = [(np.stack([one.psf for one in each]), np.stack([one.std for one in each])) for each in measured]
    expected = tables[0].check["position_error_of_distance"]
    row = Row(
        wrong([psf for psf, _ in alone]),
        wrong([each.psf for each in tables]),
        honesty(alone),
        honesty([(each.psf, each.psf_std) for each in tables]),
        wiener(tables[0], TRUE),
        expected / float(np.median(np.abs(errors))),
        100 * expected,
        100 * float(np.median(np.abs(errors))),
    )
    print(f"\n{request.param}: " + ", ".join(f"{name} {value:.3g}" for name, value in row._asdict().items()))
    return request.param, row


def wrong(found):
    """Mean summed |error| of PSFs (draws, N, K, K)."""
    return float(np.abs(found - TRUE).sum(axis=(2, 3)).mean())


def honesty(found):
    """Root of the error's energy over the energy stated, over lit pixels; of planes and draws the root mean square.

    So every plane counts alike: with energies added up over planes the last one, 0.6 pixels of blur, would speak for
    all, as most of what is stated is stated there.
    """
    ratios = [np.sum((f - TRUE) ** 2 * LIT, axis=(1, 2)) / np.sum(s**2 * LIT, axis=(1, 2)) for f, s in found]
    print("\n  errors over stated, by plane:", np.round(np.sqrt(np.mean(ratios, axis=0)), 2), end="")
    print("\n  by draw:", np.round(np.sqrt(np.mean(ratios, axis=1)), 2))
    return float(np.sqrt(np.mean(ratios)))


def wiener(table, planes):
    """Mean error with the measured table over that with the true one, on captures by the model itself."""
    true = replace(table, psf=planes, psf_std=None, axis_std=None, check=None)
    source = replace(true, camera=LENS, provenance={"model": "pupil", "settings": {}})
    errors = {"measured": [], "true": []}
    for seed, (name, distance) in enumerate(product(PHOTOGRAPHS, SCENES)):
        image, _ = simulate(shipped(name)[:256, :256], source, distance, Setup(noise="0.005"), seed)
        for which, each in (("measured", table), ("true", true)):
            found = estimate(Observation(image[64:192, 64:192], Noise(0.005)), each, "wiener")
            errors[which].append(abs(found.distance - distance) / distance)
    return float(np.mean(errors["measured"]) / np.mean(errors["true"]))


def test_psfs_are_measured(result):
    name, row = result
    assert row.table < L1_BAR[name.split()[0]]


def test_standard_errors_are_honest(result):
    assert 1 / 1.3 < result[1].measured_honesty < 1.3


def test_standard_errors_of_the_table_are_honest(result):
    assert 1 / 1.3 < result[1].table_honesty < 1.3


def test_the_measured_table_reads_like_the_true_one(result):
    assert result[1].wiener < 1.2


def test_the_error_that_check_expects_is_the_true_one(result):
    assert 1 / 1.5 < result[1].check < 1.5
