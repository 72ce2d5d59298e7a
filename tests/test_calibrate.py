"""From a folder of synthetic frames to a table, by the command line; frames come from a finely sampled pupil."""

import csv
import json
from dataclasses import replace

import imageio.v3 as iio
import numpy as np
import pytest

from psflut import Noise, Observation, Setup, estimate, read_table, simulate
from psflut.optics import Camera
from psflut.psfs.pupil import Pupil

FINE, SIZE, SIDE = 5, 31, 120
DISTANCES = 1 / np.linspace(1 / 1.25, 1 / 2.4, 9)
READ, GAIN = 0.002, 20_000.0


def frame(camera, distance, places, rng):
    """Four bright points at random sub-pixel places, 12 bits, read and photon noise."""
    model = Pupil()(replace(camera, pixel_pitch=camera.pixel_pitch / FINE), distance, FINE * SIZE)
    canvas = np.full((SIDE * FINE, SIDE * FINE), 0.02 / FINE**2)
    for y in range(30, SIDE - 29, 60):
        for x in range(30, SIDE - 29, 60):
            top, left = (FINE * (c - SIZE // 2) + int(places.integers(-FINE, FINE + 1)) for c in (y, x))
            canvas[top : top + FINE * SIZE, left : left + FINE * SIZE] += 0.5 * model / peak(model)
    light = canvas.reshape(SIDE, FINE, SIDE, FINE).sum(axis=(1, 3))
    noisy = rng.poisson(light * GAIN) / GAIN + READ * rng.standard_normal(light.shape) + 0.02
    return np.round(np.clip(noisy, 0, 1) * 4095).astype(np.uint16) * 16


def peak(model):
    """Of the PSF binned to pixels."""
    return model.reshape(SIZE, FINE, SIZE, FINE).sum(axis=(1, 3)).max()


@pytest.fixture(scope="module")
def captures(tmp_path_factory, lab16mm):
    """A manifest of two frames at every distance."""
    folder, rng = tmp_path_factory.mktemp("captures"), np.random.default_rng(0)
    with (folder / "captures.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["file", "distance_m"])
        for k, distance in enumerate(DISTANCES):
            for shot in "ab":
                light = frame(lab16mm.camera, distance, np.random.default_rng(k), rng)
                iio.imwrite(folder / f"{k}{shot}.png", light)
                writer.writerow([f"{k}{shot}.png", repr(float(distance))])
    return folder / "captures.csv"


@pytest.fixture(scope="module")
def table(captures, run):
    output = captures.parent / "table.zarr.zip"
    words = ["--target", "point", "--pixel-pitch", "6 um", "--dark", "0.02"]
    assert run("calibrate", captures, *words, "-o", output) == 0
    return read_table(output)


def test_the_measured_psfs_are_those_of_the_lens(table, lab16mm):
    truth = np.stack([Pupil()(lab16mm.camera, float(z), SIZE) for z in table.axis])
    error = np.abs(table.psf - truth).sum(axis=(1, 2))
    assert error.mean() < 0.05
    np.testing.assert_allclose(table.axis, DISTANCES)
    assert table.psf_std.shape == table.psf.shape


def test_a_measured_table_reads_distance_like_the_true_one(table, lab16mm, scene):
    """Monochromatic truth: the same lens at one wavelength."""
    planes = np.stack([Pupil()(lab16mm.camera, float(z), SIZE) for z in table.axis])
    true = replace(table, psf=planes, psf_std=None)
    errors = {"measured": [], "true": []}
    for seed, distance in enumerate((1.33, 1.47, 1.71, 1.95, 2.2)):
        source = replace(true, provenance={"model": "pupil", "settings": {}}, camera=lab16mm.camera)
        image, _ = simulate(scene, source, distance, Setup(noise="0.005"), seed)
        for name, each in (("measured", table), ("true", true)):
            found = estimate(Observation(image[64:192, 64:192], Noise(0.005)), each, "wiener")
            errors[name].append(abs(found.distance - distance) / distance)
    assert np.mean(errors["measured"]) < 1.2 * np.mean(errors["true"]) + 0.002


def test_the_table_carries_its_held_out_error(table, capsys, run, captures):
    """Distances left out are read by the others to a few millimetres, and info says so."""
    assert len(table.check["errors_m"]) == len(DISTANCES) - 2
    assert table.check["position_error_m"] < 0.01
    assert run("info", captures.parent / "table.zarr.zip") == 0
    shown = capsys.readouterr().out
    assert "positions left out once" in shown
    assert "point" in shown


def test_the_noise_of_the_camera_comes_with_the_table(table):
    assert table.noise.gain == pytest.approx(GAIN, rel=0.1)
    assert table.noise.offset == pytest.approx(0.02)


def test_a_frame_without_a_target_is_named_and_nothing_is_left(captures, run, capsys, tmp_path):
    for file in captures.parent.glob("*.png"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    manifest = tmp_path / "captures.csv"
    manifest.write_text(captures.read_text())
    blank = np.full((SIDE, SIDE), 5000, np.uint16) + np.random.default_rng(0).integers(0, 30, (SIDE, SIDE), np.uint16)
    for shot in "ab":
        iio.imwrite(tmp_path / f"3{shot}.png", blank)
    before = sorted(tmp_path.iterdir())
    words = ["calibrate", manifest, "--target", "point", "--pixel-pitch", "6 um", "-o", tmp_path / "t.zarr.zip"]
    assert run(*words) == 2
    message = capsys.readouterr().err.strip().splitlines()[-1]
    assert "3a.png" in message
    assert sorted(tmp_path.iterdir()) == before


def test_the_table_holds_for_new_frames_but_not_for_another_focus(captures, table, run, capsys, lab16mm):
    moved = Camera.of(16e-3, 6e-6, f_number=2, focus_distance=4.5)
    rng, folder = np.random.default_rng(9), captures.parent / "again"
    folder.mkdir()
    answers = {}
    for name, camera in (("same", lab16mm.camera), ("moved", moved)):
        lines = ["file,distance_m"]
        for z in (1.4, 1.6, 1.9):
            iio.imwrite(folder / f"{name}-{z}.png", frame(camera, z, np.random.default_rng(int(100 * z)), rng))
            lines.append(f"{name}-{z}.png,{z}")
        (folder / f"{name}.csv").write_text("\n".join(lines))
        words = ["check", captures.parent / "table.zarr.zip", folder / f"{name}.csv", "--dark", "0.02", "--json"]
        assert run(*words) == 0
        answers[name] = json.loads(capsys.readouterr().out)
    assert answers["same"]["verdict"] == "holds"
    assert answers["moved"]["verdict"] == "drifted"
    assert answers["moved"]["shift_dioptre"] == pytest.approx(1 / 6 - 1 / 4.5, rel=0.1)


def test_what_cannot_be_a_calibration_is_refused_before_any_frame_is_read(captures, run, capsys, tmp_path):
    words = ["--target", "point", "--pixel-pitch", "6 um", "-o", tmp_path / "t.zarr.zip"]
    for more, sentence in (
        (["--planes", "50"], "--model pupil"),
        (["--model", "ray"], "the model that can be fitted is pupil"),
        (["--placement", "3"], "a length is a number with a unit"),
        (["--size", "30"], "must be odd"),
    ):
        assert run("calibrate", captures, *words, *more) == 2
        assert sentence in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
