"""Readers and builders of one file at once, and a disk that is full.

python -m pytest -m campaign tests/hard/test_many_at_once.py -s
"""

import os
import subprocess
import sys
import time

import numpy as np
import pytest
from children import CONTEXT, command, start

from psflut import store
from psflut.errors import PsflutError
from psflut.files import claimed

CAMERA = '[camera]\nfocal_length = "16 mm"\nf_number = 2\nfocus_distance = "6 m"\npixel_pitch = "6 um"\n'
RECIPE = CAMERA + '[table]\nmodel = "gaussian"\ndistances = { from = "0.8 m", to = "5 m", count = 12 }\nsize = 49\n'
OTHER = RECIPE.replace('"5 m"', '"4 m"').replace("count = 12", "count = 20")

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="locks are those of Unix")


@pytest.fixture
def two(tmp_path, run):
    """A folder with two recipes and the tables they make."""
    for name, text in (("one", RECIPE), ("two", OTHER)):
        (tmp_path / f"{name}.toml").write_text(text)
        assert run("build", tmp_path / f"{name}.toml", "-o", tmp_path / f"{name}.zarr.zip") == 0
    return tmp_path


def reader(folder, seconds, tell):
    known = {len(each.axis): each for each in (store.read_table(folder / f"{n}.zarr.zip") for n in ("one", "two"))}
    counts, until = {"reads": 0, "refused": 0, "wrong": 0}, time.time() + seconds
    while time.time() < until:
        counts["reads"] += 1
        try:
            found = store.read_table(folder / "t.zarr.zip")
            counts["wrong"] += not np.array_equal(found.psf, known[len(found.axis)].psf)
        except (PsflutError, KeyError):
            counts["refused"] += 1
    tell.put(counts)


def rebuilder(folder, name, seconds, tell):
    counts, said = {"builds": 0, "stopped": 0, "wrong": 0}, folder / f"said-{name}"
    os.chdir(folder)
    until = time.time() + seconds
    while time.time() < until:
        process = os.fork()
        if process == 0:
            command(["build", f"{name}.toml", "-o", "t.zarr.zip", "--overwrite"], folder, said)
        code = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
        told = "another process is writing" in said.read_text()
        counts["builds" if code == 0 else "stopped" if code == 2 and told else "wrong"] += 1
    tell.put(counts)


def together(folder, seconds):
    """Four readers and two builders of one table, for so long: their counts summed."""
    (folder / "t.zarr.zip").write_bytes((folder / "one.zarr.zip").read_bytes())
    tell, total = CONTEXT.Queue(), {}
    processes = [start(reader, folder, seconds, tell) for _ in range(4)]
    processes += [start(rebuilder, folder, name, seconds, tell) for name in ("one", "two")]
    for found in [tell.get(timeout=seconds + 120) for _ in processes]:
        total = {key: total.get(key, 0) + found.get(key, 0) for key in {*total, *found}}
    for process in processes:
        process.join()
    assert not [each.name for each in folder.iterdir() if each.name.startswith(".")]
    return total


def test_readers_and_builders_do_not_disturb_each_other(two):
    counts = together(two, 1.5)
    assert (counts["refused"], counts["wrong"]) == (0, 0)
    assert min(counts["reads"], counts["builds"]) > 0


@pytest.mark.campaign
def test_thirty_seconds_of_readers_and_builders(two):
    counts = together(two, 30)
    print(f"at once: {counts}")
    assert (counts["refused"], counts["wrong"]) == (0, 0)
    assert min(counts["reads"], counts["builds"], counts["stopped"]) > 0


def tearing(folder, seconds):
    """What a builder must not do: write the archive where it is read."""
    both, until = [(folder / f"{name}.zarr.zip").read_bytes() for name in ("one", "two")], time.time() + seconds
    while time.time() < until:
        for data in both:
            (folder / "t.zarr.zip").write_bytes(data)


def test_the_control_a_builder_that_writes_in_place_is_torn_or_refused(two):
    (two / "t.zarr.zip").write_bytes((two / "one.zarr.zip").read_bytes())
    tell = CONTEXT.Queue()
    processes = [start(reader, two, 2, tell), start(tearing, two, 2)]
    counts = tell.get(timeout=120)
    for process in processes:
        process.join()
    assert counts["refused"] + counts["wrong"] > 0


def test_of_two_builders_one_stops_with_a_sentence(two, run, capfd):
    (two / "t.zarr.zip").unlink(missing_ok=True)
    with claimed(two / ".t.zarr.zip.planes"):  # as another process that builds holds it: flock knows open files alone
        capfd.readouterr()
        assert run("build", two / "one.toml", "-o", two / "t.zarr.zip") == 2
        assert "another process is writing" in capfd.readouterr().err
        assert not (two / "t.zarr.zip").exists()
    assert run("build", two / "one.toml", "-o", two / "t.zarr.zip") == 0


@pytest.fixture
def disk(tmp_path):
    """A small disk: grow(kilobytes) gives its folder, empty."""
    mounted, folder = [], tmp_path / "disk"
    folder.mkdir()

    def unmount():
        while mounted:
            subprocess.run(["umount", mounted.pop()], check=True)

    def grow(kilobytes):
        unmount()
        done = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "psflut", folder], capture_output=True, check=False
        )
        if done.returncode:
            pytest.skip("mounting a small disk is not allowed here")
        mounted.append(folder)
        return folder

    yield grow
    unmount()


MOUNTS = pytest.mark.skipif(sys.platform != "linux" or os.geteuid() != 0, reason="mounts a small disk")


@MOUNTS
def test_a_full_disk_leaves_the_old_table_and_says_so(two, disk, run, capfd):
    assert 0 < fill(two, disk, run, capfd, ".zarr.zip", 5) < 5


@MOUNTS
@pytest.mark.campaign
@pytest.mark.parametrize("ending", [".zarr", ".zarr.zip"])
def test_twenty_full_disks(two, disk, run, capfd, ending):
    refused = fill(two, disk, run, capfd, ending, 20)
    print(f"disk full, {ending}: 20 sizes tried, {refused} refused")
    assert 5 < refused < 20


@MOUNTS
def test_the_control_a_builder_that_writes_in_place_loses_the_old_table(two, disk):
    folder = disk(64)
    table = folder / "t.zarr.zip"
    table.write_bytes((two / "one.zarr.zip").read_bytes())
    with pytest.raises(OSError, match="No space left"):
        table.write_bytes(bytes(100_000))
    with pytest.raises(PsflutError):
        store.read_table(table)


def fill(two, disk, run, capfd, ending, sizes):
    """Rebuild a table where so many sizes of room are left: how many were refused, the old table whole."""

    def build(recipe, folder, *more):
        capfd.readouterr()
        code = run("build", two / f"{recipe}.toml", "-o", folder / f"t{ending}", *more)
        return code, capfd.readouterr().err

    folder = disk(20_000)
    assert build("two", folder)[0] == 0
    whole = store.read_table(folder / f"t{ending}").psf
    refused = 0
    for room in np.geomspace(4, 2000, sizes).astype(int):  # kilobytes beside the old table
        folder = disk(20_000)
        assert build("one", folder)[0] == 0
        before = store.read_table(folder / f"t{ending}").psf
        taken = sum(each.stat().st_blocks // 2 for each in folder.rglob("*"))
        subprocess.run(["mount", "-o", f"remount,size={4 * ((taken + room) // 4)}k", folder], check=True)
        code, err = build("two", folder, "--overwrite")
        if code:
            refused += 1
            said = [line for line in err.splitlines() if line.startswith("psflut: ")]
            assert (code, len(said)) == (2, 1), err
            assert "No space left" in said[0]
            assert "make room" in said[0]
            np.testing.assert_array_equal(store.read_table(folder / f"t{ending}").psf, before)
            subprocess.run(["mount", "-o", "remount,size=20000k", folder], check=True)
            assert build("two", folder, "--overwrite")[0] == 0
        np.testing.assert_array_equal(store.read_table(folder / f"t{ending}").psf, whole)
        assert [each.name for each in folder.iterdir()] == [f"t{ending}"]
    return refused
