"""The format on disk: round trips, what others see of it, what is refused."""

import json
import shutil
import zipfile

import numpy as np
import pytest
import xarray

from psflut import store
from psflut.errors import PsflutError
from psflut.noise import Noise
from psflut.optics import Camera
from psflut.table import PSFTable


@pytest.fixture
def table(rng):
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


@pytest.mark.parametrize("name", ["t.zarr", "t.zarr.zip"])
def test_write_and_read_are_inverse(table, tmp_path, name):
    store.write_table(table, tmp_path / name)
    back = store.read_table(tmp_path / name)
    np.testing.assert_allclose(back.psf, table.psf, atol=1e-7)
    np.testing.assert_allclose(back.psf_std, table.psf_std, atol=1e-8)
    np.testing.assert_array_equal(back.axis, table.axis)
    np.testing.assert_array_equal(back.axis_std, table.axis_std)
    assert back.pixel_pitch == pytest.approx(table.pixel_pitch)
    for name in ("kind", "camera", "imager", "noise", "check"):
        assert getattr(back, name) == getattr(table, name)
    assert back.provenance["settings"] == table.provenance["settings"]
    assert [p.name for p in tmp_path.iterdir()] in (["t.zarr"], ["t.zarr.zip"])  # nothing is left beside it


def test_xarray_sees_named_dimensions_and_units(table, tmp_path):
    store.write_table(table, tmp_path / "t.zarr")
    seen = xarray.open_zarr(tmp_path / "t.zarr", consolidated=False)
    assert seen.psf.dims == ("distance", "y", "x")
    assert seen.psf.dtype == np.float32
    assert (seen.distance.units, seen.x.units, seen.psf.units) == ("m", "m", "1")
    assert seen.distance.long_name == "object distance"
    assert float(seen.psf.sel(distance=2.0).sum()) == pytest.approx(1.0, abs=1e-6)
    assert float(seen.x[-1]) == pytest.approx(3 * 5e-6)
    assert seen.attrs["format"] == "psflut-table"


def test_the_same_table_gives_the_same_bytes(table, tmp_path):
    for name in ("a.zarr.zip", "b.zarr.zip"):
        store.write_table(table, tmp_path / name)
    assert (tmp_path / "a.zarr.zip").read_bytes() == (tmp_path / "b.zarr.zip").read_bytes()
    with zipfile.ZipFile(tmp_path / "a.zarr.zip") as archive:
        assert {entry.compress_type for entry in archive.infolist()} == {zipfile.ZIP_STORED}


@pytest.mark.parametrize("name", ["t.zarr", "t.zarr.zip"])
def test_an_existing_table_is_replaced_only_on_request(table, tmp_path, name):
    store.write_table(table, tmp_path / name)
    with pytest.raises(PsflutError, match="--overwrite"):
        store.write_table(table, tmp_path / name)
    store.write_table(table, tmp_path / name, overwrite=True)
    store.read_table(tmp_path / name)
    assert len(list(tmp_path.iterdir())) == 1


def test_a_failed_write_leaves_the_old_table(table, tmp_path, monkeypatch):
    path = tmp_path / "t.zarr.zip"
    store.write_table(table, path)
    before = path.read_bytes()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(store, "pack", full)
    with pytest.raises(PsflutError, match="No space left"):
        store.write_table(table, path, overwrite=True)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["t.zarr.zip"]


def edit(path, change):
    meta = json.loads((path / "zarr.json").read_text())
    change(meta["attributes"])
    (path / "zarr.json").write_text(json.dumps(meta))


def flip(path):
    raw = bytearray(path.read_bytes())
    raw[len(raw) // 2] ^= 4
    path.write_bytes(raw)


DAMAGE = {
    "a missing plane": lambda p: (p / "psf/c/1/0/0").unlink(),
    "a flipped bit": lambda p: (f := p / "psf/c/1/0/0").write_bytes(
        bytes([f.read_bytes()[0] ^ 1]) + f.read_bytes()[1:]
    ),
    "planes exchanged": lambda p: shutil.copy(p / "psf/c/1/0/0", p / "psf/c/2/0/0"),
    "a missing array": lambda p: shutil.rmtree(p / "distance"),
    "an array too many": lambda p: shutil.copytree(p / "x", p / "channel"),
    "no metadata": lambda p: (p / "zarr.json").unlink(),
    "empty metadata": lambda p: (p / "zarr.json").write_text(""),
    "an edited attribute": lambda p: edit(p, lambda a: a.update(imager="plain")),
    "another version": lambda p: edit(p, lambda a: a.update(version=2)),
    "another format": lambda p: edit(p, lambda a: a.pop("format")),
    "not complete": lambda p: edit(p, lambda a: a.pop("complete")),
    "no checksums": lambda p: edit(p, lambda a: a.pop("sha256")),
    "renamed dimensions": lambda p: (f := p / "psf/zarr.json").write_text(f.read_text().replace('"y"', '"z"')),
    "an empty folder": lambda p: (shutil.rmtree(p), p.mkdir()),
    "a plain file": lambda p: (shutil.rmtree(p), p.write_text("psf")),
    "nothing": shutil.rmtree,
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_what_is_not_a_whole_table_is_refused_in_one_sentence(table, tmp_path, damage):
    path = tmp_path / "t.zarr"
    store.write_table(table, path)
    DAMAGE[damage](path)
    with pytest.raises(PsflutError) as refused:
        store.read_table(path)
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_truncated_zip_is_refused(table, tmp_path):
    path = tmp_path / "t.zarr.zip"
    store.write_table(table, path)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(PsflutError, match="not a readable table"):
        store.read_table(path)


def test_shipped_tables_are_small_whole_and_found_by_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("lab16mm", "thesis", "thesis-fir"):
        path = store.find_table(name)
        assert path.stat().st_size < 1_000_000
        assert store.read_table(path).camera is not None
    with pytest.raises(PsflutError, match="lab16mm"):
        store.find_table("lab17mm")


def test_a_table_needs_its_ending(table, tmp_path):
    with pytest.raises(PsflutError, match=r"\.zarr"):
        store.write_table(table, tmp_path / "table.h5")
