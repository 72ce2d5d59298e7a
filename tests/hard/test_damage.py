"""Damaged tables: flipped bits, cut and lost files are refused on opening, or carry no meaning and change nothing.

python -m pytest -m campaign tests/hard/test_damage.py -s
"""

import contextlib
import shutil
import warnings

import numpy as np
import pytest
import zarr
from zarr.storage import LocalStore

from psflut import layout, store
from psflut.errors import PsflutError


def same(one, other):
    """Whether two tables say the same."""
    first, second = layout.arrays_of(one), layout.arrays_of(other)
    arrays = first.keys() == second.keys() and all(np.array_equal(first[k], second[k]) for k in first)
    return arrays and layout.attributes_of(one) == layout.attributes_of(other)


def files_of(path):
    return sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]


def weighted(files, rng):
    """One of the files, by their sizes."""
    sizes = np.array([file.stat().st_size for file in files], dtype=float)
    return files[rng.choice(len(files), p=sizes / sizes.sum())]


def flip(path, rng):
    file = weighted(files_of(path), rng)
    raw = bytearray(file.read_bytes())
    raw[rng.integers(len(raw))] ^= 1 << int(rng.integers(8))
    file.write_bytes(raw)


def truncate(path, rng):
    file = weighted(files_of(path), rng)
    raw = file.read_bytes()
    file.write_bytes(raw[: rng.integers(len(raw))])


def lose(path, rng):
    """A chunk deleted or zeroed; of a zip, as long a stretch of it zeroed."""
    if path.is_dir():
        file = rng.choice([each for each in files_of(path) if each.name != "zarr.json"])
        file.unlink() if rng.random() < 0.5 else file.write_bytes(bytes(file.stat().st_size))
        return
    raw = bytearray(path.read_bytes())
    at = int(rng.integers(len(raw) - 200))
    raw[at : at + 200] = bytes(200)
    path.write_bytes(raw)


def tally(spoil, count, small, folder, rng):
    """How a table fares: tried, refused, read as it was, read wrong."""
    counts = {"tried": 0, "refused": 0, "identical": 0, "wrong": 0}
    for name in ("t.zarr", "t.zarr.zip"):
        store.write_table(small, folder / name)
        whole = store.read_table(folder / name)
        for _ in range(count // 2):
            path = folder / f"spoilt-{name}"
            shutil.copytree(folder / name, path) if path.suffix == ".zarr" else shutil.copy(folder / name, path)
            spoil(path, rng)
            counts["tried"] += 1
            try:
                counts["identical" if same(store.read_table(path), whole) else "wrong"] += 1
            except PsflutError:
                counts["refused"] += 1
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    return counts


@pytest.mark.parametrize(("spoil", "count"), [(flip, 20), (truncate, 8), (lose, 8)])
def test_damage_is_refused_or_means_nothing(spoil, count, small, tmp_path):
    assert tally(spoil, count, small, tmp_path, np.random.default_rng(11))["wrong"] == 0


@pytest.mark.campaign
@pytest.mark.parametrize(("spoil", "count"), [(flip, 300), (truncate, 100), (lose, 100)])
def test_much_damage(spoil, count, small, tmp_path):
    counts = tally(spoil, count, small, tmp_path, np.random.default_rng(12))
    print(f"{spoil.__name__}: {counts}")
    assert counts["wrong"] == 0
    assert counts["refused"] > 0.9 * counts["tried"]


def test_the_control_with_the_default_codec_most_flips_in_chunks_go_through(small, tmp_path):
    rng, wrong = np.random.default_rng(13), 0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        group = zarr.create_group(LocalStore(tmp_path / "t.zarr"), zarr_format=3)
        psf = small.psf.astype("f4")
        group.create_array("psf", data=psf, chunks=(1, 7, 7))
        for _ in range(40):
            file = rng.choice(sorted(p for p in (tmp_path / "t.zarr/psf/c").rglob("*") if p.is_file()))
            raw = file.read_bytes()
            spoilt = bytearray(raw)
            spoilt[rng.integers(len(raw))] ^= 1 << int(rng.integers(8))
            file.write_bytes(spoilt)
            with contextlib.suppress(Exception):  # what zstd itself complains of
                wrong += not np.array_equal(zarr.open_group(tmp_path / "t.zarr", mode="r")["psf"][:], psf)
            file.write_bytes(raw)
    assert wrong > 20
