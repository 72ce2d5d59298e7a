"""`psflut estimate`: its contract, and what it says to those who err."""

from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
import tifffile

from psflut.writing import write_tiff

KEYS = ["image", "method", "distance_m", "interval_m", "level", "outcome", "message", "modes", "seconds"]
SMALL = ("--patch", "96,96,64")


def test_one_json_object_an_image_and_method(estimates, shelf, tmp_path):
    (tmp_path / "copy.tif").write_bytes((shelf / "capture.tif").read_bytes())
    images, methods = [str(shelf / "capture.tif"), "./copy.tif"], ["wiener", "wiener:candidates=200"]
    found = estimates(*images, "--table", "lab16mm", "--method", ", ".join(methods), "--level", "0.9", *SMALL)
    assert [(each["image"], each["method"]) for each in found] == [(i, m) for i in images for m in methods]
    for each in found:
        assert list(each) == KEYS
        near, far = each["interval_m"]
        assert 0.8 <= near < each["distance_m"] < far <= 5.0
        assert (each["level"], each["outcome"], each["message"]) == (0.9, "ok", "")
        assert sum(mode["weight"] for mode in each["modes"]) == pytest.approx(1.0, abs=0.01)
        assert list(each["modes"][0]) == ["distance_m", "weight"]
        assert each["seconds"] > 0
        assert each["distance_m"] == pytest.approx(1.63, abs=0.1)


def test_an_edge_is_named_with_its_sentence(psflut, estimates, shelf, tmp_path):
    for name, first in (("wide", "1 m"), ("narrow", "2 m")):
        (tmp_path / f"{name}.toml").write_text(
            (shelf / "recipe.toml").read_text().replace('from = "1 m"', f'from = "{first}"')
        )
        assert psflut("build", f"{name}.toml", "-o", f"{name}.zarr")[0] == 0
    words = ("--table", "wide.zarr", "--distance", "1.3 m", "--noise", "0.003", "-o", "a.tif")
    assert psflut("simulate", shelf / "scene.png", *words)[0] == 0
    (found,) = estimates("a.tif", "--table", "narrow.zarr", "--noise", "0.003", *SMALL)
    assert list(found) == [*KEYS, "edge"]
    assert (found["outcome"], found["edge"]) == ("at_edge", "near")
    assert "extend the table" in found["message"]


def test_words_for_a_person(psflut, shelf):
    code, out, err = psflut("estimate", shelf / "capture.tif", "--table", "lab16mm", *SMALL)
    assert code == 0
    heading, row = out.splitlines()
    assert heading.split() == ["image", "method", "distance", "interval", "outcome", "seconds"]
    assert row.split()[1:4] == ["wiener", row.split()[2], "m"]
    assert "(95 %)" in row
    assert "is estimated from" in err  # neither option nor table knows the noise


def test_from_a_scene_to_its_distance_by_the_names_of_files_and_table(psflut, estimates, shelf):
    scene = shelf / "scene.png"
    words = ("--camera", shelf / "camera.toml", "--distance", "1.4 m", "--noise", "0.004", "-o", "a.tif")
    assert psflut("simulate", scene, *words)[0] == 0
    (found,) = estimates("a.tif", "--table", "lab16mm", "--patch", "64,64,128", "--noise", "0.004")
    near, far = found["interval_m"]
    assert found["outcome"] == "ok"
    assert found["distance_m"] == pytest.approx(1.4, abs=0.05)
    assert far - near < 0.2


def test_the_thesis_method_with_a_known_scene(psflut, estimates, shelf):
    words = ("--table", "thesis", "--distance", "3.7 m", "-o", "a.tif", "--ideal", "ideal.tif")
    assert psflut("simulate", shelf / "scene.png", *words)[0] == 0
    method = "golden_section:subtract_noise=true:redraws=2"
    words = ("--scene", "ideal.tif", "--method", method, "--patch", "64,64,128")
    (found,) = estimates("a.tif", "--table", "thesis", *words)
    assert found["method"] == method
    assert found["distance_m"] == pytest.approx(3.7, abs=0.3)


def test_a_scene_that_is_a_point_selects_its_method(psflut, estimates, lab16mm):
    image = np.full((64, 64), 0.02)
    image[8:57, 8:57] += 50 * lab16mm.at(1.63)
    write_tiff(Path("point.tif"), image + 0.002 * np.random.default_rng(0).standard_normal(image.shape), {})
    words = ("point.tif", "--table", "lab16mm", "--noise", "0.002")
    for more in (("--scene", "point"), ("--scene", "point", "--method", "point:candidates=60"), ("--method", "point")):
        (found,) = estimates(*words, *more)
        assert found["method"].startswith("point")
        assert found["outcome"] == "ok"
        assert found["distance_m"] == pytest.approx(1.63, abs=0.01)


def test_an_option_wins_over_the_table_and_says_so(psflut, shelf):
    words = ("--table", "thesis", "--noise", "0.02", "--imager", "plain", "--json", *SMALL)
    code, out, err = psflut("estimate", shelf / "capture.tif", *words)
    assert code == 0
    assert out.count("\n") == 1
    assert "noise 0.02 is used in place of the table's 0.03162" in err
    assert "imager plain is used in place of the table's laplacian:0.2" in err


def test_a_constant_image_is_flat(estimates, lab16mm):
    write_tiff(Path("grey.tif"), np.full((128, 128), 0.5), {})
    iio.imwrite("black.png", np.zeros((128, 128), np.uint8))
    for found in estimates("grey.tif", "black.png", "--table", "lab16mm"):
        assert found["outcome"] == "flat"
        near, far = found["interval_m"]
        assert lab16mm.span[0] < near < found["distance_m"] < far < lab16mm.span[1]


def test_colour_sixteen_bits_and_a_patch_give_the_same_as_grey(estimates, shelf):
    grey = np.clip(tifffile.imread(shelf / "capture.tif"), 0, 1)
    levels = np.round(grey * 65535).astype(np.uint16)
    tifffile.imwrite("grey.tif", levels)
    tifffile.imwrite("colour.tif", np.stack([levels] * 3, axis=-1), photometric="rgb")
    tifffile.imwrite("part.tif", levels[96:160, 80:160])
    words = ("--table", "lab16mm", "--noise", "0.003")
    found = estimates("grey.tif", "colour.tif", *words, "--patch", "96,80,64x80") + estimates("part.tif", *words)
    for each in found[1:]:
        assert each["distance_m"] == pytest.approx(found[0]["distance_m"], rel=1e-6)


def test_an_encoded_capture_is_made_linear(estimates, shelf):
    linear = np.clip(tifffile.imread(shelf / "capture.tif"), 0, 1)
    write_tiff(Path("linear.tif"), linear, {})
    write_tiff(Path("encoded.tif"), linear ** (1 / 2.2), {})
    words = ("--table", "lab16mm", "--noise", "0.003", *SMALL)
    (plain,), (decoded,) = estimates("linear.tif", *words), estimates("encoded.tif", *words, "--gamma", "2.2")
    assert decoded["distance_m"] == pytest.approx(plain["distance_m"], rel=1e-4)


def test_what_was_found_before_a_refusal_is_shown(psflut, shelf):
    words = (shelf / "capture.tif", "missing.tif", "--table", "lab16mm", *SMALL)
    for json_too in ([], ["--json"]):
        code, out, err = psflut("estimate", *words, *json_too)
        assert code == 2
        assert "capture.tif" in out
        assert err.splitlines()[-1].startswith("psflut: no image file at missing.tif")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--patch", "0,0,20"], "smaller than the table's PSF"),
        (["--patch", "200,0,64"], "leaves the image"),
        (["--patch", "0,0"], "Y,X,SIZE"),
        (["--method", "weiner"], "wiener"),
        (["--method", "wiener,"], "wiener"),
        (["--method", "wiener:colour=red"], "'colour'"),
        (["--method", "golden_section:start=tabel"], "'tabel'"),
        (["--method", "golden_section:iterations=few"], "iterations"),
        (["--method", "wiener:candidates=1"], "candidates"),
        (["--table", "lab17mm"], "lab16mm"),
        (["--table", "{capture}"], "capture.tif"),
        (["--imager", "laplace"], "laplacian"),
        (["--imager", "laplacian:2"], "alpha"),
        (["--noise", "0"], "positive"),
        (["--noise", "-0.1"], "positive"),
        (["--noise", "variance:-1"], "positive"),
        (["--noise", "much"], "0.005"),
        (["--level", "95"], "--level"),
        (["--level", "0"], "level"),
        (["--gamma", "0"], "gamma"),
        (["--gamma", "2.2", "--srgb"], "gamma"),
        (["--scene", "{capture}"], "wiener does not use a known scene"),
        (["--scene", "missing.png"], "missing.png"),
        (["--scene", "point", "--method", "wiener"], "wiener does not know what a point is"),
    ],
)
def test_a_mistake_in_what_is_asked_is_refused(refused, shelf, words, sentence):
    given = [word.format(capture=shelf / "capture.tif") for word in words]
    assert sentence in refused("estimate", shelf / "capture.tif", "--table", "lab16mm", *given)


def test_an_image_that_cannot_be_used_is_named(refused):
    values = np.random.default_rng(0).random((64, 64))
    pictures = {
        "small.tif": values[:30, :30],
        "negative.tif": values - 1,
        "hole.tif": np.where(values > 0.999, np.nan, values),
        "two.tif": np.stack([values] * 2),
    }
    for name, pixels in pictures.items():
        tifffile.imwrite(name, pixels.astype(np.float32), photometric="minisblack")
        assert name in refused("estimate", name, "--table", "lab16mm", "--noise", "0.01")
    Path("empty.png").touch()
    for name in ("empty.png", "missing.png", "."):
        assert name in refused("estimate", name, "--table", "lab16mm")


def test_a_scene_of_another_size_is_refused(refused, shelf):
    write_tiff(Path("scene.tif"), np.eye(64), {})
    words = ("--table", "lab16mm", "--method", "golden_section", "--scene", "scene.tif")
    assert "(64, 64)" in refused("estimate", shelf / "capture.tif", *words)


def test_a_second_image_with_its_table_selects_its_method(psflut, estimates, refused, shelf, tmp_path):
    for name, stop in (("wide", "2"), ("small", "8")):
        recipe = (shelf / "recipe.toml").read_text().replace("f_number = 2", f"f_number = {stop}")
        (tmp_path / f"{name}.toml").write_text(recipe.replace("count = 4", "count = 12"))
        assert psflut("build", f"{name}.toml", "-o", f"{name}.zarr")[0] == 0
        words = ("--table", f"{name}.zarr", "--distance", "1.37 m", "--noise", "0.003", "-o", f"{name}.tif")
        assert psflut("simulate", shelf / "scene.png", *words)[0] == 0
    words = ("--table", "wide.zarr", "--second", "small.tif", "--noise", "0.003", *SMALL)
    (found,) = estimates("wide.tif", *words, "--second-table", "small.zarr")
    assert list(found) == KEYS
    assert found["method"] == "two_image"
    assert found["distance_m"] == pytest.approx(1.37, abs=0.03)
    assert "--second-table" in refused("estimate", "wide.tif", *words)
    assert "second image" in refused(
        "estimate", "wide.tif", *words, "--second-table", "small.zarr", "--method", "wiener"
    )
    write_tiff(Path("other.tif"), np.full((64, 64), 0.5), {})
    assert "shape" in refused(
        "estimate", "wide.tif", "--table", "wide.zarr", "--second", "other.tif", "--second-table", "small.zarr"
    )
