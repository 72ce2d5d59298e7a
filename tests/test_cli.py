"""The command line: its contract, and what it says to those who err."""

import json
import subprocess
import sys
import time
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
import tifffile

from psflut import __version__, cli
from psflut.capture import Setup, ideal_image
from psflut.images import linearise, write_tiff
from psflut.store import read_table

KEYS = ["image", "method", "distance_m", "interval_m", "level", "outcome", "message", "modes", "seconds"]
CAMERA = """
[camera]
focal_length = "16 mm"
f_number = 2
focus_distance = "6 m"
pixel_pitch = "6 um"
"""
RECIPE = (
    CAMERA
    + """
[table]
model = "gaussian"
distances = { from = "1 m", to = "3 m", count = 4 }
size = 41
"""
)
SMALL = ("--patch", "96,96,64")


@pytest.fixture
def psflut(monkeypatch, capfd, tmp_path):
    """Run a command in an empty folder: (exit code, stdout, stderr)."""
    monkeypatch.chdir(tmp_path)

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["psflut", *map(str, words)])
        capfd.readouterr()
        with pytest.raises(SystemExit) as ended:
            cli.main()
        return (ended.value.code, *capfd.readouterr())

    return run


@pytest.fixture
def estimates(psflut):
    """Run ``estimate --json``: its objects."""

    def run(*words):
        code, out, err = psflut("estimate", *words, "--json")
        assert code == 0, err
        return [json.loads(line) for line in out.splitlines()]

    return run


@pytest.fixture
def refused(psflut, tmp_path):
    """Run a command that must be refused, in one sentence and without a trace: the sentence."""

    def run(*words):
        before = sorted(tmp_path.rglob("*"))
        code, out, err = psflut(*words)
        assert (code, out) == (2, ""), err
        assert err.startswith("psflut: ")
        assert err.count("\n") == 1
        assert "Traceback" not in err
        assert sorted(tmp_path.rglob("*")) == before
        return err

    return run


@pytest.fixture(scope="module")
def shelf(tmp_path_factory, scene, lab16mm):
    """A folder with a scene, a capture of it at 1.63 m, a camera and a recipe."""
    from psflut.capture import simulate

    folder = tmp_path_factory.mktemp("shelf")
    iio.imwrite(folder / "scene.png", np.round(scene / scene.max() * 65535).astype(np.uint16))
    write_tiff(folder / "capture.tif", simulate(scene, lab16mm, 1.63, Setup(noise="0.003"), seed=1)[0], {})
    (folder / "camera.toml").write_text(CAMERA)
    (folder / "recipe.toml").write_text(RECIPE)
    return folder


# --- the whole command ---


def test_help_and_version(psflut):
    assert psflut("--version") == (0, f"{__version__}\n", "")
    code, out, err = psflut("--help")
    assert (code, err) == (0, "")
    commands = ("demo", "build", "info", "simulate", "estimate")
    assert all(f"\n  {name} " in out for name in commands)
    assert psflut() == (code, out, err)  # nothing asked: the same help
    for name in commands:
        code, out, _ = psflut(name, "--help")
        assert code == 0
        assert out.startswith(f"Usage: psflut {name}")


def run_python(code):
    start = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return time.perf_counter() - start, done.stdout


def test_help_costs_little_more_than_the_library_that_prints_it():
    asked = (
        "import sys; sys.argv = ['psflut', '--help']; import atexit, psflut.cli\n"
        "heavy = 'numpy scipy zarr pydantic matplotlib emcee skimage imageio tqdm'.split()\n"
        "atexit.register(lambda: print('heavy:', *[m for m in heavy if m in sys.modules]))\n"
        "psflut.cli.main()"
    )
    bare = min(run_python("import typer")[0] for _ in range(2))
    spent, out = min(run_python(asked) for _ in range(2))
    assert out.endswith("heavy:\n")
    assert spent < 6 * bare


def test_a_reader_that_leaves_early_is_no_error(shelf):
    code = "import sys; sys.argv[1:] = ['info', 'lab16mm', '--json']; from psflut.cli import main; main()"
    run = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    run.stdout.close()
    assert run.stderr.read() == ""
    run.stderr.close()
    assert run.wait() == 1


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["estimat"], "estimate"),
        (["--verbose"], "--verbose"),
        (["estimate", "--table", "lab16mm"], "IMAGE"),
        (["estimate", "a.tif"], "--table"),
        (["estimate", "a.tif", "--tabel", "lab16mm"], "--tabel"),
        (["estimate", "a.tif", "--table", "lab16mm", "--level", "high"], "--level"),
        (["estimate", "a.tif", "--table", "lab16mm", "--noise"], "--noise"),
        (["simulate", "a.png", "--camera", "c.toml", "-o", "o.tif"], "--distance"),
        (["simulate", "a.png", "--camera", "c.toml", "--distance", "1 m"], "--output"),
        (["build"], "RECIPE"),
        (["info"], "TABLE"),
    ],
)
def test_a_mistake_in_the_command_points_to_its_help(refused, words, sentence):
    err = refused(*words)
    assert sentence in err
    assert "--help'" in err


# --- info and build ---


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
def test_a_mistake_in_a_recipe_is_named_with_its_file(refused, tmp_path, old, new, word):
    (tmp_path / "mine.toml").write_text(RECIPE.replace(old, new))
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


# --- simulate ---


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
        (tmp_path / "mine.toml").write_text(CAMERA.replace(old, new))
        words = ("--camera", "mine.toml", "--distance", "1 m", "-o", "a.tif")
        err = refused("simulate", shelf / "scene.png", *words)
        assert "mine.toml" in err
        assert word in err


def test_a_scene_that_is_smaller_than_its_blur_is_refused(refused, shelf, tmp_path):
    write_tiff(tmp_path / "small.tif", np.eye(30), {})
    assert "smaller" in refused("simulate", "small.tif", "--table", "lab16mm", "--distance", "1 m", "-o", "a.tif")


# --- estimate ---


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
        (tmp_path / f"{name}.toml").write_text(RECIPE.replace('from = "1 m"', f'from = "{first}"'))
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
