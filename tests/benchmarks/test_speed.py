"""What things cost, as ratios to a reference timed in the same run, on one core.

    python -m pytest -m benchmark tests/benchmarks/test_speed.py -s

Times are the least of several runs in processor time, which others on the machine disturb least.
"""

import subprocess
import sys
import time
import tracemalloc
from functools import partial

import numpy as np
import pytest
import tifffile
from scipy import fft, ndimage
from scipy.signal import fftconvolve
from skimage import restoration

from psflut import chain, evidence, restore, texture
from psflut.batch import estimate_all
from psflut.candidates import solve_all
from psflut.capture import Setup, capture, psf_of, simulate
from psflut.estimators.posterior import Posterior
from psflut.grid import grid
from psflut.imagers.plain import Plain
from psflut.noise import Noise
from psflut.problem import Problem

pytestmark = pytest.mark.benchmark
NOISE, PATCHES, BATCH, ROUNDS = Noise(0.005), 128, 16, 7
MARGIN = 120


def seconds(work, clock=time.process_time, rounds=ROUNDS):
    """The least of several runs: what the machine can do where nobody else asks for it."""
    times = []
    for _ in range(rounds):
        start = clock()
        work()
        times.append(clock() - start)
    return min(times)


def least(*works, clock=time.process_time):
    """The least time of each, by turns, so that all meet the same machine."""
    return np.min([[seconds(work, clock, 1) for work in works] for _ in range(2 * ROUNDS)], axis=0)


def peak(work):
    """Memory that numpy takes on, MB."""
    tracemalloc.start()
    work()
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return most / 1e6


def transforms(images):
    return lambda: [fft.rfft2(image) for image in images.astype(np.float32)]


@pytest.fixture(scope="module")
def blurred(scene):
    """A photograph of 256 x 256 seen through a disc of 17 x 17 pixels, single precision."""
    y, x = np.mgrid[:17, :17] - 8
    disc = (y**2 + x**2 <= 49).astype(np.float32)
    disc /= disc.sum()
    return ndimage.convolve(scene.astype(np.float32), disc, mode="reflect").clip(1e-3), disc


def test_a_patch_of_128_pixels_against_the_whole_table(lab16mm, lab_patch):
    """The bar: 50 transforms; 2 ms where one takes 0.04."""
    rng = np.random.default_rng(0)
    distances = rng.uniform(0.9, 4.5, PATCHES)
    shots = np.stack([capture(lab_patch, psf_of(lab16mm, z), NOISE, rng, imager=Plain()) for z in distances])
    bank = evidence.bank(lab16mm, (128, 128), Plain(), texture.learnt(), 200, texture.SECTORS)
    noise = np.tile(evidence.noise_power(bank, NOISE, 0.5), (PATCHES, 1))

    def batches():
        for first in range(0, PATCHES, BATCH):
            some = slice(first, first + BATCH)
            solve_all(bank.rings.power(shots[some]), noise[some], bank)

    batches()
    reference, ours = seconds(transforms(shots)) / PATCHES, seconds(batches) / PATCHES
    print(
        f"\n{1e3 * ours:.2f} ms a patch, {1e3 * reference:.3f} ms a transform: {ours / reference:.0f} transforms;",
        end=" ",
    )
    print(f"{peak(batches):.0f} MB, {BATCH} patches at once")
    assert ours < 50 * reference


def test_frames_of_266_patches(lab16mm, scene):
    """640 x 480 pixels in patches of 64 every 32: the bar, 10 frames a second, is 0.75 ms of a core for a patch."""
    rng = np.random.default_rng(0)
    shots = [capture(scene, psf_of(lab16mm, z), NOISE, rng, imager=Plain()) for z in rng.uniform(0.9, 4.5, 19)]
    places = rng.integers(0, 192, (19, 14, 2))
    patches = np.stack([shot[y : y + 64, x : x + 64] for shot, own in zip(shots, places, strict=True) for y, x in own])

    def work(some=patches, threads=1):
        return estimate_all(some, lab16mm, NOISE, candidates=64, threads=threads)

    work()
    reference, ours, half = least(transforms(patches), work, lambda: work(patches[::2]))
    (wall,) = least(lambda: work(threads=2), clock=time.perf_counter)
    print(
        f"\n{1e3 * ours / 266:.2f} ms of a core a patch, {ours / reference:.0f} transforms; {1 / wall:.1f} frames a "
        f"second by two threads; twice the patches cost {ours / half:.2f} times as much; {peak(work):.0f} MB"
    )
    assert ours < 2.2 * half  # linear but for the noise of timing


def test_frames_a_second_of_a_sequence_by_two_processes(lab16mm, scene, tmp_path):
    """psflut depthmap frames --workers 2, 640 x 480: what 40 frames take longer than 8, so that no start is counted."""
    setup = Setup(noise=str(NOISE.read))
    shots = [simulate(scene, lab16mm, z, setup, k)[0] for k, z in enumerate((1.1, 1.7, 2.6, 3.9))]
    for k in range(40):
        mosaic = np.block([[shots[(k + row + column) % 4] for column in range(3)] for row in range(2)])
        tifffile.imwrite(tmp_path / f"{k:02}.tif", mosaic[:480, :640].astype(np.float32))

    def wall(count):
        words = ["depthmap", *(f"{k:02}.tif" for k in range(count)), "--table", "lab16mm", "--noise", "0.005"]
        words += ["--workers", "2", "-o", f"{count}.zarr", "--overwrite"]
        start = time.perf_counter()
        code = "from psflut.cli import main; main()"
        subprocess.run([sys.executable, "-c", code, *words], cwd=tmp_path, check=True, capture_output=True)
        return time.perf_counter() - start

    few, many = (min(wall(count) for _ in range(2)) for count in (8, 40))
    print(f"\n{32 / (many - few):.1f} frames a second by two processes, files and intervals included")


def test_the_posterior(lab16mm, lab_patch):
    """The bar is 2 s; a plain run asks for the same points one at a time, by the default move."""
    import emcee

    problem = Problem(lab_patch, lab16mm, Plain(), NOISE, "given", 0.95)
    own = Posterior()
    found = grid(problem, own.candidates)
    steps = len(chain.sample(found, own.steps, own.walkers, own.seed).points)
    start, log = chain._start(found, None, own.walkers, np.random.default_rng(0)), chain.log_probability(found, False)

    def plain():
        sampler = emcee.EnsembleSampler(*start.shape, lambda point: log(point[None])[0])
        sampler.run_mcmc(start, steps)

    ours, theirs = seconds(lambda: own.solve(problem), rounds=3), seconds(plain, rounds=1)
    print(f"\n{ours:.2f} s with {steps} steps; a plain run of as many {theirs / ours:.1f} times as long;", end=" ")
    print(f"{peak(lambda: own.solve(problem)):.0f} and {peak(plain):.0f} MB")
    assert ours < theirs


def test_richardson_lucy(blurred):
    image, disc = blurred
    flat = np.full_like(image, 0.5)

    def own(psf=disc):
        return restore.richardson_lucy(image, psf, 20, start=flat, acceleration=False)

    def skimage(psf=disc):
        return restoration.richardson_lucy(image, psf, num_iter=20, clip=False)

    wide = ndimage.zoom(disc, 31 / 17, order=1)
    wide /= wide.sum()
    plain, ours, plain_wide, ours_wide = least(skimage, own, partial(skimage, wide), partial(own, wide))
    mirrored = np.pad(image, MARGIN, mode="symmetric")
    apart = restoration.richardson_lucy(mirrored, disc, num_iter=20, clip=False)[MARGIN:-MARGIN, MARGIN:-MARGIN]
    print(
        f"\n{plain / ours:.2f} times as fast as scikit-image, {plain_wide / ours_wide:.2f} with a PSF of 31 x 31; "
        f"differs by {off(own(), apart):.1e} at most where it is given the image mirrored beyond its border; without, "
        f"its dark border moves it by {off(skimage(), apart):.1e}; {peak(own):.1f} and {peak(skimage):.1f} MB"
    )
    assert off(own(), apart) < 1e-3
    assert 2 * ours < plain


def off(one, other):
    """Largest relative difference beyond three widths of the PSF from the border."""
    inside = slice(51, -51)
    return np.abs(one[inside, inside] / other[inside, inside] - 1).max()


def test_blind_richardson_lucy(blurred):
    """Against image and PSF by turns, each a step of scikit-image's."""
    image, disc = blurred

    def plain():
        scene, spot = image, disc
        for _ in range(20):
            ratio = image / np.maximum(convolved(scene, spot), 1e-6)
            scene, spot = scene * convolved(ratio, spot[::-1, ::-1]), updated(scene, ratio, spot)

    def ours():
        restore.blind_richardson_lucy(image, disc, 20)

    print(f"\n{seconds(plain, rounds=3) / seconds(ours, rounds=3):.2f} times as fast as a plain one;", end=" ")
    print(f"{peak(ours):.1f} and {peak(plain):.1f} MB")


def convolved(image, kernel):
    return fftconvolve(image, kernel, mode="same")


def updated(scene, ratio, spot):
    """The step of the PSF: the ratio correlated with the scene, at the lags of the PSF."""
    whole = fftconvolve(ratio, scene[::-1, ::-1], mode="full")
    middle, half = np.array(whole.shape) // 2, len(spot) // 2
    step = spot * whole[middle[0] - half : middle[0] + half + 1, middle[1] - half : middle[1] + half + 1]
    return step / step.sum()


def test_wiener(blurred):
    image, disc = blurred

    def ours():
        restore.wiener(image, disc, 0.01)

    def theirs():
        restoration.wiener(image, disc, 0.01, clip=False)

    print(
        f"\n{seconds(theirs) / seconds(ours):.2f} times as fast as scikit-image, with mirrored borders; "
        f"{peak(ours):.1f} and {peak(theirs):.1f} MB"
    )
