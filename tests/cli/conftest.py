"""Fixtures that run the command line as a user would."""

import json
import sys

import imageio.v3 as iio
import numpy as np
import pytest

from psflut import cli
from psflut.capture import Setup
from psflut.writing import write_tiff

CAMERA = """
[camera]
focal_length = "16 mm"
f_number = 2
focus_distance = "6 m"
pixel_pitch = "6 um"
"""
RECIPE = (
    CAMERA
    + """
[table]
model = "gaussian"
distances = { from = "1 m", to = "3 m", count = 4 }
size = 41
"""
)


@pytest.fixture
def psflut(monkeypatch, capfd, tmp_path):
    """Run a command in an empty folder: (exit code, stdout, stderr)."""
    monkeypatch.chdir(tmp_path)

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["psflut", *map(str, words)])
        capfd.readouterr()
        with pytest.raises(SystemExit) as ended:
            cli.main()
        return (ended.value.code, *capfd.readouterr())

    return run


@pytest.fixture
def estimates(psflut):
    """Run ``estimate --json``: its objects."""

    def run(*words):
        code, out, err = psflut("estimate", *words, "--json")
        assert code == 0, err
        return [json.loads(line) for line in out.splitlines()]

    return run


@pytest.fixture
def refused(psflut, tmp_path):
    """Run a command that must be refused, in one sentence and without a trace: the sentence."""

    def run(*words):
        before = sorted(tmp_path.rglob("*"))
        code, out, err = psflut(*words)
        assert (code, out) == (2, ""), err
        assert err.startswith("psflut: ")
        assert err.count("\n") == 1
        assert "Traceback" not in err
        assert sorted(tmp_path.rglob("*")) == before
        return err

    return run


@pytest.fixture(scope="module")
def shelf(tmp_path_factory, scene, lab16mm):
    """A folder with a scene, a capture of it at 1.63 m, a camera and a recipe."""
    from psflut.capture import simulate

    folder = tmp_path_factory.mktemp("shelf")
    iio.imwrite(folder / "scene.png", np.round(scene / scene.max() * 65535).astype(np.uint16))
    write_tiff(folder / "capture.tif", simulate(scene, lab16mm, 1.63, Setup(noise="0.003"), seed=1)[0], {})
    (folder / "camera.toml").write_text(CAMERA)
    (folder / "recipe.toml").write_text(RECIPE)
    return folder
