"""kill -9 at any moment: what is at the final path is whole, and the next run finishes what was begun.

python -m pytest -m campaign tests/hard/test_kills.py -s
"""

import csv
import shutil
import sys
import time

import numpy as np
import pytest
import tifffile
import zarr
from children import command, duration, killed_after, start

from calib.targets.point import Point
from psflut import capture, cli, gallery, mapping, store
from psflut.demo import photograph
from psflut.psfs.pupil import Pupil

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs kill -9")

CAMERA = '[camera]\nfocal_length = "16 mm"\nf_number = 2\nfocus_distance = "6 m"\npixel_pitch = "6 um"\n'
RECIPE = CAMERA + '[table]\nmodel = "pupil"\ndistances = { from = "0.8 m", to = "5 m", count = 12 }\nsize = 49\n'


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """A recipe, another one, and captures of nine points at five positions."""
    folder, rng = tmp_path_factory.mktemp("bench"), np.random.default_rng(1)
    (folder / "recipe.toml").write_text(RECIPE)
    (folder / "older.toml").write_text(RECIPE.replace("count = 12", "count = 4"))
    y, x = np.mgrid[:150, :150]
    with (folder / "captures.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["file", "distance_m"])
        for k in range(5):
            image = 0.001 * rng.standard_normal(y.shape)
            for row, column in np.ndindex(3, 3):
                at = 25 + 50 * np.array([row, column]) + rng.uniform(-0.5, 0.5, 2)
                image += 0.5 * np.exp(-0.5 * ((y - at[0]) ** 2 + (x - at[1]) ** 2) / (1.2 + 0.2 * k) ** 2)
            tifffile.imwrite(folder / f"{k}.tif", image.astype(np.float32))
            rows.writerow([f"{k}.tif", 1 / (0.9 - 0.05 * k)])
    return folder


BUILD, MEASURE = ["build", "recipe.toml"], ["calibrate", "captures.csv"]
MEASURE += ["--target", "point:oversampling=1:rounds=1", "--pixel-pitch", "6 um", "--size", "15"]
RUNS = {
    "build to a zip": ([*BUILD, "-o", "t.zarr.zip"], False),
    "build to a folder": ([*BUILD, "-o", "t.zarr"], False),
    "rebuild a zip": ([*BUILD, "--overwrite", "-o", "t.zarr.zip"], True),
    "rebuild a folder": ([*BUILD, "--overwrite", "-o", "t.zarr"], True),
    "calibrate to a zip": ([*MEASURE, "-o", "t.zarr.zip"], False),
    "recalibrate a folder": ([*MEASURE, "--overwrite", "-o", "t.zarr"], True),
}


def content(path):
    """Every byte of a file or folder."""
    files = sorted(path.rglob("*")) if path.is_dir() else [path]
    return {str(file.relative_to(path)): file.read_bytes() for file in files if file.is_file()}


def here(words, monkeypatch, folder):
    """Run a command in this process: its exit code, and how many planes it worked out."""
    made = []
    plane, measure = Pupil.plane, Point.measure
    with monkeypatch.context() as patch:
        patch.setattr(Pupil, "plane", lambda *w: (made.append(1), plane(*w))[1])
        patch.setattr(Point, "measure", lambda *w: (made.append(1), measure(*w))[1])
        patch.setattr(gallery, "draw", lambda *_: None)
        patch.setattr(sys, "argv", ["psflut", *map(str, words)])
        patch.chdir(folder)
        with pytest.raises(SystemExit) as ended:
            cli.main()
    return ended.value.code, len(made)


def moments(seconds, count, rng):
    """Random moments of a run that takes so long, a quarter of them near its end."""
    near = rng.random(count) < 0.25
    return np.where(near, rng.uniform(0.85 * seconds, 1.02 * seconds, count), rng.uniform(0, seconds, count))


def campaign(name, count, bench, folder, monkeypatch, rng):
    """Kill a run again and again: what was seen, in numbers."""
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    words, replaces = RUNS[name]
    path = folder / words[-1]
    shutil.copytree(bench, folder, dirs_exist_ok=True)
    assert here(["build", "older.toml", *words[-2:]], monkeypatch, folder)[0] == 0
    old = content(path)
    cli_words = words if replaces else [*words, "--overwrite"]
    code, planes = here(cli_words, monkeypatch, folder)
    assert code == 0
    whole = content(path)
    inputs = sorted(each.name for each in bench.iterdir())
    counts = dict.fromkeys(("tried", "killed", "old", "new", "none", "wrong", "planes kept"), 0)

    def fresh():
        for each in folder.iterdir():
            if each.name not in inputs:
                shutil.rmtree(each) if each.is_dir() else each.unlink()
        if replaces:
            assert here(["build", "older.toml", *words[-2:]], monkeypatch, folder)[0] == 0

    def clean_run():
        fresh()
        return duration(command, words, folder, folder / "log")

    seconds = min(clean_run() for _ in range(1 + (count > 1)))
    for moment in moments(seconds, count, rng):
        fresh()
        counts["tried"] += 1
        counts["killed"] += killed_after(moment, command, words, folder, folder / "log")
        if path.exists():
            store.read_table(path)  # which checks every sum
            state = content(path)
            counts["new" if state == whole else "old" if state == old and replaces else "wrong"] += 1
        else:
            counts["none"] += 1
            assert not replaces  # the old table was there all the time
        kept = len(list(folder.glob(".*.planes/*.npz")))
        counts["planes kept"] += kept
        again = not path.exists() or content(path) != whole
        if again or replaces:
            code, made = here(words, monkeypatch, folder)
            assert (code, made) == (0, planes - kept)  # finished ones are not worked out again
            assert {each.name for each in folder.iterdir()} - {"log"} == {*inputs, path.name}  # nothing is left behind
        counts["wrong"] += content(path) != whole
    return counts


@pytest.mark.parametrize("name", ["rebuild a folder", "calibrate to a zip"])
def test_killed_runs_leave_nothing_wrong_and_go_on(name, bench, tmp_path, monkeypatch):
    counts = campaign(name, 1, bench, tmp_path, monkeypatch, np.random.default_rng(3))
    assert counts["wrong"] == 0


@pytest.mark.campaign
def test_two_hundred_kills(bench, tmp_path, monkeypatch):
    total = dict.fromkeys(("tried", "killed", "old", "new", "none", "wrong", "planes kept"), 0)
    for k, name in enumerate(RUNS):
        found = campaign(name, 34, bench, tmp_path / str(k), monkeypatch, np.random.default_rng(k))
        print(f"{name}: {found}")
        total = {key: total[key] + found[key] for key in total}
    print(f"kills: {total}")
    assert total["tried"] >= 200
    assert total["killed"] > 150
    assert total["wrong"] == 0


def in_place(folder):
    """What a builder must not do: planes one by one at the final path, attributes first."""
    table = store.read_table(folder / "whole.zarr.zip")
    group = zarr.create_group(folder / "t.zarr", zarr_format=3, attributes={"format": "psflut-table", "version": 1})
    array = group.create_array("psf", shape=table.psf.shape, dtype="f4", chunks=(1, 49, 49), fill_value=np.nan)
    for k, plane in enumerate(table.psf):
        array[k] = plane


def test_the_control_a_builder_that_writes_in_place_leaves_tables_that_open_and_lack_planes(
    bench, tmp_path, monkeypatch
):
    assert here(["build", bench / "recipe.toml", "-o", "whole.zarr.zip"], monkeypatch, tmp_path)[0] == 0
    process = start(in_place, tmp_path)
    while process.is_alive() and len(list(tmp_path.glob("t.zarr/psf/c/*"))) < 5:
        time.sleep(0.001)
    process.kill()
    process.join()
    seen = zarr.open_group(tmp_path / "t.zarr", mode="r")["psf"][:]  # opens and is wrong, without a word
    assert 0 < np.isnan(seen).all(axis=(1, 2)).sum() < len(seen)


COMPARE = ["compare", "--table", "lab16mm", "--images", "camera", "--method", "wiener", "--distances", "3"]
COMPARE += ["--runs", "6", "--size", "64", "-o", "out", "--workers"]


@pytest.mark.campaign
def test_fifty_kills_of_compare(tmp_path, monkeypatch):
    whole, rng = tmp_path / "whole", np.random.default_rng(9)
    whole.mkdir()
    assert here([*COMPARE, 1], monkeypatch, whole)[0] == 0
    expected = content(whole / "out" / "results.csv")
    counts = {"tried": 0, "killed": 0, "cells kept": 0, "wrong": 0}
    for workers, count in ((1, 40), (2, 10)):
        seconds = duration(command, [*COMPARE, workers], _folder(tmp_path), tmp_path / "log")
        for moment in moments(seconds, count, rng):
            folder = _folder(tmp_path)
            counts["tried"] += 1
            counts["killed"] += killed_after(moment, command, [*COMPARE, workers], folder, tmp_path / "log")
            journal = folder / "out" / "journal.jsonl"
            kept = journal.read_bytes() if journal.exists() else b""
            kept = kept[: kept.rfind(b"\n") + 1]
            counts["cells kept"] += max(kept.count(b"\n") - 1, 0)
            results = folder / "out" / "results.csv"
            counts["wrong"] += results.exists() and content(results) != expected
            assert here([*COMPARE, 1], monkeypatch, folder)[0] == 0
            begins = journal.read_bytes().startswith(kept) and journal.read_bytes().count(b"\n") == 19
            counts["wrong"] += content(results) != expected or not begins
            assert not list((folder / "out").glob(".*"))
    print(f"compare: {counts}")
    assert counts["tried"] == 50
    assert counts["wrong"] == 0


MAP = ["depthmap", "../large.tif", "--table", "lab16mm", "--noise", "0.005", "-o", "map.zarr", "--stride"]


def kills_of_maps(side, stride, counts_of_workers, folder, monkeypatch):
    """Kill a map of a capture of so many photographs a side, and go on: what was seen, in numbers."""
    rng, setup = np.random.default_rng(10), capture.Setup(noise="0.005")
    shot = capture.simulate(photograph(), store.read_table("lab16mm"), 1.4, setup, 1)[0]
    large = np.tile(shot, (side, side))
    tifffile.imwrite(folder / "large.tif", large.astype(np.float32))
    words, whole = [*MAP, stride, "--workers"], folder / "whole"
    whole.mkdir()
    code, pieces = mapped([*words, 1], monkeypatch, whole)
    assert code == 0
    expected = content(whole / "map.zarr")
    counts = {"tried": 0, "killed": 0, "pieces kept": 0, "wrong": 0}
    for workers, count in counts_of_workers:
        seconds = duration(command, [*words, workers], _folder(folder), folder / "log")
        for moment in moments(seconds, count, rng):
            run = _folder(folder)
            counts["tried"] += 1
            counts["killed"] += killed_after(moment, command, [*words, workers], run, folder / "log")
            kept = len(list(run.glob(".*/*-*-*.npz")))
            counts["pieces kept"] += kept
            if (run / "map.zarr").exists():
                counts["wrong"] += content(run / "map.zarr") != expected
                shutil.rmtree(run / "map.zarr")  # a kill after the map, before the pieces go
            code, worked = mapped([*words, 1], monkeypatch, run)
            assert (code, worked) == (0, pieces - kept)  # finished ones are not worked out again
            counts["wrong"] += content(run / "map.zarr") != expected
            assert [each.name for each in run.iterdir()] == ["map.zarr"]  # nothing is left behind
    return counts


def mapped(words, monkeypatch, folder):
    """Run it in this process: its exit code, and how many pieces it worked out."""
    made, solve = [], mapping.solve
    with monkeypatch.context() as patch:
        patch.setattr(mapping, "solve", lambda *w: (made.append(1), solve(*w))[1])
        return here(words, monkeypatch, folder)[0], len(made)


def test_killed_maps_leave_nothing_wrong_and_go_on(tmp_path, monkeypatch):
    assert kills_of_maps(1, 6, [(1, 1)], tmp_path, monkeypatch)["wrong"] == 0


@pytest.mark.campaign
def test_fifty_kills_of_a_large_map(tmp_path, monkeypatch):
    counts = kills_of_maps(3, 10, [(1, 40), (2, 10)], tmp_path, monkeypatch)
    print(f"depthmap: {counts}")
    assert counts["tried"] == 50
    assert counts["killed"] > 35
    assert counts["wrong"] == 0


def _folder(parent):
    """An empty folder of its own."""
    folder = parent / "run"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    return folder
