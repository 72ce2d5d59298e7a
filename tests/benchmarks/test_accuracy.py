"""How near the methods come, on photographs left out of all learning.

    python -m pytest -m benchmark tests/benchmarks -s

Prints a table for each claim that README and docstrings make, and fails where a claim does not hold.
"""

import sys
from pathlib import Path

import numpy as np
import pytest
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).parent))
from photographs import patches, sharp

from psflut import capture
from psflut.estimation import Observation, Problem, estimate, for_any_scene
from psflut.estimators.golden_section import GoldenSection
from psflut.estimators.posterior import Posterior
from psflut.grid import grid
from psflut.imagers.plain import Plain

pytestmark = pytest.mark.benchmark
DISTANCES = (1.03, 1.37, 1.79, 2.47)


@pytest.fixture(scope="module")
def errors(lab16mm):
    """Relative errors, coverage and seconds of every method on the same 52 patches; the first run of each
    method, which fills its caches, is not timed."""
    trials = patches(lab16mm, DISTANCES)
    out = {}
    for method in for_any_scene():
        estimate(Observation(trials[0].image, trials[0].noise), lab16mm, method)
        rows = []
        for trial in tqdm(trials, desc=method, disable=None):
            found = estimate(Observation(trial.image, trial.noise), lab16mm, method)
            near, far = found.interval
            error = abs(found.distance - trial.distance) / trial.distance
            rows.append((trial.distance, error, near <= trial.distance <= far, found.stats["seconds"]))
        out[method] = np.array(rows)
    print(f"\n{'method':16}" + "".join(f"{z:>9} m" for z in DISTANCES) + "      all   > 10 %   95 % cover   seconds")
    for method, rows in out.items():
        medians = [np.median(rows[rows[:, 0] == z, 1]) for z in DISTANCES] + [np.median(rows[:, 1])]
        shares = f"{np.mean(rows[:, 1] > 0.1):9.0%} {np.mean(rows[:, 2]):12.0%} {np.median(rows[:, 3]):9.3f}"
        print(f"{method:16}" + "".join(f"{m:10.2%} " for m in medians) + shares)
    return {method: rows[:, 1] for method, rows in out.items()}


@pytest.mark.parametrize("method", ["wiener", "posterior"])
def test_the_evidence_reads_one_percent_and_a_third_of_the_baseline(errors, method):
    median = np.median(errors[method])
    assert median < 0.01
    assert median < np.median(errors["golden_section"]) / 3


def test_blind_rl_errs_less_than_half_as_much_as_the_baseline(errors):
    assert np.median(errors["blind_rl"]) < np.median(errors["golden_section"]) / 2


def test_the_chain_agrees_with_the_grid_on_twenty_patches(lab16mm):
    deviations = []
    for trial in patches(lab16mm, (1.21, 2.03), seed=1)[:20]:
        found = estimate(Observation(trial.image, trial.noise), lab16mm, Posterior())
        density = grid(Problem(trial.image, lab16mm, Plain(), trial.noise, "given", 0.95), 100).density
        error = found.stats["standard_deviation"] / np.sqrt(found.stats["effective_samples"])
        deviations.append((found.detail["chain"][:, :, 0].mean() - density.mean) / error)
    print("\nposterior mean less the grid's, in Monte Carlo standard errors:", np.round(deviations, 1))
    assert np.max(np.abs(deviations)) < 3


def test_the_known_ideal_image_on_the_camera_of_the_thesis(thesis):
    """Normalised Laplacian, 256 pixels, Gaussian window of sd 0.35 N, noise power subtracted, 40 runs."""
    scene = sharp("camera")
    method = GoldenSection(subtract_noise=True, redraws=2)
    for noise in ("variance:1e-3", "relative:1e-3"):
        print(f"\nknown ideal image, noise {noise}: bias and scatter of 40 runs (cm)")
        worst = [0.0, 0.0]
        for distance in (3.3, 3.6, 3.9, 4.2, 4.4):
            setup = capture.Setup(imager="laplacian:0.2", normalise=True, noise=noise, filter_size=5)
            ideal = capture.ideal_image(scene, setup)
            answers = []
            for seed in range(40):
                image, drawn = capture.simulate(scene, thesis, distance, setup, seed)
                answers.append(estimate(Observation(image, drawn, scene=ideal), thesis, method).distance)
            bias, scatter = np.mean(answers) - distance, np.std(answers, ddof=1)
            worst = [max(worst[0], abs(bias)), max(worst[1], scatter)]
            print(f"  {distance} m: {100 * bias:6.1f} {100 * scatter:6.1f}")
        assert worst[0] < 0.05
        assert worst[1] < 0.17  # 9 to 17 cm where the method was re-created before
