"""Broken tables: each refused by every command and by `read_table` in a sentence that names it."""

import dataclasses
import json
import os
import shutil
import zipfile

import numpy as np
import pytest

from psflut import layout, store
from psflut.errors import PsflutError


def meta(change, array=""):
    """Change the zarr.json of the group or of an array."""

    def spoil(path):
        file = path / array / "zarr.json"
        found = json.loads(file.read_text())
        change(found)
        file.write_text(json.dumps(found))

    return spoil


def put(name, data):
    """Replace a file, which may be absent, by these bytes."""

    def spoil(path):
        (path / name).parent.mkdir(parents=True, exist_ok=True)
        (path / name).write_bytes(data)

    return spoil


def attributes(**changes):
    """Change attributes and mend the checksum: as a wrong program would write it."""

    def spoil(path):
        def change(found):
            attrs = found["attributes"]
            attrs.update(changes)
            rest = {k: v for k, v in attrs.items() if k not in ("sha256", "complete")}
            attrs["sha256"]["attributes"] = layout.sums({}, rest)["attributes"]

        meta(change)(path)

    return spoil


def arrays(**changes):
    """Write the table with other arrays, of right checksums: each value is a function of the whole ones."""

    def spoil(path):
        table = store.read_table(path)
        whole = layout.arrays_of(table)
        spoilt = {name: np.asarray(change(whole[name].copy())) for name, change in changes.items()}
        shutil.rmtree(path)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(layout, "arrays_of", lambda _: whole | spoilt)
            store._write_group(table, path)

    return spoil


def at(index, value):
    def change(array):
        array[index] = value
        return array

    return change


def truncate(name, keep):
    return lambda path: (path / name).write_bytes((path / name).read_bytes()[:keep])


def remove(name):
    return lambda path: shutil.rmtree(path / name) if (path / name).is_dir() else (path / name).unlink()


def link(name, to):
    def spoil(path):
        remove(name)(path)
        (path / name).symlink_to(to)

    return spoil


def moved_and_linked(path):
    """The chunk itself, whole, but outside the table: it may change at any time."""
    shutil.move(path / "psf/c/0/0/0", path.parent / "elsewhere")
    (path / "psf/c/0/0/0").symlink_to(path.parent / "elsewhere")


def fifo(path):
    (path / "psf/c/0/0/0").unlink()
    os.mkfifo(path / "psf/c/0/0/0")


def become(make):
    return lambda path: (shutil.rmtree(path), make(path))


def rows(array):
    return array[:, :5]


def zarr_array(path):
    import zarr

    shutil.rmtree(path)
    zarr.create_array(path, shape=(3,), dtype="f4")


CODEC = [{"name": "bytes", "configuration": {"endian": "little"}}, {"name": "magic", "configuration": {}}]
CAMERA = {"focal_length": 0.016, "aperture_diameter": 0.008, "detector_distance": 0.0161, "pixel_pitch": 5e-6}
HUGE = [100_000, 100_000, 100_000]
FOLDERS = {
    "nothing": shutil.rmtree,
    "an empty folder": become(lambda p: p.mkdir()),
    "a plain file": become(lambda p: p.write_text("psf")),
    "an empty file": become(lambda p: p.write_text("")),
    "a link in a circle": become(lambda p: p.symlink_to(p)),
    "a pipe": become(os.mkfifo),
    "a chunk that is a pipe": fifo,
    "a chunk that is a link out": moved_and_linked,
    "an array that is a link in a circle": link("psf", "psf"),
    "an array instead of a group": zarr_array,
    "no metadata": remove("zarr.json"),
    "empty metadata": put("zarr.json", b""),
    "half metadata": truncate("zarr.json", 100),
    "metadata in binary": put("zarr.json", bytes(range(256))),
    "metadata null": put("zarr.json", b"null"),
    "metadata a list": put("zarr.json", b"[]"),
    "metadata a number": put("zarr.json", b"3"),
    "metadata too deep": put("zarr.json", b"[" * 200_000),
    "metadata with a huge number": put("zarr.json", b'{"zarr_format": ' + b"9" * 5000 + b"}"),
    "Zarr 2": meta(lambda m: m.update(zarr_format=2)),
    "no attributes": meta(lambda m: m.pop("attributes")),
    "attributes a list": meta(lambda m: m.update(attributes=[1])),
    "another format": attributes(format="images"),
    "version 2": attributes(version=2),
    "version text": attributes(version="1"),
    "version true": attributes(version=True),
    "no version": meta(lambda m: m["attributes"].pop("version")),
    "complete is text": attributes(complete="yes"),
    "not complete": meta(lambda m: m["attributes"].pop("complete")),
    "no checksums": meta(lambda m: m["attributes"].pop("sha256")),
    "checksums a list": meta(lambda m: m["attributes"].update(sha256=[])),
    "a checksum too few": meta(lambda m: m["attributes"]["sha256"].pop("psf_std")),
    "an attribute edited": meta(lambda m: m["attributes"].update(imager="plain")),
    "an attribute too many": meta(lambda m: m["attributes"].update(colour="red")),
    "axis unknown": attributes(axis="time"),
    "axis null": attributes(axis=None),
    "axis a list": attributes(axis=[]),
    "camera text": attributes(camera="Nikon"),
    "camera without a key": attributes(camera={"focal_length": 0.016}),
    "camera with a key too many": attributes(camera=dict.fromkeys("abc", 1)),
    "camera negative": attributes(camera=CAMERA | {"focal_length": -1.0}),
    "camera of text": attributes(camera=CAMERA | {"focal_length": "16 mm"}),
    "camera without pixels": attributes(camera=CAMERA | {"pixel_pitch": 0.0}),
    "imager unknown": attributes(imager="retina"),
    "imager a number": attributes(imager=5),
    "imager a list": attributes(imager=["plain"]),
    "imager null": attributes(imager=None),
    "noise negative": attributes(noise={"read": -1.0}),
    "noise text": attributes(noise={"read": "low"}),
    "noise a list": attributes(noise=[0.1]),
    "noise a number": attributes(noise=0.1),
    "provenance null": attributes(provenance=None),
    "provenance a list": attributes(provenance=[1, 2]),
    "check a list": attributes(check=[1]),
    "check text": attributes(check="good"),
    "no psf": remove("psf"),
    "no distance": remove("distance"),
    "no y": remove("y"),
    "no x": remove("x"),
    "an array too many": lambda p: shutil.copytree(p / "x", p / "channel"),
    "a group too many": lambda p: shutil.copytree(p, p.parent / "u") and shutil.move(p.parent / "u", p / "more"),
    "an array is a group": meta(lambda m: m.update(node_type="group"), "psf"),
    "array metadata empty": put("psf/zarr.json", b""),
    "array metadata a list": put("psf/zarr.json", b"[1]"),
    "array metadata too deep": put("psf/zarr.json", b'{"a":' * 50_000),
    "renamed dimension": meta(lambda m: m.update(dimension_names=["distance", "row", "column"]), "psf"),
    "no dimension names": meta(lambda m: m.pop("dimension_names"), "psf"),
    "one dimension name too few": meta(lambda m: m.update(dimension_names=["y", "x"]), "psf"),
    "an extra dimension": arrays(psf=lambda a: a) and meta(lambda m: m.update(shape=[4, 7, 7, 3]), "psf"),
    "shape null": meta(lambda m: m.update(shape=None), "psf"),
    "shape negative": meta(lambda m: m.update(shape=[-4, 7, 7]), "psf"),
    "shape of text": meta(lambda m: m.update(shape=["4", 7, 7]), "psf"),
    "shape of fractions": meta(lambda m: m.update(shape=[4.5, 7, 7]), "psf"),
    "shape zero": meta(lambda m: m.update(shape=[0, 7, 7]), "psf"),
    "shape huge": meta(lambda m: m.update(shape=HUGE), "psf"),
    "shape huge, chunks too": meta(
        lambda m: m.update(shape=HUGE, chunk_grid={"name": "regular", "configuration": {"chunk_shape": HUGE}}), "psf"
    ),
    "chunks huge": meta(lambda m: m["chunk_grid"]["configuration"].update(chunk_shape=HUGE), "psf"),
    "chunks of zero": meta(lambda m: m["chunk_grid"]["configuration"].update(chunk_shape=[0, 7, 7]), "psf"),
    "chunks unknown": meta(lambda m: m["chunk_grid"].update(name="spiral"), "psf"),
    "type unknown": meta(lambda m: m.update(data_type="quaternion"), "psf"),
    "type of text": meta(lambda m: m.update(data_type="string"), "distance"),
    "type narrower": meta(lambda m: m.update(data_type="float32"), "distance"),
    "type whole numbers": meta(lambda m: m.update(data_type="int32", fill_value=0), "psf"),
    "codec unknown": meta(lambda m: m.update(codecs=CODEC), "psf"),
    "no codecs": meta(lambda m: m.update(codecs=[]), "psf"),
    "codecs text": meta(lambda m: m.update(codecs="zstd"), "psf"),
    "fill value text": meta(lambda m: m.update(fill_value="lots"), "psf"),
    "a plane missing": remove("psf/c/1/0/0"),
    "all planes missing": remove("psf/c"),
    "positions missing": remove("distance/c"),
    "a plane empty": put("psf/c/1/0/0", b""),
    "a plane of nonsense": put("psf/c/1/0/0", bytes(range(200))),
    "a plane cut": truncate("psf/c/1/0/0", 30),
    "a plane a folder": lambda p: ((p / "psf/c/1/0/0").unlink(), (p / "psf/c/1/0/0").mkdir()),
    "planes exchanged": lambda p: shutil.copy(p / "psf/c/1/0/0", p / "psf/c/2/0/0"),
    "an error exchanged": lambda p: shutil.copy(p / "psf_std/c/1/0/0", p / "psf_std/c/2/0/0"),
    "distances descending": arrays(distance=lambda a: a[::-1]),
    "distances repeated": arrays(distance=at(1, 1.0)),
    "a distance negative": arrays(distance=at(0, -1.0)),
    "a distance of zero": arrays(distance=at(0, 0.0)),
    "a distance not a number": arrays(distance=at(2, np.nan)),
    "a distance infinite": arrays(distance=at(3, np.inf)),
    "a distance too many": arrays(distance=lambda a: np.append(a, 9.0)),
    "a PSF negative": arrays(psf=at((1, 3, 3), -0.1)),
    "a PSF of zeros": arrays(psf=at(1, 0.0)),
    "a PSF of the sum 2": arrays(psf=lambda a: a * np.float32(2)),
    "a PSF not finite": arrays(psf=at((1, 3, 3), np.nan)),
    "PSFs not square": arrays(psf=rows, psf_std=rows),
    "PSFs of even side": arrays(psf=lambda a: a[:, :6, :6], psf_std=lambda a: a[:, :6, :6]),
    "PSFs off centre": arrays(x=lambda a: a + 5e-6),
    "pixels not square": arrays(x=lambda a: 2 * a),
    "pixels not even": arrays(y=at(0, -2e-5)),
    "pixels without size": arrays(x=lambda a: 0 * a, y=lambda a: 0 * a),
    "pixels negative": arrays(x=lambda a: -a, y=lambda a: -a),
    "pixels too few": arrays(x=lambda a: a[:5]),
    "another pitch than the camera's": arrays(x=lambda a: 1.2 * a, y=lambda a: 1.2 * a),
    "two planes": arrays(
        psf=lambda a: a[:2], psf_std=lambda a: a[:2], distance=lambda a: a[:2], distance_std=lambda a: a[:2]
    ),
    "errors negative": arrays(psf_std=lambda a: -a),
    "errors not a number": arrays(psf_std=at((1, 3, 3), np.nan)),
    "errors infinite": arrays(psf_std=at((1, 3, 3), np.inf)),
    "errors of other planes": arrays(psf_std=lambda a: a[:3]),
    "position errors negative": arrays(distance_std=lambda a: -a),
    "position errors too few": arrays(distance_std=lambda a: a[:3]),
}


def entries(change):
    """Write the archive anew with another list of (name, data, compression)."""

    def spoil(path):
        with zipfile.ZipFile(path) as archive:
            found = [(each.filename, archive.read(each), zipfile.ZIP_STORED) for each in archive.infolist()]
        with zipfile.ZipFile(path, "w") as archive:
            for name, data, kind in change(found):
                archive.writestr(name, data, kind)

    return spoil


def linked(path):
    """The first plane's entry as a link, as Unix packers write it."""
    with zipfile.ZipFile(path) as archive:
        found = [(each.filename, archive.read(each)) for each in archive.infolist()]
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in found:
            entry = zipfile.ZipInfo(name)
            entry.external_attr = (0o120777 if name == "psf/c/0/0/0" else 0o100644) << 16
            archive.writestr(entry, data)


def edit(change):
    return lambda path: path.write_bytes(change(path.read_bytes()))


ARCHIVES = {
    "nothing": lambda p: p.unlink(),
    "an empty file": edit(lambda b: b""),
    "text": edit(lambda b: b"psf"),
    "a folder": lambda p: (p.unlink(), p.mkdir()),
    "an archive of nothing": entries(lambda e: []),
    "an archive of something else": entries(lambda e: [("readme.txt", b"hello", 0)]),
    "one folder too deep": entries(lambda e: [("t.zarr/" + n, d, k) for n, d, k in e]),
    "half": edit(lambda b: b[: len(b) // 2]),
    "its end cut": edit(lambda b: b[:-30]),
    "its beginning cut": edit(lambda b: b[64:]),
    "the middle zeroed": edit(lambda b: b[:3000] + bytes(500) + b[3500:]),
    "a name that climbs out": entries(lambda e: [*e, ("../../evil", b"x", 0)]),
    "an absolute name": entries(lambda e: [*e, ("/tmp/evil", b"x", 0)]),
    "a name with backslashes": entries(lambda e: [*e, ("..\\evil", b"x", 0)]),
    "a drive's name": entries(lambda e: [*e, ("C:/evil", b"x", 0)]),
    "a link": linked,
    "a bomb": entries(lambda e: [*e[:-1], ("zarr.json", b" " * 50_000_000, zipfile.ZIP_DEFLATED)]),
    "deflated": entries(lambda e: [(n, d, zipfile.ZIP_DEFLATED) for n, d, _ in e]),
    "encrypted": edit(
        lambda b: b.replace(b"PK\3\4\x14\0\0\0", b"PK\3\4\x14\0\1\0").replace(
            b"PK\1\2\x14\3\x14\0\0\0", b"PK\1\2\x14\3\x14\0\1\0"
        )
    ),
    "a plane missing": entries(lambda e: [each for each in e if each[0] != "psf/c/1/0/0"]),
}

COMMANDS = (
    ["info", "T"],
    ["estimate", "image.tif", "--table", "T", "--noise", "0.01"],
    ["simulate", "image.png", "--table", "T", "--distance", "1.2 m", "-o", "o.tif"],
    ["limits", "--table", "T", "--json"],
    ["check", "T", "captures.csv", "--target", "point"],
    ["compare", "--table", "T", "--method", "wiener", "--runs", "1", "-o", "out"],
    ["report", "image.tif", "--table", "T", "-o", "r.html"],
    ["depthmap", "image.tif", "--table", "T", "--noise", "0.01", "-o", "m.zarr"],
)
CASES = [("t.zarr", name) for name in FOLDERS] + [("t.zarr.zip", name) for name in ARCHIVES]


@pytest.mark.parametrize(("table", "damage"), CASES)
def test_a_broken_table_is_refused(refused, desk, table, damage):
    (FOLDERS if table == "t.zarr" else ARCHIVES)[damage](desk / table)
    words = COMMANDS[CASES.index((table, damage)) % len(COMMANDS)]
    assert table in refused(*(table if word == "T" else word for word in words))
    with pytest.raises(PsflutError, match=table):
        store.read_table(desk / table)


def test_the_control_whole_tables_are_read(desk, small):
    for name in ("t.zarr", "t.zarr.zip"):
        np.testing.assert_allclose(store.read_table(desk / name).psf, small.psf, atol=1e-7)
    for spoil in (attributes(check={"median": 0.02}), arrays(psf=lambda a: a)):
        spoil(desk / "t.zarr")
        assert dataclasses.is_dataclass(store.read_table(desk / "t.zarr"))  # the spoilers themselves break nothing
