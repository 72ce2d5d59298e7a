"""Manifests that say what cannot be: refused in a sentence that names them."""

import os

import imageio.v3 as iio
import numpy as np
import pytest
from texts import spoilt

from calib.manifest import read_manifest
from psflut.errors import PsflutError

ROWS = "file,distance_m\n0.tif,1.1\n1.tif,1.6\n2.tif,2.9\n"


def rows(*lines, head="file,distance_m"):
    return "\n".join((head, *lines, ""))


def third(row, head="file,distance_m"):
    return rows(*(f"{n}.tif,1.{n}{',' * (head.count(',') - 1)}" for n in range(2)), row, head=head)


MANIFESTS = {
    "empty": "",
    "blank": "\n\n\n",
    "a head alone": "file,distance_m\n",
    "no head": "0.tif,1.1\n1.tif,1.6\n",
    "no unit": ROWS.replace("distance_m", "distance"),
    "an unknown unit": ROWS.replace("distance_m", "distance_ft"),
    "a misspelt column": ROWS.replace("file", "flie"),
    "a column too many": third("2.tif,2.9,red", "file,distance_m,colour"),
    "a column twice": third("2.tif,2.9,2.9", "file,distance_m,distance_m"),
    "both kinds of axis": third("2.tif,2.9,1", "file,distance_m,stage_mm"),
    "no position": rows("0.tif", "1.tif", head="file"),
    "x without y": third("2.tif,2.9,3", "file,distance_m,x"),
    "a column without a name": third("2.tif,2.9,3", "file,distance_m,"),
    "semicolons": ROWS.replace(",", ";"),
    "tabs": ROWS.replace(",", "\t"),
    "decimal commas": rows('0.tif,"1,1"', '1.tif,"1,6"'),
    "a unit in the cell": third("2.tif,2.9 m"),
    "a cell too few": third("2.tif"),
    "a cell too many": third("2.tif,2.9,3.1"),
    "no distance": third("2.tif,"),
    "no file": third(",2.9"),
    "a distance of zero": third("2.tif,0"),
    "a negative distance": rows("0.tif,-1", "1.tif,1"),
    "a distance not a number": third("2.tif,nan"),
    "an infinite distance": third("2.tif,inf"),
    "a distance beyond numbers": third("2.tif,1e999"),
    "a distance of text": third("2.tif,far"),
    "an underscore in a number": third("2.tif,2_9"),
    "positions that turn back": rows("0.tif,1", "1.tif,3", "2.tif,2"),
    "two positions": rows("0.tif,1", "1.tif,2"),
    "the same position thrice": rows("0.tif,1", "1.tif,1", "2.tif,1"),
    "a frame twice": rows("0.tif,1", "0.tif,2", "1.tif,3"),
    "a frame twice by another path": rows("0.tif,1", "./0.tif,2", "1.tif,3"),
    "a frame that is not there": third("9.tif,2.9"),
    "a frame that is a folder": third("t.zarr,2.9"),
    "a frame that is a table": third("t.zarr.zip,2.9"),
    "a frame that is the manifest": third("spoilt,2.9"),
    "a frame of another shape": third("image-small.png,2.9"),
    "an absolute frame": third("/etc/passwd,2.9"),
    "a frame above": third("../2.tif,2.9"),
    "a frame above, hidden": third("a/../../2.tif,2.9"),
    "a frame above by backslashes": third("..\\2.tif,2.9"),
    "a frame on a drive": third("C:\\2.tif,2.9"),
    "a frame on a server": third("\\\\server\\2.tif,2.9"),
    "a frame at home": third("~/2.tif,2.9"),
    "a frame on the web": third("https://example.org/2.tif,2.9"),
    "a frame with a null": third("2\0.tif,2.9"),
    "a frame with a line": third('"2\n.tif",2.9'),
    "a frame by a link out": third("out.tif,2.9"),
    "a frame by a circle": third("circle.tif,2.9"),
    "a frame that is a pipe": third("pipe,2.9"),
    "a name too long": third(f"{'a' * 5000}.tif,2.9"),
    "a page of text": third("2.tif,2.9,first", "file,distance_m,page"),
    "a negative page": third("2.tif,2.9,-1", "file,distance_m,page"),
    "a page that is not there": third("2.tif,2.9,7", "file,distance_m,page"),
    "half a page": third("2.tif,2.9,0.5", "file,distance_m,page"),
    "a page beyond numbers": third(f"2.tif,2.9,{'9' * 5000}", "file,distance_m,page"),
    "a page in superscript": third("2.tif,2.9,\N{SUPERSCRIPT TWO}", "file,distance_m,page"),
    "a centre outside": third("2.tif,2.9,900,3", "file,distance_m,x,y"),
    "a centre before": third("2.tif,2.9,-3,3", "file,distance_m,x,y"),
    "half a centre": third("2.tif,2.9,3,", "file,distance_m,x,y"),
    "a centre of text": third("2.tif,2.9,middle,3", "file,distance_m,x,y"),
    "quotes without end": third('"2.tif,2.9'),
    "quotes inside": third('2".tif"x,2.9'),
    "Latin-1": third("Entfernung f\xfcnf.tif,2.9").encode("latin-1"),
    "UTF-16": ROWS.encode("utf-16"),
    "nulls": bytes(500),
    "nonsense": bytes(range(256)),
    "a field without end": "file,distance_m\n" + "a" * 200_000,
    "a picture": b"\x89PNG\r\n\x1a\n" + bytes(100),
}


@pytest.fixture
def corner(desk):
    """The desk with frames of the wrong kinds on it."""
    iio.imwrite(desk / "image-small.png", np.zeros((32, 32), np.uint8))
    (desk / "circle.tif").symlink_to(desk / "circle.tif")
    (desk / "out.tif").symlink_to("/etc/hostname")
    os.mkfifo(desk / "pipe")
    return desk


@pytest.mark.parametrize("case", MANIFESTS)
def test_a_manifest_is_refused(refused, corner, case):
    words = ["calibrate", spoilt(corner, MANIFESTS[case]), "--target", "point", "--pixel-pitch", "6 um", "-o", "n.zarr"]
    assert "spoilt" in refused(*words)
    with pytest.raises(PsflutError, match="spoilt"):
        read_manifest(corner / "spoilt", least_positions=3)


def test_distances_within_the_focal_length_are_of_another_unit(refused, desk):
    (desk / "captures.csv").write_text(ROWS.replace("distance_m", "distance_mm"))
    words = ["calibrate", "captures.csv", "--target", "point", "--camera", "camera.toml", "-o", "n.zarr"]
    assert "check the unit" in refused(*words)


def test_the_control_a_whole_manifest_is_read(desk):
    assert len(read_manifest(desk / spoilt(desk, ROWS), least_positions=3).rows) == 3
