# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # A table from a model, and one from captures
#
# psflut reads distance by a table: the point spread function (PSF) at known distances. There are two ways to one.
# Where the lens is known, an optical model computes it. Where it is not, which is always to some degree, frames of a
# target at known distances measure it. Here both are made of one lens, so that they can be compared.

# %%
import csv
import os
import tempfile
from dataclasses import replace
from pathlib import Path

import imageio.v3 as iio
import numpy as np

from calib.calibrate import Encoding, calibrate
from calib.manifest import read_manifest
from calib.recipe import build, read_recipe
from calib.targets.point import Point
from psflut import Observation, Setup, estimate, plots, simulate
from psflut.demo import photograph
from psflut.imagers.plain import Plain
from psflut.psfs.pupil import Pupil
from psflut.summary import summarise, words

SMALL = os.environ.get("PSFLUT_NOTEBOOKS") == "small"  # the tests' size: seconds in place of a minute
POSITIONS = 6 if SMALL else 16
folder = Path(tempfile.mkdtemp())

# %% [markdown]
# ## From a model
#
# A recipe names the lens and the distances. They are even in 1 / distance, because blur is.

# %%
recipe = folder / "lens.toml"
recipe.write_text("""
[camera]
focal_length = "16 mm"
f_number = 2
focus_distance = "6 m"
pixel_pitch = "6 um"

[table]
model = "pupil"
distances = { from = "1.2 m", to = "2.5 m", count = 24 }
size = 33
""")
modelled = build(read_recipe(recipe))
plots.psfs(modelled, 6)

# %% [markdown]
# ## Captures
#
# Bright points before the camera, two frames at each distance, 12 bits, photon and read noise. The points lie
# anywhere between pixels, so the frames are made on pixels of a fifth. With a real camera this cell is an afternoon
# with a ruler.

# %%
POINTS = 2 if SMALL else 3  # a side
FINE, SIZE, SIDE, DARK = 5, 33, 60 * POINTS, 0.02
rng = np.random.default_rng(1)


def frames(distance):
    """Two frames of the same points at a distance (metres), as 16 bit integers."""
    fine = Pupil()(replace(modelled.camera, pixel_pitch=modelled.pixel_pitch / FINE), distance, FINE * SIZE)
    peak = fine.reshape(SIZE, FINE, SIZE, FINE).sum(axis=(1, 3)).max()
    light = np.full((SIDE * FINE, SIDE * FINE), 0.02 / FINE**2)
    for y, x in np.ndindex(POINTS, POINTS):
        top, left = (FINE * (30 + 60 * n - SIZE // 2) + int(rng.integers(-FINE, FINE + 1)) for n in (y, x))
        light[top : top + FINE * SIZE, left : left + FINE * SIZE] += 0.5 * fine / peak
    light = light.reshape(SIDE, FINE, SIDE, FINE).sum(axis=(1, 3))
    noisy = (rng.poisson(2e4 * light) / 2e4 + 0.002 * rng.standard_normal(light.shape) + DARK for _ in range(2))
    return [np.round(np.clip(each, 0, 1) * 4095).astype(np.uint16) * 16 for each in noisy]


distances = 1 / np.linspace(1 / 1.25, 1 / 2.4, POSITIONS)
with (folder / "captures.csv").open("w", newline="") as file:
    writer = csv.writer(file)
    writer.writerow(["file", "distance_m"])
    for number, distance in enumerate(distances):
        for shot, picture in zip("ab", frames(distance), strict=True):
            iio.imwrite(folder / f"{number}{shot}.png", picture)
            writer.writerow([f"{number}{shot}.png", float(distance)])

near, far = (iio.imread(folder / f"{number}a.png") / 65535 for number in (0, POSITIONS - 1))
plots.pictures({f"points at {distances[0]:.2f} m": near, f"points at {distances[-1]:.2f} m": far})

# %% [markdown]
# ## From captures
#
# `calibrate` finds the points, puts their pixels together to one PSF a distance, lays a smooth course through the
# distances and leaves each position out once, to say what error to expect. At a prompt:
# `psflut calibrate captures.csv --target point --pixel-pitch "6 um" --dark 0.02 -o camera.zarr.zip`

# %%
measured = calibrate(
    read_manifest(folder / "captures.csv"),
    Point(),
    31,
    modelled.pixel_pitch,
    imager=Plain(),
    encoding=Encoding(dark=DARK),
)
for name, fact in words(summarise(measured)):
    print(f"{name:10} {fact}")
plots.psfs(measured, 6)

# %% [markdown]
# ## Where it is good
#
# The measured table says itself where it reads well: the error that its own noise would give a lone point, and what
# positions that were left out really showed.

# %%
plots.ranges(measured)

# %% [markdown]
# ## The same photograph read by both
#
# A capture at a distance that stands in neither table, made from the optical model. The measured table knows its own
# errors, and its intervals count them.

# %%
TRUTH = 1.63
image, noise = simulate(photograph(), modelled, TRUTH, Setup(noise="0.005"), seed=2)
patch = Observation(image[64:192, 64:192], noise)
results = {name: [estimate(patch, table, "wiener")] for name, table in (("model", modelled), ("captures", measured))}
for name, (found,) in results.items():
    print(f"{name:10} {found.distance:.3f} m, between {found.interval[0]:.3f} and {found.interval[1]:.3f} m")
plots.curves(results, [TRUTH])
