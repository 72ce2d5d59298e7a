"""The compiled spline and the borders of modes, against scipy's."""

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import find_peaks

from psflut.kernels import curves


def test_the_spline_is_scipys():
    rng = np.random.default_rng(0)
    for count in (4, 5, 40):
        places, values, out = np.sort(rng.random(count)), rng.standard_normal(count), np.empty(501)
        curves.spline(places, values, out)
        exact = CubicSpline(places, values)(np.linspace(places[0], places[-1], 501))
        np.testing.assert_allclose(out, exact, atol=1e-9 * np.abs(exact).max())


def test_modes_are_the_peaks_that_stand_out():
    rng = np.random.default_rng(1)
    for _ in range(200):
        values = np.exp(3 * np.convolve(rng.standard_normal(300), np.hanning(rng.integers(4, 60)), "same") / 3)
        values = np.round(values / values.max(), rng.integers(2, 12))  # level tops among them
        peaks, found = find_peaks(np.pad(values, 1), height=1e-3, prominence=0, plateau_size=1)
        own = peaks[found["prominences"] >= 0.5 * found["peak_heights"]] - 1
        cuts = [a + int(np.argmin(values[a:b])) for a, b in zip(own[:-1], own[1:], strict=True)]
        first = np.zeros(2, np.int64)
        np.testing.assert_array_equal(curves.modes(values[None], 1e-3, 0.5, first), [0, *cuts, 299])
        assert first[1] == len(cuts) + 2
