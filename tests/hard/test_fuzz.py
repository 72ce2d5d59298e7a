"""Whatever a manifest, a TOML file or a table holds: it is read, or refused by `PsflutError`, never anything else.

    python -m pytest -m campaign tests/hard/test_fuzz.py -s        # ten minutes

Inputs that once broke a reader stand in `test_bad_manifests`, `test_bad_images`, `test_bad_folders` and their like.
"""

import collections
import json
import shutil
import time

import pytest
from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st

from calib.manifest import read_manifest
from calib.recipe import read_recipe
from psflut import layout, store
from psflut.camera_file import read_camera
from psflut.errors import PsflutError

CAMERA = '[camera]\nfocal_length = "16 mm"\nf_number = 2\nfocus_distance = "6 m"\npixel_pitch = "6 um"\n'
RECIPE = CAMERA + '[table]\nmodel = "pupil"\ndistances = { from = "1 m", to = "3 m", count = 4 }\nsize = 41\n'
RECIPE += 'zernikes = [[4, 0, 0.2]]\n[capture]\nimager = "laplacian:0.5"\nnoise = "relative:1e-3"\ngain = 9.0\n'
ROWS = "file,page,x,y,distance_m\n0.tif,0,3,4,1.1\n1.tif,,,,1.6\n2.tif,0,5,5,2.9\n"

WORDS = st.sampled_from(
    [
        *[
            "0",
            "-1",
            "1e400",
            "nan",
            "inf",
            "1_0",
            "999999999999999999999",
            "0x10",
            "true",
            "null",
            "[]",
            "{}",
            ",",
            ";",
            ":",
            "=",
            ".",
            "..",
            "/",
            "\\",
            "[",
            "]",
            "{",
            "}",
            "#",
        ],
        *[
            '""',
            "''",
            '"',
            "'",
            "µm",
            "m",
            "mm",
            "file",
            "page",
            "x",
            "y",
            "distance_m",
            "stage_um",
            "camera",
            "table",
            "capture",
            "from",
            "to",
            "count",
            "size",
            "model",
        ],
        *[
            "__class__",
            "../x",
            "psf",
            "zarr_format",
            "node_type",
            "codecs",
            "shape",
            "chunk_grid",
            "fill_value",
            "float32",
            "NaN",
            "Infinity",
        ],
        *("\n", "\r", "\0", "\ufeff", "\u00b2", "\u0661", "\ud7ff"),
    ]
)
ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | WORDS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8) | WORDS, inner, max_size=4),
    max_leaves=6,
)
CUT = st.tuples(st.floats(0, 1), st.integers(0, 30), WORDS.map(str.encode) | st.binary(max_size=12))
CUTS = st.lists(CUT, min_size=1, max_size=4)


def cut(data, cuts):
    """The bytes with a few stretches replaced."""
    for place, length, new in cuts:
        at = int(place * len(data))
        data = data[:at] + new + data[at + length :]
    return data


tried = collections.Counter()


def read(reader, path):
    """Read or be refused in one sentence that names the file."""
    tried[f"{reader.__name__} tried"] += 1
    try:
        reader(path)
    except PsflutError as error:
        tried[f"{reader.__name__} refused"] += 1
        assert path.name in str(error)  # noqa: PT017
        assert "Traceback" not in str(error)  # noqa: PT017


def manifest(desk, cuts):
    (desk / "fuzz.csv").write_bytes(cut(ROWS.encode(), cuts))
    read(read_manifest, desk / "fuzz.csv")


def toml(desk, cuts):
    (desk / "fuzz.toml").write_bytes(cut(RECIPE.encode(), cuts))
    read(read_recipe, desk / "fuzz.toml")
    (desk / "fuzz.toml").write_bytes(cut(CAMERA.encode(), cuts))
    read(read_camera, desk / "fuzz.toml")


def archive(desk, cuts):
    (desk / "fuzz.zarr.zip").write_bytes(cut((desk / "t.zarr.zip").read_bytes(), cuts))
    read(store.read_table, desk / "fuzz.zarr.zip")


def metadata(desk, cuts):
    """A zarr.json cut: of the group, or of an array by the first cut's place."""
    with _folder(desk) as path:
        files = sorted(path.rglob("zarr.json"))
        file = files[int(cuts[0][0] * len(files)) % len(files)]
        file.write_bytes(cut(file.read_bytes(), cuts))
        read(store.read_table, path)


def attribute(desk, change):
    """An attribute of the group that is anything, its checksum mended; or a key of an array's metadata."""
    (where, key), value = change
    with _folder(desk) as path:
        file = path / where / "zarr.json"
        found = json.loads(file.read_text())
        (found if where else found["attributes"])[key] = value
        if not where and isinstance(found["attributes"]["sha256"], dict):
            found["attributes"]["sha256"]["attributes"] = layout.sums({}, found["attributes"])["attributes"]
        file.write_text(json.dumps(found))
        read(store.read_table, path)


class _folder:
    def __init__(self, desk):
        self.path = desk / "fuzz.zarr"
        shutil.copytree(desk / "t.zarr", self.path)

    def __enter__(self):
        return self.path

    def __exit__(self, *_):
        shutil.rmtree(self.path)


KEYS = [
    ("", name) for name in ("axis", "camera", "imager", "noise", "provenance", "check", "sha256", "version", "format")
]
KEYS += [("psf", name) for name in ("shape", "data_type", "chunk_grid", "codecs", "fill_value", "dimension_names")]
KEYS += [("distance", "storage_transformers"), ("x", "chunk_key_encoding"), ("y", "node_type"), ("psf", "attributes")]
KINDS = {
    "manifest": (manifest, CUTS),
    "toml": (toml, CUTS),
    "archive": (archive, CUTS),
    "metadata": (metadata, CUTS),
    "attribute": (attribute, st.tuples(st.sampled_from(KEYS), ANYTHING)),
}


def fuzz(kind, desk, examples, number):
    spoil, strategy = KINDS[kind]

    @seed(number)
    @settings(
        max_examples=examples, deadline=None, database=None, suppress_health_check=list(HealthCheck), print_blob=False
    )
    @given(strategy)
    def run(made):
        spoil(desk, made)

    run()


@pytest.mark.parametrize("kind", KINDS)
def test_readers_read_or_refuse(kind, desk):
    fuzz(kind, desk, 40, 1)


@pytest.mark.campaign
def test_ten_minutes(desk):
    tried.clear()
    until, number = time.monotonic() + 600, 100
    while time.monotonic() < until:
        for kind in KINDS:
            number += 1
            fuzz(kind, desk, 200, number)
    print(f"fuzz: {dict(tried)}")
