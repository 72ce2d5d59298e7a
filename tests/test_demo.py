"""The demo on a small stage: every method, every figure, a table of results."""

import csv

import pytest

from psflut import demo
from psflut.errors import PsflutError
from psflut.estimation import for_any_scene


def test_the_demo_tells_its_story(tmp_path, monkeypatch):
    act = demo.Act("lab16mm", "plain imager", (1.37, 2.11), 64, "0.005")
    monkeypatch.setattr(demo, "ACTS", (act,))
    rows = list(demo.run(tmp_path / "out"))
    methods = for_any_scene()
    assert [(row[2], row[1]) for row in rows] == [(m, z) for m in methods for z in ("1.37 m", "2.11 m")]
    figures = {path.name for path in (tmp_path / "out").glob("*.png")}
    assert figures == {f"lab16mm-{kind}.png" for kind in ("psfs", "captures", "estimates", "restored")}
    with (tmp_path / "out" / "results.csv").open(newline="") as file:
        assert list(csv.reader(file)) == [list(demo.HEADINGS), *map(list, rows)]


def test_an_unwritable_folder_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(PsflutError, match="choose another"):
        list(demo.run(tmp_path / "file"))


def test_the_distances_of_the_demo_lie_off_the_grids(lab16mm, thesis):
    for act, table in zip(demo.ACTS, (lab16mm, thesis), strict=True):
        for distance in act.distances:
            assert min(abs(table.axis - distance)) > 1e-3
