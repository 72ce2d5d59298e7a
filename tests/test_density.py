"""Posterior densities on a grid, against closed forms."""

import numpy as np
import pytest
from scipy import stats

from psflut.density import Density, mirrored


def mixture(weights, means, sigma=0.02, low=0.2, high=1.25, nodes=120):
    even = np.linspace(low, high, nodes)
    parts = [w * stats.norm.pdf(even, m, sigma) for w, m in zip(weights, means, strict=True)]
    return Density(even, np.log(np.sum(parts, axis=0) + 1e-300), lambda v: 1 / np.asarray(v))


def test_a_normal_density_has_its_own_quantiles():
    density = mixture([1.0], [0.7])
    near, far = density.interval(0.95)
    assert 1 / far == pytest.approx(0.7 - 1.96 * 0.02, abs=1e-4)
    assert 1 / near == pytest.approx(0.7 + 1.96 * 0.02, abs=1e-4)
    assert density.mean == pytest.approx(0.7, abs=1e-5)
    (mode,) = density.modes()
    assert mode.weight == pytest.approx(1.0)
    assert mode.distance == pytest.approx(1 / 0.7, abs=1e-4)
    assert density.edge() is None


def test_two_peaks_are_two_modes_with_their_weights():
    heavy, light = mixture([0.7, 0.3], [0.9, 0.5]).modes()
    assert (heavy.weight, light.weight) == (pytest.approx(0.7, abs=1e-3), pytest.approx(0.3, abs=1e-3))
    assert (heavy.distance, light.distance) == (pytest.approx(1 / 0.9, abs=1e-3), pytest.approx(2.0, abs=2e-3))


def test_peaks_that_run_together_are_one_mode():
    assert len(mixture([0.5, 0.5], [0.70, 0.73]).modes()) == 1


def test_a_density_that_ends_high_is_at_an_edge():
    assert mixture([1.0], [1.3]).edge() == "near"
    assert mixture([1.0], [0.15]).edge() == "far"


def test_samples_follow_the_density(rng):
    density = mixture([0.7, 0.3], [0.9, 0.5])
    share = np.interp(np.sort(density.sample(rng, 4000)), density.nodes, density.cumulative)
    assert stats.kstest(share, "uniform").pvalue > 1e-3


def test_a_flat_density_says_what_the_prior_says():
    even = np.linspace(0.2, 1.25, 9)
    density = Density(even, np.zeros(9), lambda v: 1 / np.asarray(v))
    near, far = density.interval(0.9)
    assert (1 / far, 1 / near) == (pytest.approx(0.2 + 0.05 * 1.05), pytest.approx(1.25 - 0.05 * 1.05))


@pytest.mark.parametrize("spread", [lambda u: 0.0 * u + 0.03, lambda u: 0.01 + 0.03 * u])
def test_a_widened_density_is_that_of_draws_with_the_error_added(rng, spread):
    density = mixture([0.6, 0.4], [0.9, 0.28])  # the lighter peak reaches over the grid's end
    wide = density.widened(spread)
    drawn = density.sample(rng, 100_000)
    moved = mirrored(drawn + spread(drawn) * rng.standard_normal(drawn.shape), 0.2, 1.25)
    np.testing.assert_allclose(
        wide.quantile([0.03, 0.3, 0.6, 0.97]), np.quantile(moved, [0.03, 0.3, 0.6, 0.97]), atol=2e-3
    )


def test_normal_errors_add_their_variances_and_none_changes_nothing():
    density = mixture([1.0], [0.7])
    low, high = density.widened(lambda u: 0.0 * u + 0.03).quantile([0.025, 0.975])
    assert high - low == pytest.approx(2 * 1.96 * np.hypot(0.02, 0.03), rel=1e-3)
    assert density.widened(lambda u: 0.0 * u) is density
