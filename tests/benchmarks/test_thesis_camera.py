"""The thesis' camera (3.2 to 4.5 m, 256 pixels, normalised Laplacian) against the bound that `psflut limits` prints.

    python -m pytest -m benchmark tests/benchmarks/test_thesis_camera.py -s

Photographs that ship with scikit-image, of which the texture prior has seen none; the bound is that of each one's own
contrast, with the table's span as a prior (`Limits.within`). The thesis leaves open what its noise of 1e-3 is a
variance of: of the image (full scale 1), or relative to that of the capture.
"""

import functools

import numpy as np
import pytest
from test_two_images import field

from psflut import Observation, Setup, estimate, limits, texture
from psflut.capture import ideal_image, simulate
from psflut.imagers.laplacian import Laplacian
from psflut.noise import Noise
from psflut.photographs import choose

pytestmark = pytest.mark.benchmark
DISTANCES = (3.27, 3.43, 3.63, 3.79, 3.91, 4.03, 4.17, 4.31, 4.41)
SHAPE, READ, FIELDS = (256, 256), Noise(np.sqrt(1e-3)), 80


@functools.cache
def scenes():
    return [(name, scene[:256, :256]) for name, scene in choose(None, 256)]


SOFT = (
    "2.0 times the bound, 82 % covered: at 7 cm it is how soft a photograph itself is that tells, brick and retina most"
)


@pytest.mark.parametrize(
    "reading", ["variance", pytest.param("relative", marks=pytest.mark.xfail(reason=SOFT, strict=False))]
)
def test_errors_against_the_bound(thesis, reading):
    setup, rows = Setup(imager="laplacian:0.2", normalise=True, noise=f"{reading}:1e-3"), []
    for number, (name, scene) in enumerate(scenes()):
        contrast = float(ideal_image(scene, setup).std())
        told = limits.bound(thesis, SHAPE, READ, Laplacian(0.2), contrast=contrast, relative=reading == "relative")
        mine = []
        for seed, distance in enumerate(DISTANCES):
            image, noise = simulate(scene, thesis, distance, setup, 100 * number + seed)
            found = estimate(Observation(image, noise), thesis, "wiener")
            inside = found.interval[0] <= distance <= found.interval[1]
            mine.append((np.interp(distance, told.axis, told.within), found.distance - distance, inside))
        least, error, inside = np.array(mine).T
        print(f"\n{name:18} contrast {contrast:.3f}, RMSE {100 * rms(error):5.1f} cm,", end=" ")
        print(f"bound {100 * rms(least):5.1f} cm,", end=" ")
        print(f"bias {100 * error.mean():+5.1f} cm, 95 % covers {inside.sum():.0f} of {len(inside)}", end="")
        rows += mine
    least, error, inside = np.array(rows).T
    print(f"\n{reading}:1e-3, {len(rows)} captures: RMSE {100 * rms(error):.1f} cm,", end=" ")
    print(f"{rms(error) / rms(least):.2f} times the bound, median {100 * np.median(np.abs(error)):.1f} cm,", end=" ")
    print(f"95 % intervals cover {inside.mean():.1%}")
    assert rms(error) < 1.2 * rms(least)
    assert inside.mean() > 0.9


@pytest.mark.parametrize("reading", ["variance", "relative"])
def test_scenes_of_the_model_itself(thesis, reading):
    """Gaussian fields with spectra of the texture prior, distances even over the span; bounds for their contrast."""
    setup = Setup(imager="laplacian:0.2", normalise=True, noise=f"{reading}:1e-3")
    rng, prior = np.random.default_rng(5), texture.learnt()
    shots = []
    for seed in range(FIELDS):
        scene, distance = field(prior, rng)[0], rng.uniform(*thesis.span)
        image, noise = simulate(scene, thesis, distance, setup, seed)
        shots.append((distance, ideal_image(scene, setup).std(), estimate(Observation(image, noise), thesis, "wiener")))
    distance, contrast = np.array([shot[:2] for shot in shots]).T
    relative = reading == "relative"
    told = limits.bound(thesis, SHAPE, READ, Laplacian(0.2), contrast=float(np.median(contrast)), relative=relative)
    least = np.interp(distance, told.axis, told.within)
    error = np.array([found.distance for *_, found in shots]) - distance
    inside = np.mean([found.interval[0] <= z <= found.interval[1] for z, _, found in shots])
    print(f"\n{reading}:1e-3, {FIELDS} fields of contrast {np.median(contrast):.3f}:", end=" ")
    print(f"RMSE {100 * rms(error):.1f} cm, {rms(error) / rms(least):.2f} times the bound, 95 % covers {inside:.1%}")
    assert rms(error) < 1.2 * rms(least)
    assert inside > 0.9


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))
