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
# # How sure is a distance?
#
# A distance without an error bar is a rumour. psflut's `report` asks every method about one patch and puts on one page
# what the posterior says: how far the distance could be off, why, and whether the model fits the picture at all. The
# same page comes from `psflut report capture.tif --table lab16mm --noise 0.005 -o page.html`.

# %%
import os
import tempfile
from pathlib import Path

import numpy as np

from psflut import Camera, Noise, Observation, PSFTable, Setup, estimate, plots, read_table, report, simulate
from psflut.demo import photograph
from psflut.plots import posteriors, reports
from psflut.posterior_file import write_posterior
from psflut.psfs.pupil import Pupil

SMALL = os.environ.get("PSFLUT_NOTEBOOKS") == "small"  # the tests' size: seconds in place of a minute
SIDE = 64 if SMALL else 128
table, TRUTH, NOISE = read_table("lab16mm"), 1.63, Noise(read=0.005)
image, _ = simulate(photograph(), table, TRUTH, Setup(noise="0.005"), seed=1)
corner = 128 - SIDE // 2
patch = image[corner : corner + SIDE, corner : corner + SIDE]

# %% [markdown]
# ## The answer, as a card
#
# An `Estimate` shows itself: the distance, its interval on the table's span, and the outcome.

# %%
found = estimate(Observation(patch, NOISE), table, "posterior:seed=1")
found

# %% [markdown]
# ## The posterior
#
# Every distance that explains the patch, by how well it does. The bands hold 50, 68 and 95 % of the probability.

# %%
samples = found.detail["distances"]
bands = {level: tuple(np.quantile(samples, [0.5 - level / 2, 0.5 + level / 2])) for level in (0.5, 0.68, 0.95)}
posteriors.posterior(samples, bands, found.modes, table.span, "distance (m)")

# %% [markdown]
# ## Does the model fit?
#
# The posterior predicts the power spectrum that such a patch would have. Blur digs the valleys: where they lie is what
# tells the distance. If the points left the band, the answer would deserve no trust, however narrow its interval.

# %%
seen = found.detail["prediction"]
reports.spectrum(seen.frequency, seen.power, seen.noise, seen.mean, seen.replicated)

# %% [markdown]
# ## Where the uncertainty comes from
#
# Photons and read noise; the texture, of which a patch holds little; the table's own errors, none here, as a model
# made it.

# %%
reports.budget(found.stats["budget"])

# %% [markdown]
# ## When two distances explain a patch
#
# Focus the lens in the middle of the range, and an object before it looks much like one behind it. The posterior then
# has two modes, and the outcome says so instead of choosing quietly.

# %%
lens = Camera.of(16e-3, 6e-6, f_number=2, focus_distance=1.5)
axis = 1 / np.linspace(1 / 1.1, 1 / 2.4, 24)
planes = np.stack([Pupil()(lens, z, 25) for z in axis])
made = {"model": "pupil", "settings": {}}  # the capture comes from it, not from the table
across = PSFTable(axis, planes, lens.pixel_pitch, camera=lens, provenance=made)
blurred, _ = simulate(photograph(), across, 1.85, Setup(noise="0.005"), seed=3)
torn = estimate(
    Observation(blurred[64:128, 64:128], NOISE), across, "posterior:seed=1:steps=1000" if SMALL else "posterior:seed=1"
)
torn

# %%
draws = torn.detail["distances"]
bands = {level: tuple(np.quantile(draws, [0.5 - level / 2, 0.5 + level / 2])) for level in (0.5, 0.68, 0.95)}
posteriors.posterior(draws, bands, torn.modes, across.span, "distance (m)")

# %% [markdown]
# ## The whole page
#
# `report` returns an object that shows itself here and saves itself as one file, which needs no network and no other
# file.

# %%
page = report(Observation(patch, NOISE), table, name="a patch of the cameraman", seed=1)
folder = Path(tempfile.mkdtemp())
page.save(folder / "page.html")
page

# %% [markdown]
# ## For other tools
#
# The chain goes into a file that ArviZ and xarray open (`pip install psflut[lab]`).

# %%
write_posterior(found, folder / "chain.nc", {"image": "the cameraman"})
print(sorted(path.name for path in folder.iterdir()))
plots.pictures({"the patch": patch, f"restored at {found.distance:.2f} m": found.detail["restored"]})
