"""The same seed gives the same bytes: tables, chains, results and figures, twice, by one worker or two."""

import os
import subprocess
import sys

import numpy as np
import pytest

from psflut import plots
from psflut.estimation import Observation, estimate
from psflut.gallery import TIMES
from psflut.posterior_file import write_posterior

CAMERA = '[camera]\nfocal_length = "16 mm"\nf_number = 2\nfocus_distance = "6 m"\npixel_pitch = "6 um"\n'
RECIPE = CAMERA + '[table]\nmodel = "pupil"\ndistances = { from = "0.8 m", to = "1.5 m", count = 5 }\nsize = 49\n'


def content(path):
    files = sorted(path.rglob("*")) if path.is_dir() else [path]
    return {str(file.relative_to(path)): file.read_bytes() for file in files if file.is_file()}


@pytest.mark.parametrize("ending", [".zarr", ".zarr.zip"])
@pytest.mark.parametrize("epoch", [None, "1700000000"])
def test_tables(run, tmp_path, monkeypatch, ending, epoch):
    monkeypatch.delenv("SOURCE_DATE_EPOCH", raising=False)
    if epoch:
        monkeypatch.setenv("SOURCE_DATE_EPOCH", epoch)
    (tmp_path / "recipe.toml").write_text(RECIPE)
    for name in "ab":
        assert run("build", tmp_path / "recipe.toml", "-o", tmp_path / f"{name}{ending}") == 0
    assert content(tmp_path / f"a{ending}") == content(tmp_path / f"b{ending}")


def test_tables_by_another_process_with_other_hashes(run, tmp_path):
    (tmp_path / "recipe.toml").write_text(RECIPE)
    assert run("build", tmp_path / "recipe.toml", "-o", tmp_path / "a.zarr.zip") == 0
    code = "import sys; sys.argv[1:] = ['build', 'recipe.toml', '-o', 'b.zarr.zip']; import psflut.cli as c; c.main()"
    other = {**os.environ, "PYTHONHASHSEED": "7", "TZ": "Asia/Tokyo", "LC_ALL": "C"}
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=other, check=True, capture_output=True)
    assert content(tmp_path / "a.zarr.zip") == content(tmp_path / "b.zarr.zip")


MAPPED = """import sys, numpy as np
from psflut.batch import estimate_all
from psflut.noise import Noise
from psflut.store import read_table
patches = np.lib.stride_tricks.sliding_window_view(np.load(sys.argv[1]), (64, 64))[::13, ::13].reshape(-1, 64, 64)
print(estimate_all(patches, read_table("lab16mm"), Noise(read=0.005)).interval.tobytes().hex())"""


@pytest.mark.campaign
def test_compiled_code_gives_in_its_first_run_what_it_gives_when_kept(lab_patch, tmp_path):
    np.save(tmp_path / "patch.npy", lab_patch)
    fresh = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kept")}
    words = [sys.executable, "-c", MAPPED, str(tmp_path / "patch.npy")]
    first, then = (subprocess.run(words, env=fresh, check=True, capture_output=True).stdout for _ in range(2))
    assert len(first) == 801  # 25 patches
    assert first == then


def test_chains_and_what_is_kept_of_them(lab16mm, lab_patch, tmp_path):
    pytest.importorskip("xarray")
    found = [estimate(Observation(lab_patch), lab16mm, "posterior:steps=60") for _ in range(2)]
    assert found[0].detail["chain"].tobytes() == found[1].detail["chain"].tobytes()
    for name, each in zip("ab", found, strict=True):
        write_posterior(each, tmp_path / f"{name}.zarr")
    assert content(tmp_path / "a.zarr") == content(tmp_path / "b.zarr")
    other = estimate(Observation(lab_patch), lab16mm, "posterior:steps=60:seed=1")
    assert other.detail["chain"].tobytes() != found[0].detail["chain"].tobytes()


@pytest.mark.campaign
def test_results_and_figures_by_one_worker_and_two(run, tmp_path):
    words = ["compare", "--table", "lab16mm", "--images", "camera", "--method", "wiener"]
    words += ["--distances", "2", "--runs", "2", "--size", "64"]
    for name, workers in (("a", 1), ("b", 1), ("c", 2)):
        assert run(*words, "--workers", workers, "-o", tmp_path / name) == 0
    for other in "bc":
        for part in ("results.csv", "results.zarr"):
            assert content(tmp_path / "a" / part) == content(tmp_path / other / part)
        figures = content(tmp_path / "a" / "figures")
        again = content(tmp_path / other / "figures")
        assert len(figures) > 8
        assert {name for name in figures if figures[name] != again.get(name)} <= {f"{TIMES}.png"}


def test_figures(small, tmp_path):
    for name in "ab":
        for ending in ("png", "pdf"):
            plots.save(plots.psfs(small), tmp_path / f"{name}.{ending}")
    for ending in ("png", "pdf"):
        assert content(tmp_path / f"a.{ending}") == content(tmp_path / f"b.{ending}")


def test_the_control_other_seeds_give_other_bytes(scene, lab16mm):
    from psflut.capture import Setup, simulate

    one, two = (simulate(scene, lab16mm, 1.3, Setup(noise="0.01"), seed)[0] for seed in (1, 2))
    assert not np.array_equal(one, two)
