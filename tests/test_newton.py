"""The compiled search, against scipy's optimiser with derivatives taken numerically, and what it does without."""

import subprocess
import sys

import numpy as np
import pytest
from scipy import optimize

from psflut import evidence, laplace, texture
from psflut.imagers.plain import Plain
from psflut.kernels import climbing
from psflut.noise import Noise


@pytest.fixture(scope="module", params=[1, texture.SECTORS])
def bank(lab16mm, request):
    return evidence.bank(lab16mm, (128, 128), Plain(), texture.learnt(), 121, request.param)


def hessian(function, point, step=1e-3):
    """Second derivatives by central differences."""
    moves = step * np.eye(len(point))
    rows = [
        [
            function(point + a + b) - function(point + a - b) - function(point - a + b) + function(point - a - b)
            for a in moves
        ]
        for b in moves
    ]
    return np.array(rows) / (4 * step**2)


def test_the_integral_is_that_of_a_general_optimiser(bank, lab_patch):
    power, noise = bank.rings.power(lab_patch), evidence.noise_power(bank, Noise(0.005), 0.5)
    fit = laplace.integrate(power, noise, bank)
    best = int(np.argmax(fit.log_evidence))
    exact = []
    for k in (best - 1, best, best + 1):

        def cost(theta, k=k):
            return -evidence.log_joint(power, bank.attenuation[k], noise, theta, bank)

        found = optimize.minimize(cost, bank.prior.mean, method="BFGS", options={"gtol": 1e-3})
        curvature = hessian(cost, found.x)
        exact.append(-found.fun - 0.5 * np.linalg.slogdet(curvature)[1])
        ours = laplace.curvature_at(power, noise, bank.attenuation[k : k + 1], fit.theta[k : k + 1], bank)[0]
        np.testing.assert_allclose(ours, curvature, rtol=0.02, atol=0.002 * np.abs(curvature).max())
    below, found = max(exact) - np.array(exact), fit.log_evidence[best] - fit.log_evidence[best - 1 : best + 2]
    off = np.abs(found - found.min() - below)  # in any coordinates of theta
    assert (off <= 2 * climbing.TOLERANCE + climbing.SLACK * below).all()


def test_nothing_is_compiled_where_nothing_is_estimated():
    code = "import sys, psflut.cli, psflut.candidates, psflut.batch; print('numba' in sys.modules)"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "False"


def test_it_runs_where_nothing_can_be_kept(tmp_path):
    """A package in a folder that cannot be written, for a user without a home."""
    code = "\n".join(
        [
            "import numba.core.caching as caching",
            "caching.CacheImpl._locator_classes = []",
            "import numpy as np",
            "from psflut.kernels import algebra",
            "one = np.full((1, 1), 2.0)",
            "algebra.solve(1, np.full((1, 1), 4.0), one, np.empty(1), np.empty((2, 1)))",
            "print(one[0], type(algebra.solve._cache).__name__)",
        ]
    )
    told = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "[0.5] NullCache"
