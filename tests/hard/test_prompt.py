"""Mistakes at a real prompt, in processes of their own: one sentence, exit 2, no traceback, nothing left behind."""

import subprocess
import sys

import numpy as np
import pytest

from psflut.writing import write_tiff

PROMPT = [sys.executable, "-c", "from psflut.cli import main; main()"]

MISTAKES = {  # words, and a word that the sentence must have
    "an unknown command": ("estimat shot.tif", "estimat"),
    "an unknown option": ("estimate shot.tif --tabel lab16mm", "--tabel"),
    "an unknown table": ("estimate shot.tif --table lab17mm", "lab17mm"),
    "an image for a table": ("info shot.tif", "shot.tif"),
    "a table for an image": ("estimate table.toml --table lab16mm", "table.toml"),
    "no such image": ("estimate shut.tif --table lab16mm", "shut.tif"),
    "a folder for an image": ("estimate . --table lab16mm", "image"),
    "a patch outside": ("estimate shot.tif --table lab16mm --patch 90,90,64", "90,90,64"),
    "a level of 2": ("estimate shot.tif --table lab16mm --level 2", "--level"),
    "negative noise": ("estimate shot.tif --table lab16mm --noise -1", "noise"),
    "an unknown method": ("estimate shot.tif --table lab16mm --method weiner", "weiner"),
    "a stride of 0": ("depthmap shot.tif --table lab16mm --stride 0 -o map.zarr", "stride"),
    "a map that is no map": ("depthmap shot.tif --table lab16mm -o map.docx", "map.docx"),
    "a recipe without units": ("build table.toml -o t.zarr", "unit"),
    "captures that are none": ("calibrate table.toml --target point --pixel-pitch 6um -o t.zarr", "table.toml"),
}


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    """A folder with a capture and a recipe that forgot a unit."""
    folder = tmp_path_factory.mktemp("desk")
    write_tiff(folder / "shot.tif", np.random.default_rng(0).random((96, 96)), {})
    (folder / "table.toml").write_text("[camera]\nfocal_length = 16\nf_number = 2\n")
    return folder


def run(words, folder):
    return subprocess.run([*PROMPT, *words.split()], cwd=folder, capture_output=True, text=True, timeout=120)


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_answered_by_a_sentence(mistake, desk):
    words, named = MISTAKES[mistake]
    before = sorted(path.name for path in desk.iterdir())
    found = run(words, desk)
    assert found.returncode == 2, found.stderr
    assert named in found.stderr
    assert "Traceback" not in found.stderr + found.stdout
    assert not found.stdout.strip()
    assert len(found.stderr.strip().splitlines()) <= 2
    assert sorted(path.name for path in desk.iterdir()) == before


def test_the_control_a_right_command_is_not_refused(desk):
    found = run("estimate shot.tif --table lab16mm --noise 0.005 --json", desk)
    assert found.returncode == 0
    assert found.stdout.startswith("{")
