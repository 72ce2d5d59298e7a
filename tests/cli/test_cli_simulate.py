"""`psflut simulate`."""

import json

import imageio.v3 as iio
import numpy as np
import pytest
import tifffile

from psflut.capture import Setup, ideal_image
from psflut.images import linearise
from psflut.scenes import simulate
from psflut.store import read_table
from psflut.writing import write_tiff


def truth_in(path):
    with tifffile.TiffFile(path) as file:
        return json.loads(file.pages[0].description)


def test_simulate_writes_float32_and_the_truth(psflut, shelf, tmp_path):
    words = ("--distance", "1.83 m", "--noise", "0.01", "--gain", "2000", "--seed", 7)
    code, out, err = psflut("simulate", shelf / "scene.png", "--camera", shelf / "camera.toml", *words, "-o", "a.tif")
    assert (code, out) == (0, "")
    assert "1.83 m" in err
    picture, truth = tifffile.imread(tmp_path / "a.tif"), truth_in(tmp_path / "a.tif")
    assert (picture.dtype, picture.shape) == (np.float32, (256, 256))
    assert (truth["distance_m"], truth["seed"], truth["scene"]) == (1.83, 7, "scene.png")
    assert truth["read_sigma"] == 0.01
    assert truth["setup"]["gain"] == 2000


def test_a_scene_with_depth_has_a_distance_for_every_pixel(psflut, shelf, tmp_path):
    distance = np.full((256, 256), 1.7)  # of one layer, which takes a hundredth of the time
    np.save(tmp_path / "depth.npy", distance)
    tifffile.imwrite(tmp_path / "whole.tif", np.full((256, 256), 2, np.uint8))
    words = ("simulate", shelf / "scene.png", "--table", "lab16mm", "--noise", "0.001", "--seed", 3)
    code, _, err = psflut(*words, "--distance", "depth.npy", "-o", "a.tif")
    assert (code, "from 1.7 m to 1.7 m" in err) == (0, True)
    assert truth_in(tmp_path / "a.tif")["distances"] == "depth.npy"
    scene = iio.imread(shelf / "scene.png") / 65535.0
    theirs, _ = simulate(scene, distance, read_table("lab16mm"), Setup(noise="0.001"), 3)
    np.testing.assert_array_equal(tifffile.imread(tmp_path / "a.tif"), theirs.astype(np.float32))
    code, _, err = psflut(*words, "--distance", "whole.tif", "-o", "b.tif")
    assert (code, "write the distances in metres, as floats" in err) == (2, True)


def test_the_same_seed_gives_the_same_file(psflut, shelf, tmp_path):
    for name, seed in (("a.tif", 1), ("b.tif", 1), ("c.tif", 2)):
        words = ("--table", "lab16mm", "--distance", "2 m", "--noise", "0.01", "--seed", seed)
        assert psflut("simulate", shelf / "scene.png", *words, "-o", name)[0] == 0
    first, second, other = ((tmp_path / name).read_bytes() for name in ("a.tif", "b.tif", "c.tif"))
    assert first == second != other


def test_simulate_follows_the_set_up_of_a_table(psflut, shelf, tmp_path):
    words = ("--table", "thesis", "--distance", "3.8 m", "-o", "a.tif", "--ideal", "ideal.tif")
    code, _, err = psflut("simulate", shelf / "scene.png", *words)
    assert (code, err.count("\n")) == (0, 1)
    truth = truth_in(tmp_path / "a.tif")
    assert (truth["setup"]["imager"], truth["setup"]["normalise"]) == ("laplacian:0.2", True)
    sharp = tifffile.imread(tmp_path / "ideal.tif")
    expected = ideal_image(iio.imread(shelf / "scene.png") / 65535, Setup("laplacian:0.2", normalise=True))
    np.testing.assert_allclose(sharp, expected, atol=1e-6)


def test_simulate_takes_options_over_the_table_and_says_so(psflut, shelf, tmp_path):
    words = ("--table", "thesis", "--distance", "3.8 m", "--noise", "0.002", "--imager", "plain", "--no-normalise")
    code, _, err = psflut("simulate", shelf / "scene.png", *words, "-o", "a.tif")
    assert code == 0
    assert "noise 0.002 is used in place of the table's 0.03162" in err
    assert "imager plain is used in place of the table's laplacian:0.2" in err
    truth = truth_in(tmp_path / "a.tif")
    assert (truth["read_sigma"], truth["setup"]["imager"], truth["setup"]["normalise"]) == (0.002, "plain", False)


@pytest.mark.parametrize("option", [("--gamma", 2.2), ("--srgb",)])
def test_an_encoded_scene_is_made_linear(psflut, shelf, tmp_path, option):
    words = ("--table", "lab16mm", "--distance", "4.9 m", "-o", "a.tif", "--ideal", "ideal.tif")
    assert psflut("simulate", shelf / "scene.png", *words, *option)[0] == 0
    encoded = iio.imread(shelf / "scene.png") / 65535
    expected = linearise(encoded, srgb=True) if option == ("--srgb",) else encoded**2.2
    np.testing.assert_allclose(tifffile.imread(tmp_path / "ideal.tif"), expected, atol=1e-6)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ([], "--camera"),
        (["--camera", "{camera}", "--table", "lab16mm"], "--camera"),
        (["--table", "lab16mm", "--distance", "9 m"], "outside the table"),
        (["--table", "lab16mm", "--distance", "9"], "unit"),
        (["--table", "lab16mm", "--distance", "depth.npy"], "depth.npy"),
        (["--table", "lab16mm", "--distance", "{exists}"], "is outside the table"),
        (["--table", "lab16mm", "--distance", "9 parsec"], "parsec"),
        (["--camera", "{camera}", "--distance", "0 m"], "positive"),
        (["--camera", "{camera}", "--distance", "-1 m"], "positive"),
        (["--camera", "{camera}", "--distance", "1 cm"], "blur"),
        (["--camera", "{camera}", "--distance", "1e400 m"], "finite"),
        (["--table", "lab17mm"], "lab16mm"),
        (["--table", "lab16mm", "--noise", "0"], "positive"),
        (["--table", "lab16mm", "--noise", "0.01", "--gain", "0"], "gain"),
        (["--table", "lab16mm", "--gain", "100"], "gain"),
        (["--table", "lab16mm", "--bits", "0"], "bits"),
        (["--table", "lab16mm", "--seed", "-1"], "--seed"),
        (["--table", "lab16mm", "--imager", "laplacian:2"], "alpha"),
        (["--table", "lab16mm", "--imager", "laplace"], "laplacian"),
        (["--table", "lab16mm", "-o", "a.png"], ".tif"),
        (["--table", "lab16mm", "-o", "no/a.tif"], "no is not a folder"),
        (["--table", "lab16mm", "-o", "/proc/a.tif"], "/proc/a.tif"),
        (["--table", "lab16mm", "--ideal", "a.tif"], "two files"),
        (["--table", "lab16mm", "-o", "{exists}"], "--overwrite"),
        (["--camera", "{exists}"], "TOML"),
        (["--camera", "missing.toml"], "missing.toml"),
        (["--camera", "{recipe}"], "'table'"),
    ],
)
def test_a_capture_that_cannot_be_is_refused(refused, shelf, words, sentence):
    known = {"camera": shelf / "camera.toml", "exists": shelf / "capture.tif", "recipe": shelf / "recipe.toml"}
    given = [word.format(**known) for word in words]
    usual = ("simulate", shelf / "scene.png", "--distance", "1 m", "-o", "a.tif")
    assert sentence in refused(*usual, *given)


def test_a_mistake_in_a_camera_file_is_named_with_its_file(refused, shelf, tmp_path):
    for old, new, word in (("f_number", "f_numbr", "f_numbr"), ("= 2", "= 0", "f_number"), ('"6 m"', '"6 k"', "unit")):
        (tmp_path / "mine.toml").write_text((shelf / "camera.toml").read_text().replace(old, new))
        words = ("--camera", "mine.toml", "--distance", "1 m", "-o", "a.tif")
        err = refused("simulate", shelf / "scene.png", *words)
        assert "mine.toml" in err
        assert word in err


def test_a_scene_that_is_smaller_than_its_blur_is_refused(refused, shelf, tmp_path):
    write_tiff(tmp_path / "small.tif", np.eye(30), {})
    assert "smaller" in refused("simulate", "small.tif", "--table", "lab16mm", "--distance", "1 m", "-o", "a.tif")
