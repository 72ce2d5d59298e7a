"""How near and how honest maps of distance are on scenes with depth, and what a very large one costs.

    python -m pytest -m benchmark tests/benchmarks/test_maps.py -s
    python -m pytest -m benchmark tests/benchmarks/test_maps.py -s -k motorcycle --basetemp figures  # its figures

Scenes are rendered by `psflut.scenes` in PSFs of lab16mm's model, noise 0.005, patches of 64 pixels, stride 32. The
truth of a patch is the weighted median of its pixels' distances, the weights being the squared taper, as they are of
its power: the surface that takes up its middle. The mean of vergence with those weights, which lies between two
surfaces that a patch straddles, is printed beside it. Patches are kept by the width of the map's intervals (`wide`)
relative to distance.
"""

import os
import subprocess
import sys
import time

import numpy as np
import pytest
import tifffile

from psflut import Noise, Setup, depthmap, plots, scenes
from psflut.capture import simulate
from psflut.depthmaps import DepthMap
from psflut.photographs import shipped
from psflut.relief import OWN, around, errors
from psflut.spectrum import annuli
from psflut.tiles import Tiles
from psflut.workers import cores

pytestmark = pytest.mark.benchmark
NOISE, KEPT, GIB = 0.005, (0.3, 0.5, 0.7, 0.8, 0.9, 1.0), 2**30
MOSAIC = ("astronaut", "brick", "camera", "chelsea", "coins", "grass", "gravel", "moon")


def motorcycle():
    return scenes.motorcycle()


def mosaic():
    """Eight photographs side by side on a slant from 1 to 4 m, twelve discs at random distances before it."""
    pictures = [shipped(name)[:150, :190] for name in MOSAIC]
    picture = np.block([[each[:150, :190] for each in pictures[:4]], [each[:150, :190] for each in pictures[4:]]])
    rng, (height, width) = np.random.default_rng(4), picture.shape
    vergence = np.linspace(1.0, 0.25, width) * np.ones(picture.shape)
    y, x = np.mgrid[:height, :width]
    for _ in range(12):
        row, column, radius = rng.uniform(0, height), rng.uniform(0, width), rng.uniform(20, 60)
        inside = np.hypot(y - row, x - column) < radius
        vergence[inside] = np.maximum(vergence[inside], rng.uniform(0.25, 1.0))
    return picture, 1 / vergence


def truths(distance):
    """(ny, nx) weighted median of distance, and weighted mean of vergence as a distance, metres."""
    weight = annuli((64, 64)).taper ** 2
    patches = Tiles(distance.shape).cut(distance)
    order = np.argsort(patches.reshape(*patches.shape[:2], -1), axis=-1)
    sums = np.cumsum(weight.ravel()[order], axis=-1)
    middle = np.argmax(sums >= sums[..., -1:] / 2, axis=-1)[..., None]
    median = np.take_along_axis(patches.reshape(order.shape), np.take_along_axis(order, middle, -1), -1)[..., 0]
    return median, 1 / np.average(1 / patches.reshape(order.shape), axis=-1, weights=weight.ravel())


def judged(found: DepthMap, distance, truth, ends):
    """Relative errors, and whether intervals hold the truth, surest first."""
    order = np.argsort((np.ptp(found.wide, axis=-1) / found.distance).ravel(), kind="stable")
    error = np.abs(distance - truth) / truth
    inside = (ends[..., 0] <= truth) & (truth <= ends[..., 1])
    return error.ravel()[order], inside.ravel()[order]


@pytest.mark.parametrize("make", [motorcycle, mosaic])
def test_errors_and_intervals_of_a_scene_with_depth(lab16mm, make, tmp_path):
    scene, distance = make()
    image, noise = scenes.simulate(scene, distance, lab16mm, Setup(noise=str(NOISE)), 1)
    start = time.perf_counter()
    found = depthmap(image, lab16mm, noise=noise, smooth=True)
    seconds, (median, mean) = time.perf_counter() - start, truths(distance)
    error, inside = judged(found, found.distance, median, found.wide)
    count = len(error)
    print(f"\n{make.__name__}: {count} patches in {seconds:.1f} s, {found.counts()}, sure {found.sure.mean():.0%}")
    rows = {
        "patch's middle": (error, inside),
        "mean vergence": judged(found, found.distance, mean, found.wide),
        "of the patch alone": judged(found, found.distance, median, found.interval),
        "smoothed": judged(found, found.smooth, median, found.wide),
    }
    for name, (apart, covers) in rows.items():
        cells = (f"{100 * np.median(apart[: round(k * count)]):.2f} %" for k in KEPT)
        share = (f"{100 * covers[: round(k * count)].mean():.0f}" for k in KEPT)
        print(f"{name:18}  median error {', '.join(cells)}; 95 % intervals cover {', '.join(share)} %")
    print(f"sure ones: median {100 * np.median(sure_errors(found, median)):.2f} %")
    number = np.arange(1, count + 1)
    running = np.array([np.median(error[:n]) for n in number])
    curve = plots.risk_coverage(number / count, running, np.cumsum(inside) / number, 0.95, make.__name__)
    plots.save(curve, tmp_path / f"{make.__name__}-risk-coverage.png")
    plots.save(found.figure(image), tmp_path / f"{make.__name__}-map.png")
    kept = round(0.7 * count)
    assert np.median(error[:kept]) < 0.06
    assert inside[:kept].mean() >= 0.88


def test_how_much_of_its_stated_error_a_patch_has_to_itself(lab16mm):
    """`psflut.relief.OWN`: of photographs at one distance each."""
    shares = []
    for name in MOSAIC:
        for distance in (1.1, 1.9, 3.0):
            image, noise = simulate(shipped(name)[:256, :256], lab16mm, distance, Setup(noise=str(NOISE)), 3)
            found = depthmap(image, lab16mm, noise=noise)
            even, sd = lab16mm.even(found.distance), errors(found.interval, lab16mm, 0.95)
            apart = np.delete((around(even) - even) ** 2 / (around(sd) ** 2 + sd**2), 4, axis=0)
            shares.append(np.mean(np.nanmean(apart, axis=0)))
    print(f"\nvariance of a difference in the stated one: {np.mean(shares):.2f}, {np.median(shares):.2f} the median")
    assert np.median(shares) == pytest.approx(OWN, rel=0.1)


def sure_errors(found, truth):
    return (np.abs(found.distance - truth) / truth)[found.sure]


def test_an_image_of_20000_x_20000_pixels(lab16mm, tmp_path):
    """psflut depthmap large.tif --table lab16mm --noise 0.005 --stride 64 -o large.zarr: 97,344 patches."""
    side, noise = 20_000, Noise(NOISE)
    scene, distance = scenes.motorcycle()
    tile = scenes.simulate(scene, distance, lab16mm, Setup(noise=str(NOISE)), 1)[0]
    levels = np.rint(65535 * np.clip(tile, 0, 1)).astype(np.uint16)
    large = tifffile.memmap(tmp_path / "large.tif", shape=(side, side), dtype=np.uint16, photometric="minisblack")
    row = np.tile(levels, (1, -(-side // levels.shape[1])))[:, :side]
    for first in range(0, side, len(row)):
        large[first : first + len(row)] = row[: side - first]
    large.flush()
    corner = read_corner(large)
    del large
    words = "depthmap large.tif --table lab16mm --noise 0.005 --stride 64 -o large.zarr"
    start = time.perf_counter()
    child = subprocess.Popen(
        [sys.executable, "-c", "from psflut.cli import main; main()", *words.split()], cwd=tmp_path
    )
    _, status, usage = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    seconds, peak = time.perf_counter() - start, 1024 * usage.ru_maxrss
    processes, cpu = 1 + cores(), usage.ru_utime + usage.ru_stime  # the kernel tells of the largest one
    print(f"\npsflut {words}: {seconds:.0f} s, {cpu:.0f} s of CPU, {peak / GIB:.2f} GiB at most in each of {processes}")
    assert status == 0
    assert processes * peak < 4 * GIB or cores() > 2
    ours = zarr_distance(tmp_path / "large.zarr")
    assert ours.shape == (312, 312)
    np.testing.assert_allclose(ours[:5, :5], depthmap(corner, lab16mm, noise=noise, stride=64).distance, rtol=1e-9)


def read_corner(large):
    return large[:320, :320] / 65535.0


def zarr_distance(path):
    import xarray

    return xarray.open_zarr(path, consolidated=False).distance.values
