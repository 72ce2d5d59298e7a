"""Manifests, camera files, recipes and options that say what cannot be: refused in a sentence that names them."""

import pytest

from calib.manifest import read_manifest
from calib.recipe import read_recipe
from psflut.camera_file import read_camera
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

CAMERA = 'focal_length = "16 mm"\nf_number = 2\nfocus_distance = "6 m"\npixel_pitch = "6 um"\n'


def camera(old="", new="", more=""):
    assert old in CAMERA
    return f"[camera]\n{CAMERA.replace(old, new)}{more}"


CAMERAS = {
    "empty": "",
    "no section": CAMERA,
    "another section": camera() + "[lens]\nname = 1\n",
    "camera a list": 'camera = ["16 mm"]\n',
    "camera text": 'camera = "16 mm"\n',
    "two cameras": camera() + camera(),
    "two sections of one name": "[[camera]]\n" + CAMERA + "[[camera]]\n" + CAMERA,
    "a key twice": camera(more='pixel_pitch = "6 um"\n'),
    "a misspelt key": camera("focal_length", "focal_lenght"),
    "a key too many": camera(more='colour = "red"\n'),
    "no focal length": camera('focal_length = "16 mm"\n'),
    "no pitch": camera('pixel_pitch = "6 um"\n'),
    "no aperture": camera("f_number = 2\n"),
    "no focus": camera('focus_distance = "6 m"\n'),
    "two apertures": camera(more='aperture_diameter = "8 mm"\n'),
    "two foci": camera(more='detector_distance = "17 mm"\n'),
    "a bare number": camera('"16 mm"', "16"),
    "no unit": camera('"16 mm"', '"16"'),
    "an unknown unit": camera('"16 mm"', '"16 inch"'),
    "a unit alone": camera('"16 mm"', '"mm"'),
    "two units": camera('"16 mm"', '"16 mm mm"'),
    "a comma": camera('"16 mm"', '"1,6 mm"'),
    "true": camera('"16 mm"', "true"),
    "a list": camera('"16 mm"', '["16 mm"]'),
    "a date": camera('"16 mm"', "2026-01-01"),
    "a negative length": camera('"16 mm"', '"-16 mm"'),
    "a length of zero": camera('"16 mm"', '"0 mm"'),
    "a length not a number": camera('"16 mm"', '"nan mm"'),
    "an infinite length": camera('"16 mm"', '"1e999 mm"'),
    "an infinite pitch": camera('"6 um"', '"inf um"'),
    "a pitch of zero": camera('"6 um"', '"0 um"'),
    "a focus inside the lens": camera('"6 m"', '"1 mm"'),
    "a focus at the focal length": camera('"6 m"', '"16 mm"'),
    "a detector before the focus": camera('focus_distance = "6 m"', 'detector_distance = "15 mm"'),
    "an f-number of zero": camera("f_number = 2", "f_number = 0"),
    "a negative f-number": camera("f_number = 2", "f_number = -2"),
    "an f-number of text": camera("f_number = 2", 'f_number = "f/2"'),
    "an infinite f-number": camera("f_number = 2", "f_number = inf"),
    "an f-number not a number": camera("f_number = 2", "f_number = nan"),
    "a wavelength of zero": camera(more='wavelength = "0 nm"\n'),
    "a wavelength without unit": camera(more="wavelength = 550\n"),
    "quotes without end": '[camera]\nfocal_length = "16 mm\n',
    "brackets without end": "[camera\n",
    "nested too deep": "a = " + "[" * 100_000,
    "keys nested too deep": "a." * 2_000 + "b = 1\n",
    "Latin-1": '[camera]\npixel_pitch = "6 \xb5m"\n'.encode("latin-1"),
    "UTF-16": camera().encode("utf-16"),
    "nulls": bytes(100),
    "nonsense": bytes(range(256)),
    "JSON": '{"camera": {"focal_length": "16 mm"}}',
}

TABLE = 'model = "gaussian"\ndistances = { from = "1 m", to = "3 m", count = 4 }\nsize = 41\n'


def recipe(old="", new="", more="", capture=""):
    assert old in TABLE
    return f"[camera]\n{CAMERA}[table]\n{TABLE.replace(old, new)}{more}{capture and '[capture]' + chr(10)}{capture}"


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

ESTIMATE = ["estimate", "image.tif", "--table", "lab16mm", "--noise", "0.01"]
SIMULATE = ["simulate", "image.png", "--table", "lab16mm", "--distance", "1.2 m", "-o", "o.tif"]
COMPARE = ["compare", "--table", "lab16mm", "--images", "camera", "--method", "wiener", "-o", "out"]
DEPTHMAP = ["depthmap", "image.tif", "--table", "lab16mm", "--noise", "0.01"]
LIMITS = ["limits", "--table", "lab16mm"]
MEASURE = ["calibrate", "captures.csv", "--target", "point", "--pixel-pitch", "6 um", "-o", "n.zarr"]
REPORT = ["report", "image.tif", "--table", "lab16mm", "-o", "r.html"]
BUILD = ["build", "recipe.toml"]
OPTIONS = [
    [*ESTIMATE, "--method", "magic"],
    [*ESTIMATE, "--method", ""],
    [*ESTIMATE, "--method", "wiener,"],
    [*ESTIMATE, "--method", "wiener:candidates=many"],
    [*ESTIMATE, "--method", "wiener:candidates=-5"],
    [*ESTIMATE, "--method", "wiener:candidates=1"],
    [*ESTIMATE, "--method", "wiener:candidates=1e99"],
    [*ESTIMATE, "--method", "wiener:candidates=1000000000"],
    [*ESTIMATE, "--method", "wiener:colour=red"],
    [*ESTIMATE, "--method", "posterior:steps=0"],
    [*ESTIMATE, "--method", "posterior:walkers=-1"],
    [*ESTIMATE, "--method", "posterior:seed=-1"],
    [*ESTIMATE, "--method", "golden_section:start=nowhere"],
    [*ESTIMATE, "--method", "golden_section:iterations=-1"],
    [*ESTIMATE, "--method", "blind_rl:iterations=0"],
    [*ESTIMATE, "--method", "two_image"],
    [*ESTIMATE, "--method", "../wiener"],
    [*ESTIMATE, "--level", "0"],
    [*ESTIMATE, "--level", "1"],
    [*ESTIMATE, "--level", "nan"],
    [*ESTIMATE, "--level", "-0.5"],
    [*ESTIMATE, "--level", "95"],
    [*ESTIMATE, "--patch", "0,0"],
    [*ESTIMATE, "--patch", "0,0,0"],
    [*ESTIMATE, "--patch", "-1,0,64"],
    [*ESTIMATE, "--patch", "60,60,64"],
    [*ESTIMATE, "--patch", "0,0,20"],
    [*ESTIMATE, "--patch", "0,0,99999999999999999999"],
    [*ESTIMATE, "--patch", "0,0,64x"],
    [*ESTIMATE, "--patch", "a,b,c"],
    [*ESTIMATE, "--gamma", "0"],
    [*ESTIMATE, "--gamma", "-2"],
    [*ESTIMATE, "--gamma", "nan"],
    [*ESTIMATE, "--gamma", "inf"],
    [*ESTIMATE, "--gamma", "2", "--srgb"],
    [*ESTIMATE, "--imager", "retina"],
    [*ESTIMATE, "--imager", "laplacian:lots"],
    [*ESTIMATE, "--imager", "laplacian:0.2:0.3:0.4"],
    [*ESTIMATE, "--imager", "dog:-1"],
    [*ESTIMATE, "--imager", "dog:1e9"],
    [*ESTIMATE, "--scene", "nothing.png"],
    [*ESTIMATE, "--scene", "point", "--method", "wiener"],
    [*ESTIMATE, "--second", "image.tif"],
    [*ESTIMATE, "--second-table", "lab16mm"],
    [*ESTIMATE, "--posterior", "chain.zarr"],
    [*ESTIMATE, "--posterior", "chain.txt", "--method", "posterior"],
    [*ESTIMATE[:-2], "--noise", "0"],
    [*ESTIMATE[:-2], "--noise", "-0.1"],
    [*ESTIMATE[:-2], "--noise", "nan"],
    [*ESTIMATE[:-2], "--noise", "inf"],
    [*ESTIMATE[:-2], "--noise", "loud"],
    [*ESTIMATE[:-2], "--noise", "relative:"],
    [*ESTIMATE[:-2], "--noise", "poisson:3"],
    ["estimate", "image.tif", "--table", "lab17mm"],
    ["estimate", "image.tif", "--table", ""],
    ["estimate", "", "--table", "lab16mm"],
    ["estimate", "a\0b", "--table", "lab16mm"],
    ["estimate", ".", "--table", "lab16mm"],
    ["estimate", "image.tif", "--table", "a\0b"],
    ["estimate", "image.tif", "--table", "x" * 5000],
    [*SIMULATE, "--distance", "1.2"],
    [*SIMULATE, "--distance", "far"],
    [*SIMULATE, "--distance", "99 m"],
    [*SIMULATE, "--distance", "-1 m"],
    [*SIMULATE, "--distance", "0 m"],
    [*SIMULATE, "--camera", "camera.toml"],
    [*SIMULATE, "--seed", "-1"],
    [*SIMULATE, "--seed", "1.5"],
    [*SIMULATE, "--bits", "0"],
    [*SIMULATE, "--bits", "99"],
    [*SIMULATE, "--gain", "-1"],
    [*SIMULATE, "--gain", "1000"],
    [*SIMULATE, "--gain", "0", "--noise", "0.1"],
    [*SIMULATE, "--gain", "1e300", "--noise", "0.1"],
    [*SIMULATE, "--noise", "-1"],
    [*SIMULATE, "-o", "o.jpg"],
    [*SIMULATE, "-o", "o"],
    [*SIMULATE, "-o", "nowhere/o.tif"],
    [*SIMULATE, "-o", "image.tif"],
    [*SIMULATE, "-o", "image.png"],
    [*SIMULATE, "-o", f"{'o' * 300}.tif"],
    [*SIMULATE, "-o", "a\0b.tif"],
    [*SIMULATE, "--ideal", "o.tif"],
    [*SIMULATE, "--ideal", "image.tif"],
    ["simulate", "image.png", "--camera", "camera.toml", "--distance", "1 mm", "-o", "o.tif"],
    [*COMPARE, "--runs", "-1"],
    [*COMPARE, "--distances", "0"],
    [*COMPARE, "--workers", "0"],
    [*COMPARE, "--level", "1"],
    [*COMPARE, "--images", "."],
    [*COMPARE, "--images", ""],
    [*COMPARE, "--images", "camera,,coins"],
    [*COMPARE, "--captures", "nothing.csv"],
    [*COMPARE, "-o", "image.tif"],
    [*COMPARE, "-o", "image.tif/out"],
    [*COMPARE, "--scheduler", "nowhere"],
    [*COMPARE, "--seed", "-4"],
    [*LIMITS, "--patch-size", "0"],
    [*LIMITS, "--patch-size", "5"],
    [*LIMITS, "--patch-size", "1000000"],
    [*LIMITS, "--contrast", "-1"],
    [*LIMITS, "--contrast", "0"],
    [*LIMITS, "--contrast", "nan"],
    [*LIMITS, "--scene", "blurry"],
    [*LIMITS, "-o", "bound.xyz"],
    [*LIMITS, "-o", "image.png"],
    [*MEASURE, "--target", "sphere"],
    [*MEASURE, "--target", "point:pinhole=-3"],
    [*MEASURE, "--target", "point:size=3"],
    [*MEASURE, "--target", "pattern"],
    [*MEASURE, "--reference", "image.tif"],
    [*MEASURE, "--size", "4"],
    [*MEASURE, "--size", "-3"],
    [*MEASURE, "--size", "100001"],
    [*MEASURE, "--camera", "camera.toml"],
    [*MEASURE, "--pixel-pitch", "6"],
    [*MEASURE, "--pixel-pitch", "-6 um"],
    [*MEASURE, "--pixel-pitch", "0 um"],
    [*MEASURE, "--dark", "nothing.tif"],
    [*MEASURE, "--dark", "nan"],
    [*MEASURE, "--dark", "2"],
    [*MEASURE, "--placement", "3"],
    [*MEASURE, "--placement", "-1 mm"],
    [*MEASURE, "--model", "magic"],
    [*MEASURE, "--planes", "2", "--model", "pupil"],
    [*MEASURE, "--planes", "9"],
    [*MEASURE, "--modes", "-1"],
    [*MEASURE, "--modes", "2"],
    [*MEASURE, "-o", "n.h5"],
    [*MEASURE, "-o", "t.zarr"],
    [*MEASURE, "-o", "nowhere/n.zarr"],
    [*MEASURE, "--figure", "nowhere/n.png"],
    [*MEASURE, "--figure", "image.png"],
    [*MEASURE],
    [*REPORT, "--seed", "-1"],
    [*REPORT, "-o", "r.txt"],
    [*REPORT, "-o", "nowhere/r.html"],
    [*REPORT, "--posterior", "chain.h5"],
    [*REPORT, "--patch", "0,0,3"],
    [*BUILD],
    [*BUILD, "-o", "t.zarr"],
    [*BUILD, "-o", "t.zarr.zip"],
    [*BUILD, "-o", "n.hdf5"],
    [*BUILD, "-o", "nowhere/n.zarr"],
    [*BUILD, "-o", "image.tif/n.zarr"],
    ["build", ".", "-o", "n.zarr"],
    ["build", "t.zarr.zip", "-o", "n.zarr"],
    ["build", "a\0b", "-o", "n.zarr"],
    ["target", "-o", "page.docx"],
    ["target", "-o", "page.png", "--size", "B7"],
    ["target", "-o", "page.png", "--seed", "-1"],
    ["target", "-o", "nowhere/page.png"],
    ["target", "-o", "image.png"],
    ["check", "t.zarr", "captures.csv"],
    ["check", "t.zarr", "nothing.csv", "--target", "point"],
    ["check", "t.zarr", "captures.csv", "--target", "point", "--gamma", "-1"],
    [*ESTIMATE, "--method", "posterior:walkers=1000000000"],
    [*ESTIMATE, "--method", "golden_section:seed=-1"],
    [*ESTIMATE[:-2], "--noise", "1e300"],
    [*ESTIMATE[:-2], "--noise", "1e-300"],
    ["simulate", "image.tif", *SIMULATE[2:-2], "-o", "image.tif", "--overwrite"],
    [*DEPTHMAP, "-o", "image.tif", "--overwrite"],
    [*DEPTHMAP, "-o", "m.zarr", "--size", "0"],
    [*DEPTHMAP, "-o", "m.zarr", "--pixel-pitch", "0 um"],
    [*COMPARE, "--distances", "1000000000"],
    [*COMPARE, "--runs", "1000000000"],
    [*COMPARE, "--captures", "captures.csv"],
    [*MEASURE, "--pixel-pitch", "6 mm"],
    [*MEASURE, "--target", "point:rounds=0"],
    [*MEASURE, "--target", "point:oversampling=1000"],
    [*MEASURE, "--figure", "n.png", "--check-figure", "n.png"],
    ["demo", "-o", "image.tif"],
    ["demo", "-o", "image.tif/out"],
]


@pytest.fixture
def corner(desk):
    """The desk with frames of the wrong kinds on it."""
    import os

    import imageio.v3 as iio
    import numpy as np

    iio.imwrite(desk / "image-small.png", np.zeros((32, 32), np.uint8))
    (desk / "circle.tif").symlink_to(desk / "circle.tif")
    (desk / "out.tif").symlink_to("/etc/hostname")
    os.mkfifo(desk / "pipe")
    return desk


def spoilt(desk, text):
    (desk / "spoilt").write_bytes(text if isinstance(text, bytes) else text.encode())
    return "spoilt"


@pytest.mark.parametrize("case", MANIFESTS)
def test_a_manifest_is_refused(refused, corner, case):
    words = ["calibrate", spoilt(corner, MANIFESTS[case]), "--target", "point", "--pixel-pitch", "6 um", "-o", "n.zarr"]
    assert "spoilt" in refused(*words)
    with pytest.raises(PsflutError, match="spoilt"):
        read_manifest(corner / "spoilt", least_positions=3)


@pytest.mark.parametrize("case", CAMERAS)
def test_a_camera_file_is_refused(refused, desk, case):
    words = ["simulate", "image.png", "--distance", "1.2 m", "-o", "o.tif", "--camera", spoilt(desk, CAMERAS[case])]
    assert "spoilt" in refused(*words)
    with pytest.raises(PsflutError, match="spoilt"):
        read_camera(desk / "spoilt")


@pytest.mark.parametrize("case", RECIPES)
def test_a_recipe_is_refused(refused, desk, case):
    assert "spoilt" in refused("build", spoilt(desk, RECIPES[case]), "-o", "n.zarr.zip")


@pytest.mark.parametrize("number", range(len(OPTIONS)))
def test_options_are_refused(refused, number):
    refused(*OPTIONS[number])


def test_distances_within_the_focal_length_are_of_another_unit(refused, desk):
    (desk / "captures.csv").write_text(ROWS.replace("distance_m", "distance_mm"))
    words = ["calibrate", "captures.csv", "--target", "point", "--camera", "camera.toml", "-o", "n.zarr"]
    assert "check the unit" in refused(*words)


def test_the_control_whole_texts_are_read(desk):
    assert len(read_manifest(desk / spoilt(desk, ROWS), least_positions=3).rows) == 3
    assert read_camera(desk / spoilt(desk, camera())).f_number == pytest.approx(2)
    assert read_camera(desk / spoilt(desk, "\ufeff" + camera().replace("\n", "\r\n"))).f_number == pytest.approx(2)
    assert read_recipe(desk / spoilt(desk, recipe())).size == 41
