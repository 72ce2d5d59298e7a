"""Intervals from noisy and from sparse tables, on photographs left out of all learning.

python -m pytest -m benchmark tests/benchmarks/test_noisy_tables.py -s
"""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from photographs import patches

from calib.build import smooth
from calib.targets import Measurement
from psflut import capture
from psflut.estimation import Problem
from psflut.grid import grid
from psflut.gross import with_gross_errors
from psflut.imagers.plain import Plain
from psflut.table import PSFTable

pytestmark = pytest.mark.benchmark
DISTANCES = (1.01, 1.19, 1.43, 1.73, 2.09, 2.71)
SHORT = pytest.mark.xfail(reason="86 to 88 % instead of 95: so much noise moves more than errors to first order say")
DENSE = (64, 0.0, "exact")


@pytest.fixture(scope="module")
def trials(lab16mm):
    return patches(lab16mm, DISTANCES, seed=11)


def table_of(source, count, noise, course, seed):
    """Pupil PSFs with noise of that share of each peak, "cut" off at zero and in the dark, or "smooth"ed."""
    axis = source.candidates(count)
    planes = np.stack([capture.psf_of(source, z) for z in axis])
    if course == "exact":
        return PSFTable(axis, planes, source.pixel_pitch)
    peak = planes.max(axis=(1, 2), keepdims=True)
    std = noise * peak * np.ones_like(planes)
    seen = planes + std * np.random.default_rng(seed).standard_normal(planes.shape)
    if course == "smooth":
        made = smooth(1 / axis[::-1], [Measurement(a, s, 1) for a, s in zip(seen[::-1], std[::-1], strict=True)])
        return PSFTable(axis, made.psf[::-1], source.pixel_pitch, psf_std=made.std[::-1])
    seen = np.where(planes > 1e-3 * peak, np.maximum(seen, 0.0), 0.0)
    total = seen.sum(axis=(1, 2), keepdims=True)
    return PSFTable(axis, seen / total, source.pixel_pitch, psf_std=std / total)


def figures(density, truth):
    """Relative error, whether 95 % cover, and the interval score relative to distance."""
    (near, far), answer = density.interval(0.95), density.modes()[0].distance
    outside = max(near - truth, truth - far, 0.0)
    return abs(answer - truth) / truth, near <= truth <= far, (far - near + 40 * outside) / truth


def measure(source, trials, case, tables=3):
    """(2, 4): median error, share beyond 10 %, coverage, mean score; with the table's errors and without."""
    rows = []
    for seed in range(tables if case[1] else 1):
        table = table_of(source, *case, seed)
        for trial in trials:
            found = grid(Problem(trial.image, table, Plain(), trial.noise, "given", 0.95), 100)
            bare = with_gross_errors(found.exact, found.bank.prior.gross)
            rows.append([figures(each, trial.distance) for each in (found.density, bare)])
    error, covered, score = np.moveaxis(np.array(rows, dtype=float), 2, 0)
    out = np.stack([np.median(error, 0), np.mean(error > 0.1, 0), covered.mean(0), score.mean(0)], axis=1)
    for name, row in zip(("with its errors", "without"), out, strict=True):
        print(f"{case[0]:3} planes, noise {case[1]:4.0%} {case[2]:7} {name:16}", end="")
        print(f"median {row[0]:6.2%}  > 10 % {row[1]:5.1%}  95 % cover {row[2]:5.1%}  score {row[3]:.3f}")
    return out


@pytest.fixture(scope="module")
def dense(lab16mm, trials):
    print()
    return measure(lab16mm, trials, DENSE)


def test_a_dense_exact_table_is_read_as_ever(dense):
    np.testing.assert_array_equal(*dense)


@pytest.mark.parametrize(
    "case",
    [
        (20, 0.1, "cut"),
        pytest.param((20, 0.2, "cut"), marks=SHORT),
        (20, 0.1, "smooth"),
        pytest.param((20, 0.2, "smooth"), marks=SHORT),
        (10, 0.0, "exact"),
        (8, 0.0, "exact"),
        (7, 0.0, "exact"),
    ],
)
def test_intervals_of_noisy_and_sparse_tables_cover_as_those_of_the_dense_one(lab16mm, trials, dense, case):
    ours, bare = measure(lab16mm, trials, case)
    assert ours[2] >= dense[0, 2] - 0.06
    assert ours[2] >= bare[2]


def test_the_control_left_out_errors_of_a_noisy_table_cover_clearly_less(lab16mm, trials):
    """Of the same captures: wider intervals miss none that narrower ones hold, so that seven are no chance (1 %)."""
    ours, bare = measure(lab16mm, trials, (20, 0.2, "cut"))
    assert bare[2] <= ours[2] - 7 / (3 * len(trials))
    assert ours[3] < bare[3]
