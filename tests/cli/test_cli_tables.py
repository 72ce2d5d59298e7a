"""`psflut info` and `psflut build`."""

import json
from pathlib import Path

import numpy as np
import pytest

from psflut.store import read_table


def test_info_in_words_and_as_json(psflut):
    code, out, err = psflut("info", "lab16mm")
    assert (code, err) == (0, "")
    for words in ("800 mm to 5 m, 64 planes", "16 mm f/2, focused at 6 m", "49 x 49 pixels of 6 um", "470 nm"):
        assert words in out
    code, out, err = psflut("info", "thesis", "--json")
    assert (code, err, out.count("\n")) == (0, "", 1)
    facts = json.loads(out)
    assert (facts["span_m"], facts["planes"], facts["size_px"]) == ([3.2, 4.5], 64, 17)
    assert facts["pixel_pitch_m"] == pytest.approx(facts["camera"]["pixel_pitch"], rel=1e-12)
    assert facts["noise"]["read"] == pytest.approx(np.sqrt(1e-3))
    assert facts["imager"] == "laplacian:0.2"


def test_a_folder_named_like_a_shipped_table_does_not_hide_it(psflut, tmp_path):
    (tmp_path / "thesis").mkdir()
    assert psflut("info", "thesis")[0] == 0


@pytest.mark.parametrize("name", ["t.zarr", "t.zarr.zip"])
def test_build_writes_a_table_and_replaces_it_only_on_request(psflut, refused, shelf, tmp_path, name):
    code, out, err = psflut("build", shelf / "recipe.toml", "-o", name)
    assert (code, out) == (0, "")
    assert f"{name}: 4 planes of 41 x 41 pixels" in err
    assert len(read_table(tmp_path / name).axis) == 4
    assert "--overwrite" in refused("build", shelf / "recipe.toml", "-o", name)
    assert psflut("build", shelf / "recipe.toml", "-o", name, "--overwrite")[0] == 0
    assert psflut("info", name)[0] == 0
    assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("f_number", "f_numbr", "f_numbr"),
        ('"16 mm"', "16", "unit"),
        ('"16 mm"', '"16 furlong"', "unit"),
        ("f_number = 2", "f_number = -2", "f_number"),
        ('"gaussian"', '"gausian"', "gausian"),
        ("size = 41", "size = 41\nsigma = 3", "sigma"),
        ("size = 41", "size = 40", "odd"),
        ("size = 41", 'size = 41\nfir = {from = "-1 m", to = "2 m", count = 3}', "greater"),
        ("count = 4", "count = 2", "count"),
        ('from = "1 m"', 'from = "5 m"', "near to far"),
        ("[table]", '[capture]\nnoise = "loud"\n[table]', "loud"),
        ("[table]", "[table", "TOML"),
    ],
)
def test_a_mistake_in_a_recipe_is_named_with_its_file(refused, shelf, tmp_path, old, new, word):
    (tmp_path / "mine.toml").write_text((shelf / "recipe.toml").read_text().replace(old, new))
    err = refused("build", "mine.toml", "-o", "t.zarr")
    assert "mine.toml" in err
    assert word in err


@pytest.mark.parametrize("output", ["t.h5", "no/t.zarr", "/proc/t.zarr", "/proc/t.zarr.zip"])
def test_a_table_that_cannot_be_written_is_refused(refused, shelf, output):
    assert Path(output).name in refused("build", shelf / "recipe.toml", "-o", output)


def test_a_folder_that_is_no_table_is_never_replaced(refused, shelf, tmp_path):
    (tmp_path / "work.zarr").mkdir()
    (tmp_path / "work.zarr" / "letter.txt").touch()
    assert "folder" in refused("build", shelf / "recipe.toml", "-o", "work.zarr", "--overwrite")
