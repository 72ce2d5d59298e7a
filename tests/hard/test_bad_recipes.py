"""Recipes that say what cannot be: refused in a sentence that names them."""

import pytest
from texts import CAMERA, camera, recipe, spoilt

from calib.recipe import read_recipe

RECIPES = {
    "a camera alone": camera(),
    "no camera": recipe().replace("[camera]", "[lens]"),
    "a broken camera": recipe().replace('"16 mm"', '"16"'),
    "table text": f'table = "gaussian"\n[camera]\n{CAMERA}',
    "another section": recipe() + "[tables]\na = 1\n",
    "no model": recipe('model = "gaussian"\n'),
    "an unknown model": recipe('"gaussian"', '"lorentz"'),
    "a model that climbs": recipe('"gaussian"', '"../pillbox"'),
    "a model with dots": recipe('"gaussian"', '"os.system"'),
    "a model of private name": recipe('"gaussian"', '"__init__"'),
    "a model a number": recipe('"gaussian"', "3"),
    "an unknown setting": recipe(more="blur = 3\n"),
    "a setting of another model": recipe(more="zernikes = [[4, 0, 0.1]]\n"),
    "a setting that does not fit": recipe(more="fir = [1]\n"),
    "a term that does not exist": recipe('"gaussian"', '"pupil"', "zernikes = [[3, 0, 0.1]]\n"),
    "a term with too few numbers": recipe('"gaussian"', '"pupil"', "zernikes = [[4, 0]]\n"),
    "a term of text": recipe('"gaussian"', '"pupil"', 'zernikes = [["coma", 0, 1]]\n'),
    "an infinite aberration": recipe('"gaussian"', '"pupil"', "zernikes = [[4, 0, inf]]\n"),
    "an aberration beyond reason": recipe('"gaussian"', '"pupil"', "zernikes = [[4, 0, 1e6]]\n"),
    "an order beyond reason": recipe('"gaussian"', '"pupil"', "zernikes = [[4000, 0, 1]]\n"),
    "a wavelength of zero": recipe('"gaussian"', '"pupil"', 'wavelengths = ["0 nm"]\n'),
    "a wavelength without unit": recipe('"gaussian"', '"pupil"', 'wavelengths = ["550"]\n'),
    "a tiny wavelength": recipe('"gaussian"', '"pupil"', 'wavelengths = ["1e-9 nm"]\n'),
    "too many wavelengths": recipe(
        '"gaussian"', '"pupil"', 'wavelengths = { from = "400 nm", to = "600 nm", count = 1000000000 }\n'
    ),
    "no distances": recipe('distances = { from = "1 m", to = "3 m", count = 4 }\n'),
    "distances a list": recipe('{ from = "1 m", to = "3 m", count = 4 }', '["1 m", "2 m", "3 m"]'),
    "distances backwards": recipe('"3 m"', '"0.5 m"'),
    "distances that stand still": recipe('"3 m"', '"1 m"'),
    "distances without unit": recipe('"1 m"', "1"),
    "a negative distance": recipe('"1 m"', '"-1 m"'),
    "a distance of zero": recipe('"1 m"', '"0 m"'),
    "an infinite distance": recipe('"3 m"', '"inf m"'),
    "a count of two": recipe("count = 4", "count = 2"),
    "a count of zero": recipe("count = 4", "count = 0"),
    "a count of a fraction": recipe("count = 4", "count = 4.5"),
    "a count of text": recipe("count = 4", 'count = "many"'),
    "a count beyond reason": recipe("count = 4", "count = 10000000"),
    "planes beyond memory": recipe("count = 4", "count = 10000").replace("size = 41", "size = 1001"),
    "a misspelt range": recipe("count = 4", "cuont = 4"),
    "no size": recipe("size = 41\n"),
    "an even size": recipe("size = 41", "size = 40"),
    "a size of one": recipe("size = 41", "size = 1"),
    "a negative size": recipe("size = 41", "size = -41"),
    "a size too small for the blur": recipe("size = 41", "size = 3"),
    "a size beyond reason": recipe("size = 41", "size = 100001"),
    "an unknown imager": recipe(capture='imager = "retina"\n'),
    "an imager a number": recipe(capture="imager = 3\n"),
    "a negative noise": recipe(capture='noise = "-1"\n'),
    "a noise of text": recipe(capture='noise = "low"\n'),
    "a noise a number": recipe(capture="noise = 0.1\n"),
    "bits beyond reason": recipe(capture="bits = 99\n"),
    "a negative gain": recipe(capture='noise = "0.1"\ngain = -5\n'),
    "a gain without noise": recipe(capture="gain = 5\n"),
    "a misspelt capture": recipe(capture='nosie = "0.1"\n'),
    "a filter of nothing": recipe(capture="filter_size = -5\n"),
    "capture text": 'capture = "plain"\n' + recipe(),
}


@pytest.mark.parametrize("case", RECIPES)
def test_a_recipe_is_refused(refused, desk, case):
    assert "spoilt" in refused("build", spoilt(desk, RECIPES[case]), "-o", "n.zarr.zip")


def test_the_control_a_whole_recipe_is_read(desk):
    assert read_recipe(desk / spoilt(desk, recipe())).size == 41
