"""How near and how honest the evidence is on photographs, each with a texture prior learnt from the others.

    python -m pytest -m benchmark tests/benchmarks/test_honesty.py -s

kodak shrunk two-fold, lab16mm, one patch a capture at a random place, noise 0.005, distances even in metres.
"""

import functools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.textures import SIZES, learn, shrink, spectra
from psflut import evidence, texture
from psflut.candidates import solve
from psflut.capture import capture, psf_of
from psflut.density import Density
from psflut.gross import with_gross_errors
from psflut.imagers.plain import Plain
from psflut.images import read_image
from psflut.noise import Noise
from psflut.psfs.pupil import Pupil
from psflut.texture import SECTORS

FOLDER = Path(__file__).parents[3] / "shared/data/kodak"
pytestmark = [
    pytest.mark.benchmark,
    pytest.mark.skipif(not FOLDER.is_dir(), reason="the photographs of kodak are not here"),
]
NOISE, A_PHOTOGRAPH, NEAR, FAR = Noise(0.005), 24, 0.9, 4.5


@functools.cache
def photographs():
    return [shrink(read_image(path, srgb=True).image) for path in sorted(FOLDER.glob("*.png"))]


@functools.cache
def priors():
    """For each photograph what the others teach; the numbers of `calib.gross` are those of all."""
    groups, cut = (
        [spectra(photographs(), size, len(texture.learnt().mean), n) for size in SIZES] for n in (1, SECTORS)
    )
    found = [learn(*([g.without(k) for g in each] for each in (groups, cut))) for k in range(len(photographs()))]
    return [replace(rest(each, 1), turned=rest(each.over(SECTORS), SECTORS)) for each in found]


def rest(prior, sectors):
    known = texture.learnt().over(sectors)
    return replace(prior, misfit=known.misfit, gross=known.gross)


@functools.cache
def captures(table):
    """(photograph, distance, patch of 128 x 128 pixels, of 256 x 256), distances stratified."""
    rng, other = np.random.default_rng(1), np.random.default_rng(2)
    count = A_PHOTOGRAPH * len(photographs())
    distances = rng.permutation(NEAR + (FAR - NEAR) * (np.arange(count) + rng.random(count)) / count)
    out = []
    for n, distance in enumerate(distances):
        scene = photographs()[n // A_PHOTOGRAPH]
        image = capture(scene, psf_of(table, float(distance)), NOISE, rng, imager=Plain())
        out.append((n // A_PHOTOGRAPH, distance, cut(image, 128, rng), cut(image, 256, other).astype(np.float32)))
    return out


def cut(image, side, rng):
    y, x = (int(rng.integers(0, n - side + 1)) for n in image.shape)
    return image[y : y + side, x : x + side]


def read(table, side, sectors=SECTORS):
    """Truth, median, and ends of the 95 and 68 % intervals, (n,) metres each; 64 pixels are the middle of 128."""
    first = evidence.bank(table, (side, side), Plain(), priors()[0], 200, sectors)
    noise, border = evidence.noise_power(first, NOISE, 0.0), (128 - side) // 2
    banks = [first.under(prior.over(sectors)) for prior in priors()]
    rows = []
    for k, distance, small, large in captures(table):
        bank = banks[k]
        patch = large.astype(float) if side == 256 else small[border : border + side, border : border + side]
        found = solve(bank.rings.power(patch), noise, bank)
        exact = Density(found.even, found.fit.log_evidence, table.position)
        density = with_gross_errors(exact, bank.prior.gross)
        rows.append((distance, density.modes()[0].distance, *density.interval(0.95), *density.interval(0.68)))
    return np.array(rows).T


@pytest.fixture(scope="module", params=[64, 128, 256])
def figures(lab16mm, request):
    return summary(f"{SECTORS} sectors", request.param, *read(lab16mm, request.param))


def summary(name, side, truth, median, low, high, low68, high68):
    error = np.abs(median - truth) / truth
    near, middle = truth < 2.5, (truth >= 2.5) & (truth < 3.5)
    inside, missed = (low <= truth) & (truth <= high), np.maximum(low - truth, 0) + np.maximum(truth - high, 0)
    thirds = [inside[(truth >= a) & (truth < a + 1.2)].mean() for a in (0.9, 2.1, 3.3)]
    found = {
        "side": side,
        "near": np.median(error[near]),
        "middle": np.median(error[middle]),
        "far": np.median(error[truth >= 3.5]),
        "beyond 10 %": np.mean(error > 0.1),
        "covers 95": inside.mean(),
        "thirds": thirds,
        "covers 68": np.mean((low68 <= truth) & (truth <= high68)),
        "score": np.mean((high - low + 2 / 0.05 * missed) / truth),
    }
    told = (f"{key} {np.array2string(np.asarray(value), precision=4)}" for key, value in found.items())
    print(f"\n{name}: " + ", ".join(told))
    return found


def test_errors_and_intervals(figures):
    side = figures["side"]
    assert figures["near"] < {64: 0.015, 128: 0.0055, 256: 0.0055}[side]
    assert 0.93 < figures["covers 95"] < 0.97
    assert min(figures["thirds"]) >= 0.9
    assert 0.63 < figures["covers 68"] < (0.73 if side < 256 else 0.77)
    if side == 128:
        assert figures["middle"] < 0.012
        assert figures["score"] < 0.25


def aberrated(table, *zernikes):
    """The table of that lens with aberrations, of which captures are made by the model itself."""
    psf = np.stack([Pupil(zernikes=zernikes)(table.camera, float(z), table.size) for z in table.axis])
    return replace(table, psf=psf, provenance={"model": "pupil", "settings": {"zernikes": [list(z) for z in zernikes]}})


LENSES = {
    "round": (),
    "0.1 waves of astigmatism": ((2, 2, 0.1),),
    "0.25 waves of astigmatism": ((2, 2, 0.25),),
    "0.25 waves of coma": ((3, 1, 0.25),),
}


@pytest.mark.parametrize("side", [64, 128, 256])
@pytest.mark.parametrize("lens", LENSES)
def test_spectra_by_direction(lab16mm, lens, side):
    """Annuli in sectors tell more, through any lens; their 95 % intervals cover 92 to 95 %."""
    table = aberrated(lab16mm, *LENSES[lens])
    whole, cut = (summary(f"{lens}, {n} sectors", side, *read(table, side, n)) for n in (1, SECTORS))
    assert cut["near"] < whole["near"]
    assert cut["score"] < whole["score"]
    assert 0.9 < cut["covers 95"] < 0.98
