"""What the bound says of lenses.

python -m pytest -m benchmark tests/benchmarks/test_bound.py -s
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.recipe import build, read_recipe
from psflut import limits
from psflut.imagers.plain import Plain
from psflut.noise import Noise

pytestmark = pytest.mark.benchmark
RECIPE = Path(__file__).parents[2] / "tables/lab16mm.toml"
DISTANCES = (0.95, 1.3, 1.7, 2.3, 3.1, 4.1)


def test_the_sign_of_a_fifth_of_a_wave_of_spherical_aberration_changes_the_bound_several_fold():
    recipe, found = read_recipe(RECIPE), {}
    for waves in (-0.2, 0.0, 0.2):
        table = build(replace(recipe, model=replace(recipe.model, zernikes=((4, 0, waves),))))
        one = limits.bound(table, (128, 128), Noise(0.005), Plain())
        found[waves] = np.interp(DISTANCES, one.axis, one.relative)
        row = ", ".join(f"{100 * x:.2f} % at {z} m" for x, z in zip(found[waves], DISTANCES, strict=True))
        print(f"\n{waves:+} waves: {row}")
    assert np.all(found[-0.2] < found[0.0])
    assert np.all(found[0.0] < found[0.2])
    assert 4 < np.max(found[0.2] / found[-0.2]) < 6
