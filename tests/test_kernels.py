"""Compiled code that is kept, and what it is kept for."""

import os
import subprocess
import sys

import numpy as np
import pytest

from psflut.kernels.algebra import solve
from psflut.kernels.elementary import exponentials, logarithms

INNER = """from psflut.kernels import compiled
@compiled
def inner(x):
    return x + {}
"""
OUTER = """from inner import inner
from psflut.kernels import compiled
@compiled
def outer(x):
    return 2 * inner(x)
"""


def test_what_is_kept_is_stale_where_another_file_of_the_folder_has_changed(tmp_path):
    """numba asks for the file of the function alone; the second of three runs finds what the first kept."""
    told, code = [], "from outer import outer; print(outer(1), sum(outer.stats.cache_hits.values()))"
    (tmp_path / "outer.py").write_text(OUTER)
    for added in (1, 1, 20):
        if not told or added == 20:
            (tmp_path / "inner.py").write_text(INNER.format(added))
        path = os.pathsep.join([str(tmp_path), *sys.path])
        done = subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "PYTHONPATH": path},
            capture_output=True,
            text=True,
            check=True,
        )
        told.append(done.stdout.strip())
    assert told == ["4 0", "4 1", "42 0"]


def test_exponentials_and_logarithms_are_numpys():
    values, out, bits = np.linspace(-690, 690, 4001), np.empty(4001), np.empty(4001, np.int64)
    exponentials(values, out, bits, bits.view(np.float64))
    np.testing.assert_allclose(out, np.exp(values), rtol=1e-8)
    logarithms(np.exp(values).view(np.int64), out, bits, bits.view(np.float64))
    np.testing.assert_allclose(out, values, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("order", [1, 2, 10])
def test_equations_are_solved_as_numpy_solves_them(order, rng):
    """Many at once; one that is not positive has no determinant, and spoils no other."""
    root = rng.standard_normal((7, order, order + 3))
    matrices, right = root @ root.swapaxes(1, 2), rng.standard_normal((7, order))
    matrices[3] = -np.eye(order)
    rows, columns = np.triu_indices(order)
    found, log_determinant, sound = np.array(right.T), np.empty(7), np.arange(7) != 3
    solve(7, np.array(matrices[:, rows, columns].T), found, log_determinant, np.empty((2, 7)))
    expected = np.linalg.solve(matrices, right[..., None])[..., 0]
    np.testing.assert_allclose(found.T[sound], expected[sound], rtol=1e-8)
    np.testing.assert_allclose(log_determinant[sound], np.linalg.slogdet(matrices[sound])[1])
    assert np.isnan(log_determinant[3])
