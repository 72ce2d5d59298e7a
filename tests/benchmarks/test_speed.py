"""What a patch costs, on one core: patches of 128 pixels against 100 distances, in batches.

    python -m pytest -m benchmark tests/benchmarks/test_speed.py -s

The bar is 2 ms a patch where a transform of 128 x 128 single precision pixels takes 0.04 ms: 50 transforms.
"""

import time

import numpy as np
import pytest
from scipy import fft

from psflut import evidence, texture
from psflut.candidates import solve_all
from psflut.capture import capture, psf_of
from psflut.imagers.plain import Plain
from psflut.noise import Noise
from psflut.spectrum import annular_power

pytestmark = pytest.mark.benchmark
NOISE, PATCHES, BATCH, ROUNDS, BAR = Noise(0.005), 128, 16, 7, 50


def seconds(work):
    """The least of several runs: what the machine can do where nobody else asks for it."""
    times = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


@pytest.mark.xfail(
    reason="3 to 4 ms: 250 Newton steps of 12 us, half of it solving and multiplying 10 x 10", strict=False
)
def test_a_patch_of_128_pixels_against_100_distances(lab16mm, lab_patch):
    rng = np.random.default_rng(0)
    distances = rng.uniform(0.9, 4.5, PATCHES)
    shots = [capture(lab_patch, psf_of(lab16mm, z), NOISE, rng, imager=Plain()) for z in distances]
    bank = evidence.bank(lab16mm, (128, 128), Plain(), texture.learnt(), 200)
    noise = np.tile(evidence.noise_power(bank, NOISE, 0.5), (PATCHES, 1))
    single = np.asarray(shots, dtype=np.float32)

    def transforms():
        for image in single:
            fft.rfft2(image)

    def batches():
        for first in range(0, PATCHES, BATCH):
            some = slice(first, first + BATCH)
            solve_all(np.stack([annular_power(shot) for shot in shots[some]]), noise[some], bank)

    reference, ours = seconds(transforms) / PATCHES, seconds(batches) / PATCHES
    print(f"\n{1e3 * ours:.2f} ms a patch, {1e3 * reference:.3f} ms a transform: {ours / reference:.0f} transforms")
    assert ours < BAR * reference
