"""Modes from the command line: points that a manifest names are measured one by one, in frames of the pupil model."""

from dataclasses import replace

import imageio.v3 as iio
import numpy as np
import pytest

from calib.singles import Singles
from calib.targets.point import Point
from psflut import Noise, Observation, estimate, read_table
from psflut.errors import PsflutError
from psflut.images import read_image
from psflut.optics import Camera
from psflut.psfs.pupil import Pupil

SIZE, PITCH, STEP = 21, 6e-6, 50
LAB = Camera.of(focus_distance=6.0, focal_length=16e-3, aperture_diameter=8e-3, pixel_pitch=PITCH)
DISTANCES = 1 / np.linspace(1 / 1.2, 1 / 2.4, 6)
COMAS = (-0.25, -0.12, 0.0, 0.12, 0.25)
DARK = {1: (1,), 2: (4,), 3: (4,)}
"""Of six distances, where points are not to be seen: the second point keeps five, the last one four."""
WORDS = ("--target", "point:oversampling=1", "--pixel-pitch", "6 um", "--size", SIZE)


def psf(distance, coma):
    """A point whose coma goes with its place in depth, as over the field of a tilted specimen."""
    return Pupil(zernikes=((3, 1, coma),))(LAB, float(1 / (1 / distance + 0.04 * coma)), SIZE)


def frame(distance, rng, dark=()):
    """Five points side by side, but for those that stay dark; 16 bits."""
    light = np.full((STEP, STEP * len(COMAS)), 0.05)
    for k, coma in enumerate(COMAS):
        plane = psf(distance, coma)
        spot = light[15 : 15 + SIZE, STEP * k + 15 : STEP * k + 15 + SIZE]
        spot += 0.7 * plane / plane.max() * (k not in dark)
    return np.round((light + 0.002 * rng.standard_normal(light.shape)) * 65535).astype(np.uint16)


@pytest.fixture(scope="module")
def captures(tmp_path_factory):
    """The x of all points wanders by a pixel."""
    folder, rng = tmp_path_factory.mktemp("points"), np.random.default_rng(5)
    lines = ["file,distance_m,x,y"]
    for k, distance in enumerate(DISTANCES):
        iio.imwrite(folder / f"{k}.png", frame(distance, rng, dark=DARK.get(k, ())))
        lines += [f"{k}.png,{float(distance)!r},{STEP * j + 25 + k % 2},25" for j in range(len(COMAS))]
    (folder / "captures.csv").write_text("\n".join(lines))
    return folder / "captures.csv"


@pytest.fixture(scope="module")
def table(captures, run):
    output = captures.parent / "table.zarr.zip"
    with pytest.MonkeyPatch.context() as patch:
        seen = []
        patch.setattr("calib.captures.read_image", lambda *args: seen.append(args[0].name) or read_image(*args))
        assert run("calibrate", captures, *WORDS, "--modes", 2, "-o", output) == 0
    assert sorted(seen) == [f"{k}.png" for k in range(len(DISTANCES))]
    return read_table(output)


def test_modes_of_measured_points_tell_the_distance_of_others(table):
    """Points between those of the calibration, at distances between its own; without the modes they are misread."""
    rng, found = np.random.default_rng(1), {}
    tables = {"modes": table, "none": replace(table, psf_modes=None)}
    for truth in rng.uniform(1.3, 2.2, 8):
        image = np.pad(0.7 * (point := psf(truth, rng.uniform(-0.2, 0.2))) / point.max(), 8) + 0.05
        observation = Observation(image + 0.003 * rng.standard_normal(image.shape), Noise(0.003))
        for name, each in tables.items():
            found.setdefault(name, []).append(1 / estimate(observation, each, "point").distance - 1 / truth)
    assert np.std(found["modes"]) < 0.5 * np.std(found["none"])


def test_info_says_how_many_modes_there_are_and_of_how_many_points(table, captures, run, capsys):
    assert table.psf_modes.shape == (2, *table.psf.shape)
    assert run("info", captures.parent / "table.zarr.zip") == 0
    shown = capsys.readouterr().out
    assert "2, of how 4 points differ" in shown
    assert "6 frames" in shown
    assert table.provenance["noise_unknown"] == "no position was taken twice"
    assert table.provenance["rejected"][-1] == "modes: the point at y 25, x 225 is measured at 4 positions only"


def without_places(captures):
    plain = captures.parent / "plain.csv"
    plain.write_text("".join(",".join(line.split(",")[:2]) + "\n" for line in captures.read_text().split("\n")[::5]))
    return plain


def test_modes_that_cannot_be_told_are_refused_in_a_sentence(captures, run, capsys, tmp_path):
    for file, words, sentence in (
        (captures, [*WORDS, "--modes", 5], "fewer than points, got 5 of 5"),
        (captures, [*WORDS, "--modes", 0], "modes are 1 or more"),
        (captures, ["--target", "edge", *WORDS[2:], "--modes", 2], "they want --target point, got edge"),
        (without_places(captures), [*WORDS, "--modes", 2], "give x and y in every row, 0.png has none"),
    ):
        assert run("calibrate", file, *words, "-o", tmp_path / "t.zarr.zip") == 2
        assert sentence in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
    with pytest.raises(PsflutError, match="got 2 of 0 points"):
        Singles(np.zeros((3, 2)), Point(), 2).tables(DISTANCES, "distance", [[None] * 3] * len(DISTANCES), PITCH)
