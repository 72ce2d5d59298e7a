"""Broken tables in folders: each refused by `read_table`, and by commands, in a sentence that names it."""

import os
import shutil

import numpy as np
import pytest
from samples import sampled
from spoilers import (
    arrays,
    at,
    attributes,
    become,
    command,
    fifo,
    link,
    meta,
    moved_and_linked,
    put,
    remove,
    rows,
    truncate,
    zarr_array,
)

from psflut import store
from psflut.errors import PsflutError

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


@pytest.mark.parametrize("damage", FOLDERS)
def test_a_broken_table_is_refused(desk, damage):
    FOLDERS[damage](desk / "t.zarr")
    with pytest.raises(PsflutError, match=r"t\.zarr"):
        store.read_table(desk / "t.zarr")


@pytest.mark.parametrize("damage", sampled(FOLDERS))
def test_commands_refuse_a_broken_table(refused, desk, damage):
    FOLDERS[damage](desk / "t.zarr")
    assert "t.zarr" in refused(*command("t.zarr", list(FOLDERS).index(damage)))


def test_the_control_whole_tables_are_read(desk, small):
    for spoil in (attributes(check={"median": 0.02}), arrays(psf=lambda a: a)):
        spoil(desk / "t.zarr")  # the spoilers themselves break nothing
        np.testing.assert_allclose(store.read_table(desk / "t.zarr").psf, small.psf, atol=1e-7)
