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
# # Designing a set-up: 0.5 % at 2 m
#
# Before anything is bought or screwed down: which aperture, which focus and which aberration would let one image tell a
# distance of 2 m within 0.5 %, 1 cm? `psflut.limits.bound` answers from the model alone. It is the Cramer-Rao bound:
# no method that knows scenes as the prior does can be nearer to the truth on average.

# %%
import os

import numpy as np

from psflut import Camera, Noise, Observation, PSFTable, Setup, estimate, plots, simulate, texture
from psflut.demo import photograph
from psflut.imagers.plain import Plain
from psflut.limits import bound
from psflut.optics import blur_radius
from psflut.plots.look import styled
from psflut.psfs.pupil import Pupil

SMALL = os.environ.get("PSFLUT_NOTEBOOKS") == "small"  # the tests' size: seconds in place of minutes
SIDE = 64 if SMALL else 160
PLACE, GOAL, NOISE = 2.0, 0.5, Noise(read=0.005)
NEAR, FAR = 1.5, 2.7


def table_of(f_number, focus=6.0, waves=0.0, planes=16):
    """A table around 2 m of a 16 mm lens with 6 um pixels and so many waves of spherical aberration."""
    lens = Camera.of(16e-3, 6e-6, f_number=f_number, focus_distance=focus)
    axis = 1 / np.linspace(1 / NEAR, 1 / FAR, planes)
    size = 2 * int(np.ceil(1.4 * np.abs(blur_radius(lens, axis)).max() / lens.pixel_pitch + 6)) + 1
    model = Pupil(zernikes=((4, 0, waves),))
    made = {
        "model": "pupil",
        "settings": {"zernikes": model.zernikes},
    }  # captures will come from it, not from the table
    psf = np.stack([model(lens, z, size) for z in axis])
    return PSFTable(axis, psf, lens.pixel_pitch, camera=lens, provenance=made)


def limit(table):
    """The bound for scenes like photographs, of which only the prior is known."""
    return bound(table, (SIDE, SIDE), NOISE, Plain(), prior=texture.learnt().over(texture.SECTORS))


def percent(table):
    """The bound at 2 m in % of the distance."""
    found = limit(table)
    return 100 * float(np.interp(PLACE, found.axis, found.relative))


# %% [markdown]
# ## The aperture
#
# A wide aperture turns a small change of distance into a large change of blur, until so much is blurred away that
# noise hides what is left.

# %%
stops = (1.4, 2.8) if SMALL else (1.4, 2.0, 2.8, 4.0)
plots.limits({f"f/{stop:g}": limit(table_of(stop)) for stop in stops}, f"16 mm, focused at 6 m, {SIDE} px")

# %% [markdown]
# ## Aperture and focus together
#
# Each cell is a set-up. Focused too near to the object there is little blur to read; too far from it, too much.

# %%
stops = (1.4, 2.8) if SMALL else (1.2, 1.4, 2.0, 2.8, 4.0)
focuses = (3.0, 12.0) if SMALL else (1.2, 3.0, 4.0, 6.0, 12.0, 100.0)
errors = np.array([[percent(table_of(stop, focus)) for focus in focuses] for stop in stops])


@styled
def sheet(values, rows, columns, row_name, column_name):
    """Numbers as tiles, the lower the better; a frame where the goal is met."""
    figure = plots.Plot(figsize=(1.0 * len(columns) + 2.4, 0.62 * len(rows) + 1.2), layout="constrained")
    axis = figure.subplots()
    axis.imshow(-np.log(values), cmap="cividis", aspect="auto")
    middle = -np.log(values).mean()
    for (row, column), value in np.ndenumerate(values):
        colour = "white" if -np.log(value) < middle else "black"
        weight = "bold" if value <= GOAL else "normal"
        axis.text(column, row, f"{value:.2g} %", ha="center", va="center", color=colour, weight=weight)
        if value <= GOAL:
            axis.add_patch(_frame(column, row))
    axis.set_xticks(range(len(columns)), columns)
    axis.set_yticks(range(len(rows)), rows)
    axis.set(xlabel=column_name, ylabel=row_name, title=f"bound at {PLACE:g} m; framed where {GOAL} % is met")
    axis.spines[:].set_visible(False)
    return figure


def _frame(column, row):
    from matplotlib.patches import Rectangle

    return Rectangle((column - 0.46, row - 0.44), 0.92, 0.88, fill=False, edgecolor=plots.COLOURS[1], lw=2.5)


print(f"{np.sum(errors <= GOAL)} of {errors.size} set-ups meet {GOAL} %")
sheet(errors, [f"f/{stop:g}" for stop in stops], [f"{focus:g}" for focus in focuses], "aperture", "focused at (m)")

# %% [markdown]
# ## The aberration
#
# A perfect lens is not the best one. Spherical aberration of one sign gives the defocused disc a bright rim, whose fine
# structure survives the blur; of the other sign it softens the disc, and the valleys of its spectrum fill up.

# %%
best = np.unravel_index(np.argmin(errors), errors.shape)
stop, focus = stops[best[0]], focuses[best[1]]
waves = (-0.3, 0.3) if SMALL else (-0.6, -0.45, -0.3, -0.15, 0.0, 0.15, 0.3)
aberrations = np.array([[percent(table_of(stop, focus, each)) for each in waves]])
sheet(aberrations, [f"f/{stop:g}, {focus:g} m"], [f"{each:+g}" for each in waves], "", "spherical aberration (waves)")

# %%
chosen = table_of(stop, focus, waves[int(np.argmin(aberrations))], planes=48)  # to be read, not only for its bound
print(f"f/{stop:g}, focused at {focus:g} m, {waves[int(np.argmin(aberrations))]:+g} waves: {aberrations.min():.2f} %")
plots.psfs(chosen)

# %% [markdown]
# ## Does it hold?
#
# A bound promises nothing by itself, so photographs decide: patches captured through the chosen set-up at 2 m from
# the optical model, and read with its table. (The bound is a mean over scenes of usual contrast; a photograph of more
# contrast or finer texture is read better than that.)

# %%
distances, errors = PLACE * np.linspace(0.97, 1.03, 3 if SMALL else 12), []
for seed, distance in enumerate(distances):
    image, noise = simulate(photograph(), chosen, distance, Setup(noise=f"{NOISE.read}"), seed)
    top, left = np.random.default_rng(seed).integers(0, 256 - SIDE, 2)
    found = estimate(Observation(image[top : top + SIDE, left : left + SIDE], noise), chosen, "wiener")
    ends = np.array([found.distance, *found.interval])
    errors.append(100 * (ends / distance - 1))
middle, near, far = np.array(errors).T


@styled
def errorbars():
    """Error and interval of every estimate; the goal as a band."""
    figure = plots.Plot(figsize=(6.0, 3.2), layout="constrained")
    axis = figure.subplots()
    axis.axhspan(-GOAL, GOAL, color=plots.COLOURS[2], alpha=0.15, lw=0, label=f"goal, {GOAL} %")
    bars = [middle - near, far - middle]
    axis.errorbar(distances, middle, bars, fmt="o", color=plots.COLOURS[0], label="95 % interval")
    axis.axhline(0, color="0.3", lw=0.8)
    axis.set(xlabel="true distance (m)", ylabel="error (% of the distance)")
    figure.legend(loc="outside upper center", ncols=2)
    return figure


print(f"root mean square error {np.sqrt(np.mean(middle**2)):.2f} %, bound {aberrations.min():.2f} %")
errorbars()
