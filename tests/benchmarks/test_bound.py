"""What the bound says of lenses, and how near to it the evidence comes on scenes of the model itself.

python -m pytest -m benchmark tests/benchmarks/test_bound.py -s
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fields import SIDE, field

from calib.recipe import build, read_recipe
from psflut import evidence, limits, texture
from psflut.candidates import solve_all
from psflut.capture import capture, psf_of
from psflut.density import Density
from psflut.imagers.plain import Plain
from psflut.noise import Noise
from psflut.texture import SECTORS

pytestmark = pytest.mark.benchmark
RECIPE = Path(__file__).parents[2] / "tables/lab16mm.toml"
DISTANCES = (0.95, 1.3, 1.7, 2.3, 3.1, 4.1)
NOISE, PATCH, FIELDS = Noise(0.005), 128, 1200


def test_the_sign_of_a_fifth_of_a_wave_of_spherical_aberration_changes_the_bound_several_fold():
    recipe, found = read_recipe(RECIPE), {}
    for waves in (-0.2, 0.0, 0.2):
        table = build(replace(recipe, model=replace(recipe.model, zernikes=((4, 0, waves),))))
        one = limits.bound(table, (PATCH, PATCH), NOISE, Plain())
        found[waves] = np.interp(DISTANCES, one.axis, one.relative)
        row = ", ".join(f"{100 * x:.2f} % at {z} m" for x, z in zip(found[waves], DISTANCES, strict=True))
        print(f"\n{waves:+} waves: {row}")
    assert np.all(found[-0.2] < found[0.0])
    assert np.all(found[0.0] < found[0.2])
    assert np.max(found[0.2] / found[-0.2]) > 4


FAR = pytest.param(4.1, marks=pytest.mark.xfail(reason="1.7: the bound rises three-fold within 0.3 m", strict=False))


@pytest.mark.parametrize("distance", [*DISTANCES[:-1], FAR])
def test_matched_scenes_come_within_a_tenth_of_the_bound(lab16mm, distance):
    """Chance moves the ratio by 2 % either way (one sigma), so 1.15 is asserted where the bar is 1.1.

    At 4.1 m it is missed, for the bound is local: it rises three-fold within 0.3 m.
    """
    prior = replace(texture.learnt().over(SECTORS), roughness=0.0, misfit=texture.EVERY)
    rng, psf = np.random.default_rng(round(100 * distance)), psf_of(lab16mm, distance)
    bank = evidence.bank(lab16mm, (PATCH, PATCH), Plain(), prior, 200, SECTORS)
    patch, powers = slice((SIDE - PATCH) // 2, (SIDE + PATCH) // 2), []
    for _ in range(FIELDS):
        theta = rng.multivariate_normal(prior.mean, prior.covariance)
        theta[0] = prior.mean[0]  # the bound is for one contrast
        shot = capture(field(theta, prior, PATCH, rng), psf, NOISE, rng, imager=Plain())
        powers.append(bank.rings.power(shot[patch, patch]))
    noise = np.tile(evidence.noise_power(bank, NOISE, 0.5), (FIELDS, 1))
    densities = [
        Density(each.even, each.fit.log_evidence, lab16mm.position) for each in solve_all(np.array(powers), noise, bank)
    ]
    error = np.array([density.modes()[0].distance for density in densities]) / distance - 1
    near, far = np.array([density.interval(0.95) for density in densities]).T
    one = limits.bound(lab16mm, (PATCH, PATCH), NOISE, Plain())
    least, covered = np.interp(distance, one.axis, one.relative), np.mean((near <= distance) & (distance <= far))
    rmse = np.sqrt(np.mean(error**2))
    print(f"\n{distance} m: RMSE {rmse:.3%}, bound {least:.3%}: {rmse / least:.2f};", end=" ")
    print(f"bias {error.mean():+.3%}, 95 % covers {covered:.1%}")
    assert rmse < 1.15 * least
    assert 0.9 < covered < 0.99
