"""What hostile tests share: a small table and its neighbours, and a command that must be refused."""

import contextlib
import re
import shutil
import sys
import warnings
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

from psflut import cli, store
from psflut.noise import Noise
from psflut.optics import Camera
from psflut.table import PSFTable
from psflut.writing import write_tiff

REMEDY = re.compile(r"[;:] (give|\w+ )|--help'|must|expected|needs| is a |such as|between|at least|ends in|belongs to")
"""A sentence says what to do, or what would have been right."""

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


@pytest.fixture(scope="session")
def small():
    """A table of 4 planes of 7 x 7 pixels with everything that a table may have."""
    rng = np.random.default_rng(7)
    psf = rng.random((4, 7, 7))
    psf /= psf.sum(axis=(1, 2), keepdims=True)
    return PSFTable(
        axis=np.array([1.0, 1.5, 2.0, 4.0]),
        psf=psf,
        pixel_pitch=5e-6,
        camera=Camera(0.016, 0.008, 0.0161, 5e-6),
        imager="laplacian:0.2",
        noise=Noise(0.01, 1000.0, 0.02),
        psf_std=0.01 * psf,
        axis_std=np.full(4, 1e-3),
        provenance={"settings": {"zernikes": [[4, 0, 0.2]]}},
        check={"median": 0.01},
    )


@pytest.fixture(scope="session")
def whole(tmp_path_factory, small):
    """A folder with whole inputs for every command."""
    folder, rng = tmp_path_factory.mktemp("whole"), np.random.default_rng(3)
    store.write_table(small, folder / "t.zarr")
    store.write_table(small, folder / "t.zarr.zip")
    for name in ("image.tif", "0.tif", "1.tif", "2.tif"):
        write_tiff(folder / name, 0.5 + 0.1 * rng.standard_normal((64, 64)), {})
    iio.imwrite(folder / "image.png", rng.integers(0, 250, (64, 64), dtype=np.uint8))
    (folder / "camera.toml").write_text(CAMERA)
    (folder / "recipe.toml").write_text(RECIPE)
    (folder / "captures.csv").write_text("file,distance_m\n0.tif,1.1\n1.tif,1.6\n2.tif,2.9\n")
    return folder


@pytest.fixture
def desk(tmp_path, whole, monkeypatch):
    """A copy of it, in which commands run: what a case then spoils."""
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def refused(desk, monkeypatch, capfd):
    """Run a command that must be refused in one sentence that ends with what to do: the sentence."""

    def run(*words):
        before = {path: path.is_file() and path.stat().st_size for path in desk.rglob("*")}
        monkeypatch.setattr(sys, "argv", ["psflut", *map(str, words)])
        capfd.readouterr()
        with pytest.raises(SystemExit) as ended, warnings.catch_warnings():
            cli.main()
        out, err = capfd.readouterr()
        lines = [line for line in err.splitlines() if "psflut: " in line]  # a bar of progress may stand before it
        assert (ended.value.code, out, len(lines)) == (2, "", 1), err
        assert err.rstrip().endswith(lines[0]), err
        assert "Traceback" not in err
        assert "mistake in psflut" not in err
        assert REMEDY.search(lines[0]), f"no remedy: {lines[0]}"
        assert {path: path.is_file() and path.stat().st_size for path in desk.rglob("*")} == before
        return lines[0]

    return run


@pytest.fixture
def little_memory():
    """A context in which this process gets at most 256 MB more address space; else MemoryError."""
    resource = pytest.importorskip("resource")
    if sys.platform != "linux":
        pytest.skip("reads the address space from /proc")

    @contextlib.contextmanager
    def limited():
        before = resource.getrlimit(resource.RLIMIT_AS)
        taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (taken + 256_000_000, before[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_AS, before)

    return limited
