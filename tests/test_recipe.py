import numpy as np
import pytest

from calib.recipe import build, read_recipe
from psflut.camera_file import read_camera
from psflut.errors import PsflutError
from psflut.store import SHIPPED, read_table

RECIPES = sorted(SHIPPED[1].glob("*.toml"))
CAMERA = """
[camera]
focal_length = "16 mm"
f_number = 2
focus_distance = "6 m"
pixel_pitch = "6 um"
"""
TABLE = """
[table]
model = "gaussian"
distances = { from = "1 m", to = "3 m", count = 4 }
size = 41
"""


@pytest.mark.parametrize("path", RECIPES, ids=lambda path: path.stem)
def test_every_shipped_table_is_what_its_recipe_gives(path):
    recipe, table = read_recipe(path), read_table(path.stem)
    np.testing.assert_array_equal(table.axis, recipe.distances)
    assert table.provenance["recipe_sha256"] == recipe.sha256
    for k in (0, len(table.axis) // 2, -1):
        plane = recipe.model(recipe.camera, recipe.distances[k], recipe.size)
        np.testing.assert_allclose(table.psf[k], plane, atol=1e-6 * plane.max())


def test_a_recipe_builds_a_table_with_its_provenance(tmp_path):
    path = tmp_path / "r.toml"
    path.write_text(CAMERA + TABLE)
    heard = []
    table = build(read_recipe(path), heard.append)
    assert len(heard) == 4
    assert table.camera.focus_distance == pytest.approx(6.0)
    assert table.provenance["model"] == "gaussian"
    assert np.ptp(np.diff(1 / table.axis)) < 1e-12


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("f_number = 2", "f_numbr = 2", "f_numbr"),
        ("f_number = 2", "", "f_number"),
        ("f_number = 2", 'f_number = 2\naperture_diameter = "8 mm"', "one of them"),
        ("f_number = 2", "f_number = 0", "positive"),
        ('"16 mm"', "16", "unit"),
        ('"16 mm"', '"16 furlong"', "unit"),
        ('"16 mm"', '"-16 mm"', "positive"),
        ('"6 um"', '"0 um"', "positive"),
        ('"6 m"', '"1 mm"', "focus_distance"),
        ('focus_distance = "6 m"', 'detector_distance = "1 mm"', "focal_length"),
        ('"gaussian"', '"gausian"', "gausian"),
        ("size = 41", "size = 41\nsigma = 3", "sigma"),
        ("size = 41", "size = 40", "odd"),
        ("size = 41", "size = 5", "size"),
        ("count = 4", "count = 1", "count"),
        ('from = "1 m"', 'from = "4 m"', "near to far"),
        ("[table]", "[tabel]", "tabel"),
        ("[table]", "[capture]\nimger = 1\n[table]", "imger"),
        ("[table]", '[capture]\nimager = "laplace"\n[table]', "laplace"),
        ("[table]", "[table", "TOML"),
    ],
)
def test_a_mistake_in_a_recipe_is_named(tmp_path, old, new, word):
    path = tmp_path / "r.toml"
    path.write_text((CAMERA + TABLE).replace(old, new))
    with pytest.raises(PsflutError, match=word):
        build(read_recipe(path))


def test_camera_files_take_either_of_their_alternatives(tmp_path):
    path = tmp_path / "c.toml"
    path.write_text(CAMERA)
    focused = read_camera(path)
    path.write_text(
        CAMERA.replace("f_number = 2", 'aperture_diameter = "8 mm"').replace(
            'focus_distance = "6 m"', f'detector_distance = "{focused.detector_distance!r} m"'
        )
    )
    assert read_camera(path) == focused
