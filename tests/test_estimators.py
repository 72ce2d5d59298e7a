"""The contract of every estimator, and what each promises beyond it."""

from dataclasses import replace

import numpy as np
import pytest

from psflut import capture, family
from psflut.errors import PsflutError
from psflut.estimation import Estimate, Observation, Outcome, estimate, prior_density
from psflut.estimators.golden_section import GoldenSection, golden_section
from psflut.estimators.posterior import Posterior
from psflut.estimators.wiener import Wiener
from psflut.grid import grid
from psflut.noise import Noise
from psflut.store import read_table

METHODS = family.names("psflut.estimators")
TRUTH, NOISE = 1.63, Noise(0.005)


def seen(image, noise, table, method, other=None):
    """The observation; a method that compares two images is given another capture, or nearly the same one twice."""
    one = Observation(image, noise)
    wants = family.load("psflut.estimators", method).uses_second
    return replace(one, second=(replace(one, image=image + 1e-9 if other is None else other), table)) if wants else one


@pytest.fixture(scope="module")
def found(lab16mm, lab_patch):
    """Every method's estimate of the same patch, computed once."""
    return {method: estimate(seen(lab_patch, NOISE, lab16mm, method), lab16mm, method) for method in METHODS}


@pytest.mark.parametrize("method", METHODS)
def test_every_estimate_keeps_the_contract(found, lab16mm, method):
    result = found[method]
    near, far = result.interval
    first, last = lab16mm.span
    assert isinstance(result, Estimate)
    assert first <= near <= result.distance <= far <= last
    assert near < far
    assert isinstance(result.outcome, Outcome)
    assert sum(mode.weight for mode in result.modes) == pytest.approx(1.0, abs=1e-6)
    assert list(result.modes) == sorted(result.modes, key=lambda mode: -mode.weight)
    assert result.modes[0].distance == result.distance
    assert result.curve.position.shape == result.curve.value.shape
    assert np.all(np.isfinite(result.curve.value))
    assert result.stats["seconds"] > 0
    assert result.stats["noise_source"] == "given"
    assert result.detail["restored"].shape == (128, 128)


@pytest.mark.parametrize("method", METHODS)
def test_the_same_recipe_gives_the_same_answer(found, lab16mm, lab_patch, method):
    observation = seen(lab_patch, NOISE, lab16mm, method)
    again = estimate(observation, lab16mm, family.parse("psflut.estimators", method))
    assert (again.distance, again.interval) == (found[method].distance, found[method].interval)


@pytest.mark.parametrize("method", METHODS)
def test_a_patch_without_texture_is_flat_with_the_interval_of_the_prior(lab16mm, rng, method):
    for image in (np.full((64, 64), 0.5), 0.5 + 0.005 * rng.standard_normal((64, 64))):
        result = estimate(seen(image, NOISE, lab16mm, method), lab16mm, method)
        assert result.outcome is Outcome.FLAT
        assert result.interval == prior_density(lab16mm).interval(0.95)


@pytest.mark.parametrize("method", METHODS)
def test_bad_patches_are_refused_by_every_method(lab16mm, lab_patch, method):
    holed = lab_patch.copy()
    holed[3, 3] = np.nan
    for image in (lab_patch[:40], holed, lab_patch - 1.0, lab_patch + 0j, lab_patch[None]):
        with pytest.raises(PsflutError):
            estimate(seen(image, NOISE, lab16mm, method), lab16mm, method)


@pytest.mark.parametrize("method", METHODS)
def test_raw_signed_captures_are_mapped_not_refused(thesis, scene, method):
    """The stated rule for signed input: mapped by its own minimum and maximum for Richardson-Lucy."""
    setup = replace(capture.setup_of(thesis), normalise=False, noise="relative:1e-3")
    image, noise = capture.simulate(scene, thesis, 3.7, setup, seed=0)
    assert image.min() < -6 * noise.read
    result = estimate(seen(image[64:160, 64:160], noise, thesis, method), thesis, method)
    assert np.isfinite(result.distance)


@pytest.mark.parametrize("name", ["thesis", "thesis-fir"])
@pytest.mark.parametrize("method", METHODS)
def test_every_method_runs_on_the_tables_of_the_thesis(method, name, scene):
    """Normalised Laplacian captures, either of the noises; little can be told, so intervals must be wide."""
    table = read_table(name)
    (image, noise), (other, _) = (
        capture.simulate(scene, table, 3.87, capture.setup_of(table), seed) for seed in range(2)
    )
    image, other = image[64:160, 64:160], other[64:160, 64:160]
    result = estimate(seen(image, None, table, method, other), table, method)
    near, far = result.interval
    assert table.span[0] <= near < far <= table.span[1]
    assert result.stats["noise_source"] == "table"
    assert result.stats["noise"] == pytest.approx(noise.read)
    if method != "golden_section":
        assert far - near > 0.2 or result.outcome is Outcome.FLAT


@pytest.mark.parametrize("distance", [3.31, 3.87, 4.33])
def test_blind_rl_claims_nothing_of_what_its_steps_did_not_restore(thesis, scene, distance):
    """With little noise a blurred Laplacian passes more than the steps bring back; that is no sign of distance."""
    setup = replace(capture.setup_of(thesis), noise="relative:1e-3")
    image, noise = capture.simulate(scene, thesis, distance, setup, seed=0)
    near, far = estimate(Observation(image[64:192, 64:192], noise), thesis, "blind_rl").interval
    assert near < distance < far
    assert far - near < 0.8 * np.ptp(thesis.span)


def test_the_evidence_methods_see_the_distance(found):
    for method in ("wiener", "posterior"):
        near, far = found[method].interval
        assert found[method].distance == pytest.approx(TRUTH, rel=0.015)
        assert near < TRUTH < far
        assert (far - near) / TRUTH < 0.1


def test_blind_rl_is_nearer_than_the_baseline(found):
    assert abs(found["blind_rl"].distance - TRUTH) < 0.5 * abs(found["golden_section"].distance - TRUTH)


def test_wider_levels_have_wider_intervals(lab16mm, lab_patch):
    widths = [
        np.ptp(estimate(Observation(lab_patch, NOISE), lab16mm, Wiener(), level).interval)
        for level in (0.5, 0.68, 0.95)
    ]
    assert widths[0] < widths[1] < widths[2]


def test_flipping_image_and_psf_together_changes_nothing(lab16mm, lab_patch):
    straight = estimate(Observation(lab_patch, NOISE), lab16mm, Wiener())
    turned = replace(lab16mm, psf=np.ascontiguousarray(lab16mm.psf[:, ::-1, :]))
    flipped = estimate(Observation(lab_patch[::-1], NOISE), turned, Wiener())
    assert flipped.distance == pytest.approx(straight.distance, rel=1e-6)


def test_the_chain_agrees_with_the_grid_and_is_long_enough(lab16mm, scene):
    """Posterior means within 4 Monte Carlo standard errors of the grid's: same density, other arithmetic."""
    for seed, distance in enumerate((1.12, 2.35)):
        image = capture.simulate(scene, lab16mm, distance, capture.Setup(noise="0.005"), seed)[0][:128, :128]
        result = estimate(Observation(image, NOISE), lab16mm, Posterior(seed=seed))
        chain = result.detail["chain"]
        assert len(chain) > 50 * result.stats["autocorrelation_time"]
        assert chain.shape[2] == len(result.detail["names"])
        assert result.detail["log_probability"].shape == chain.shape[:2]
        density = grid(problem(image, lab16mm), 100).density
        error = result.stats["standard_deviation"] / np.sqrt(result.stats["effective_samples"])
        assert abs(chain[:, :, 0].mean() - density.mean) < 4 * error


def problem(image, table):
    from psflut.estimation import Problem
    from psflut.imagers.plain import Plain

    return Problem(image, table, Plain(), NOISE, "given", 0.95)


def test_the_noise_is_sampled_only_where_it_is_not_given(lab16mm, lab_patch):
    given = estimate(Observation(lab_patch, NOISE), lab16mm, Posterior(steps=500))
    guessed = estimate(Observation(lab_patch), lab16mm, Posterior(steps=500))
    assert "ln_sigma" not in given.detail["names"]
    assert guessed.detail["names"][-1] == "ln_sigma"
    assert guessed.stats["noise_source"] == "image"
    assert guessed.stats["noise"] == pytest.approx(0.005, rel=0.2)


def test_a_short_chain_says_so(lab16mm, lab_patch):
    result = estimate(Observation(lab_patch, NOISE), lab16mm, Posterior(steps=200))
    assert result.outcome is Outcome.NOT_CONVERGED


def test_a_saturated_patch_says_so(lab16mm, lab_patch):
    bright = np.minimum(lab_patch * 1.6, 1.0)
    assert np.mean(bright == 1.0) > 0.01
    assert estimate(Observation(bright, NOISE), lab16mm, Wiener()).outcome is Outcome.SATURATED


def test_beyond_the_table_is_at_its_edge_and_far_beyond_fits_badly(lab16mm, scene):
    """Objects nearer and farther than a narrower table reaches, by a little and by much."""
    keep = (lab16mm.axis > 1.2) & (lab16mm.axis < 2.0)
    narrow = replace(lab16mm, axis=lab16mm.axis[keep], psf=lab16mm.psf[keep])

    def see(distance):
        image = capture.simulate(scene, lab16mm, distance, capture.Setup(noise="0.005"), 0)[0][64:192, 64:192]
        return estimate(Observation(image, NOISE), narrow, Wiener())

    for distance, edge in ((1.17, "near"), (2.02, "far")):
        result = see(distance)
        assert (result.outcome, result.stats["edge"]) == (Outcome.AT_EDGE, edge)
    assert see(3.0).stats["misfit"] > 5 * see(1.6).stats["misfit"]


def test_a_known_scene_is_used_or_refused(thesis, scene):
    setup = replace(capture.setup_of(thesis), noise="relative:1e-3")
    image, noise = capture.simulate(scene, thesis, 3.7, setup, seed=0)
    seen = Observation(image, noise, scene=capture.ideal_image(scene, setup))
    assert estimate(seen, thesis, GoldenSection()).distance == pytest.approx(3.7, abs=0.15)
    with pytest.raises(PsflutError, match="known scene"):
        estimate(seen, thesis, Wiener())


@pytest.mark.parametrize("start", ["table", "wiener"])
def test_the_closing_recommendations_of_the_thesis_run(thesis, scene, start):
    image, noise = capture.simulate(scene, thesis, 3.7, capture.setup_of(thesis), seed=0)
    result = estimate(Observation(image[:64, :64], noise), thesis, GoldenSection(start=start, redraws=2, iterations=5))
    assert thesis.span[0] <= result.distance <= thesis.span[1]


@pytest.mark.parametrize("where", [3.21, 3.7, 4.1, 4.49])
def test_golden_section_finds_minima_far_from_zero(where):
    """Algorithm 1 returns a, the lower end of the last bracket: the minimum is within the tolerance above it."""
    answer, probed = golden_section(lambda z: (z - where) ** 2, 3.2, 4.5, 0.001)
    assert 0 <= where - answer <= 0.001 * 1.3 + 1e-9
    assert len(probed) <= 2 + np.ceil(np.log(1000) / np.log((1 + np.sqrt(5)) / 2))


def test_two_sides_of_focus_are_two_modes():
    """A stage axis through focus: blur is alike on both sides, and the estimate says so."""
    from psflut.optics import Camera
    from psflut.psfs.gaussian import Gaussian
    from psflut.table import PSFTable

    camera = Camera(0.016, 0.008, 0.0161, 6e-6)
    focus = camera.focus_distance
    reach = np.linspace(0.1, 0.8, 12)  # dioptres
    side = np.stack([Gaussian()(camera, float(1 / (1 / focus + each)), 41) for each in reach])
    planes = np.concatenate([side[::-1], side])
    table = PSFTable(np.linspace(-1e-3, 1e-3, 24), planes, 6e-6, kind="stage", camera=None)
    from psflut.demo import photograph

    image = capture.capture(
        photograph(),
        table.at(-0.37e-3),
        NOISE,
        np.random.default_rng(0),
        imager=family.parse("psflut.imagers", "plain"),
    )
    result = estimate(Observation(image[64:192, 64:192], NOISE), table, Wiener())
    assert result.outcome is Outcome.AMBIGUOUS
    assert sorted(np.sign([mode.distance for mode in result.modes[:2]])) == [-1, 1]
    assert min(abs(abs(mode.distance) - 0.37e-3) for mode in result.modes) < 0.03e-3
