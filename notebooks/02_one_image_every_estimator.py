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
# # One image, every estimator
#
# A camera with a fixed lens blurs an object by an amount that depends on its distance. Here one photograph is
# captured at a distance that we know and then forget, and every method of psflut reads the distance back from a
# single patch of that capture.

# %%
import os

import numpy as np

from psflut import Noise, Observation, Setup, estimate, plots, read_table, simulate
from psflut.demo import photograph
from psflut.estimation import for_any_scene

SIDE = 64 if os.environ.get("PSFLUT_NOTEBOOKS") == "small" else 128  # 64 in the tests, to be quick
MIDDLE = (slice(128 - SIDE // 2, 128 + SIDE // 2),) * 2

# %% [markdown]
# ## The table
#
# `lab16mm` ships with psflut: a 16 mm f/2 lens focused at 6 m, 6 um pixels, without aberration. The blur disc
# shrinks from 12 pixels of radius at 0.8 m to a third of a pixel at 5 m. Its rim is sharp and bright, and that
# fine structure is what tells distance.

# %%
table = read_table("lab16mm")
plots.psfs(table)

# %% [markdown]
# ## The capture
#
# The capture comes from the optical model at the very distance, never from the table that will judge it, and 1.63
# m lies between two planes of the table.

# %%
TRUTH, NOISE = 1.63, Noise(read=0.005)
scene = photograph()
image, _ = simulate(scene, table, TRUTH, Setup(noise="0.005"), seed=1)
patch = image[MIDDLE]
plots.pictures({"scene": scene, f"capture at {TRUTH} m": image, "the patch": patch})

# %% [markdown]
# ## Every method on the same patch
#
# `estimate(observation, table, method)` is the one verb. An `Estimate` has a distance, an interval and an
# outcome, whatever the method.

# %%
methods = for_any_scene()
results = {method: estimate(Observation(patch, NOISE), table, method) for method in methods}

print(f"truth {TRUTH} m\n{'method':16}{'distance':>10}{'95 % interval':>20}  {'outcome':14}{'seconds':>8}")
for method, found in results.items():
    near, far = found.interval
    interval = f"{near:.3f} .. {far:.3f} m"
    seconds = found.stats["seconds"]
    print(f"{method:16}{found.distance:8.3f} m{interval:>20}  {found.outcome.name.lower():14}{seconds:8.2f}")

# %%
plots.curves({method: [found] for method, found in results.items()}, [TRUTH])

# %% [markdown]
# `golden_section` is the thesis' method, reported as it is: it deconvolves blindly and then looks for the
# distance whose reblurring has the capture's focus. Its answer follows the size of the PSF that it starts from,
# hardly the object, and its interval (scatter over re-drawn noise) knows nothing of that.
#
# `wiener` and `posterior` ask for the evidence of every tabled distance with the scene integrated out: the one on
# a grid, the other by sampling. They are two computations of one posterior, so they agree.

# %%
wiener, posterior = results["wiener"], results["posterior"]
print(f"wiener    {wiener.distance:.4f} m   posterior {posterior.distance:.4f} m")
print(f"misfit {wiener.stats['misfit']:.2f} (0.5 is usual)")
print(f"{posterior.stats['effective_samples']:.0f} effective samples")

# %% [markdown]
# ## What it restores
#
# The distance gives the PSF, the PSF gives the picture back, as far as noise and the zeros of the transfer
# function allow.

# %%
restored = {f"{method}, {found.distance:.2f} m": found.detail["restored"] for method, found in results.items()}
plots.pictures({"sharp": scene[MIDDLE], "capture": patch, **restored}, columns=3)

# %% [markdown]
# ## Where the data say nothing
#
# A patch without texture has no blur to read. The answer is then the prior's interval, and it says so.

# %%
blank = 0.5 + NOISE.read * np.random.default_rng(0).standard_normal((SIDE, SIDE))
nothing = estimate(Observation(blank, NOISE), table, "wiener")
print(nothing.outcome.name, nothing.interval)
print(nothing.outcome.value)
