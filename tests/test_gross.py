"""Gross errors widen tails, not the middle, each mode by its own width; the grid's and the chain's are the same."""

import numpy as np
import pytest

from psflut.density import Density
from psflut.gross import TIMES, moved, with_gross_errors

NODES = np.linspace(-1, 1, 801)


def normal(*modes):
    """A mixture of normal densities (place, sigma), equally heavy."""
    total = sum(np.exp(-0.5 * ((NODES - place) / sigma) ** 2) / sigma for place, sigma in modes)
    return Density(NODES, np.log(np.maximum(total, 1e-300)), np.asarray)


def test_tails_are_those_of_the_mixture():
    found = with_gross_errors(normal((0.1, 0.02)), 0.06)
    wide = np.hypot(1, TIMES) * 0.02
    x = found.nodes
    exact = sum(
        share / sigma * np.exp(-0.5 * ((x - 0.1) / sigma) ** 2) for share, sigma in ((0.94, 0.02), (0.06, wide))
    )
    np.testing.assert_allclose(found.values / found.values.sum(), exact / exact.sum(), atol=1e-4 * exact.max())
    assert np.ptp(found.interval(0.68)) < 1.1 * 2 * 0.02
    assert np.ptp(found.interval(0.99)) > 1.4 * 2 * 2.576 * 0.02


def test_a_second_mode_far_away_does_not_widen_the_first():
    pair = with_gross_errors(normal((-0.6, 0.005), (0.6, 0.01)), 0.1)
    weights = {round(mode.distance, 1): mode.weight for mode in pair.modes()}
    assert weights == pytest.approx({-0.6: 0.5, 0.6: 0.5}, abs=0.01)
    assert np.interp(0.0, pair.nodes, pair.values) < 1e-9


def test_draws_follow_the_density():
    density, rng = normal((-0.3, 0.03), (0.4, 0.02)), np.random.default_rng(0)
    draws = moved(density.sample(rng, 100_000), density, 0.1, rng)
    levels = np.array([0.01, 0.05, 0.3, 0.7, 0.95, 0.99])
    places = with_gross_errors(density, 0.1).quantile(levels)
    np.testing.assert_allclose(np.mean(draws[:, None] < places, axis=0), levels, atol=0.003)
