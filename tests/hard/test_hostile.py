"""Files that were made to harm: nothing is run, nothing outside is opened, nothing becomes markup."""

import ast
import os
import re
import zipfile
from html import unescape
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import psflut
from calib.manifest import read_manifest
from calib.planes import Planes
from psflut import layout, store
from psflut.container import LARGEST
from psflut.errors import PsflutError
from psflut.files import arrays_in
from psflut.reporting import report
from psflut.table import PSFTable

ROOT = Path(psflut.__file__).parent.parent
RUNS_CODE = {"eval", "exec", "compile", "__import__", "execfile"}
RUNS_CODE |= {"pickle", "cPickle", "dill", "joblib", "marshal", "shelve", "yaml", "subprocess"}
RUNS_METHODS = {("os", "system"), ("os", "popen"), ("np", "fromfile"), ("zipfile", "extractall")}


def dangers(text):
    """Names in a source that run what a file holds."""
    found = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Name) and node.id in RUNS_CODE:
            found.append(node.id)
        if isinstance(node, ast.Import | ast.ImportFrom):
            names = [alias.name for alias in node.names] + [getattr(node, "module", None) or ""]
            found += [name for name in names if name.split(".")[0] in RUNS_CODE]
        if isinstance(node, ast.Attribute):
            owner = node.value.id if isinstance(node.value, ast.Name) else ""
            found += [node.attr] if (owner, node.attr) in RUNS_METHODS or node.attr == "extractall" else []
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "load":
            keys = {key.arg: key.value for key in node.keywords}
            of_numpy = isinstance(node.func.value, ast.Name) and node.func.value.id in ("np", "numpy")
            allow = keys.get("allow_pickle", ast.Constant(False))
            safe = isinstance(allow, ast.Constant) and allow.value is False
            found += ["np.load"] if of_numpy and not safe else []
    return found


def test_no_source_runs_what_a_file_holds():
    for file in [*ROOT.glob("psflut/**/*.py"), *ROOT.glob("calib/**/*.py")]:
        assert not dangers(file.read_text(encoding="utf-8")), file


@pytest.mark.parametrize(
    "text",
    ["eval('1')", "import pickle", "from yaml import load", "np.load('a', allow_pickle=True)", "z.extractall()"],
)
def test_the_control_a_danger_is_seen(text):
    assert dangers(text)


class Bomb:
    """What would run if it were ever unpickled."""

    def __reduce__(self):
        return os.mkdir, ("gone-off",)


def test_a_pickle_among_kept_planes_is_not_opened(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    kept = Planes(tmp_path)
    kept.get(["a"], lambda: {"psf": np.zeros(3)})
    (file,) = tmp_path.glob("*.npz")
    np.savez(file, psf=np.array([Bomb()], dtype=object))
    np.testing.assert_array_equal(kept.get(["a"], lambda: {"psf": np.ones(3)})["psf"], np.ones(3))
    assert not (tmp_path / "gone-off").exists()


def test_arrays_on_disk_that_are_damaged_anywhere_are_none_or_whole(tmp_path):
    file, rng, whole = tmp_path / "kept.npz", np.random.default_rng(0), np.arange(50.0)
    np.savez(file, psf=whole)
    raw, seen = file.read_bytes(), set()
    for place in range(len(raw)):
        spoilt = bytearray(raw)
        spoilt[place] ^= 1 << int(rng.integers(8))
        file.write_bytes(spoilt)
        found = arrays_in(file)
        seen.add(found is None or np.array_equal(found["psf"], whole))
    assert seen == {True}


@pytest.mark.parametrize("name", ["../evil", "/tmp/evil", "a/../../evil", "..\\evil", "C:\\evil"])
def test_nothing_leaves_an_archive(desk, name):
    with zipfile.ZipFile(desk / "t.zarr.zip", "a") as archive:
        archive.writestr(name, "evil")
    with pytest.raises(PsflutError, match="leads out"):
        store.read_table(desk / "t.zarr.zip")
    assert not list(desk.parent.rglob("evil"))


@pytest.mark.parametrize("name", ["../secret.tif", "link.tif", "deeper/link/secret.tif"])
def test_nothing_outside_a_manifests_folder_is_opened(desk, name, monkeypatch):
    outside = desk.parent / "secret.tif"
    outside.write_bytes((desk / "0.tif").read_bytes())
    (desk / "link.tif").symlink_to(outside)
    (desk / "deeper").mkdir()
    (desk / "deeper" / "link").symlink_to(desk.parent)
    (desk / "captures.csv").write_text(f"file,distance_m\n{name},1\n0.tif,2\n1.tif,3\n")
    with pytest.raises(PsflutError, match="folder"):
        read_manifest(desk / "captures.csv")
    outside.unlink()


def test_a_table_that_claims_to_be_huge_asks_for_no_memory(desk, little_memory):
    file = desk / "t.zarr" / "psf" / "zarr.json"
    file.write_text(re.sub(r'"shape":\s*\[[^]]*\]', '"shape":[100000,1001,1001]', file.read_text(), count=1))
    with little_memory(), pytest.raises(PsflutError, match=str(LARGEST)):
        store.read_table(desk / "t.zarr")


HOSTILE = "<img src=x onerror=alert(1)>\"'&{{ 7 * 7 }}</title><script>"


class Tags(HTMLParser):
    """Every tag of a page, and its attributes."""

    def __init__(self):
        super().__init__()
        self.tags, self.attributes = set(), set()

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.attributes |= {name for name, _ in attrs}


def test_names_and_metadata_stay_words_in_a_report(lab16mm, lab_patch, monkeypatch):
    """Every text that a table, an image or an option brings along is hostile."""
    from dataclasses import replace

    from psflut import reporting
    from psflut.estimation import Observation, estimate

    monkeypatch.setattr(reporting, "for_any_scene", lambda: ("posterior",))
    monkeypatch.setattr(reporting, "estimate", lambda seen, table, part: estimate(seen, table, replace(part, steps=80)))

    def page(word):
        made = {**lab16mm.provenance, "target": word, "used": [1], "rejected": [word], "frames": word, word: word}
        made |= {"recipe_sha256": word, "captures_sha256": word, "psflut": word, "date": 0, "noise_unknown": word}
        table = replace(lab16mm, provenance=made)
        about = {"image": word, "table": word, "patch": word, word: word}
        return report(Observation(lab_patch), table, name=word, about=about).html

    control = Tags()
    control.feed(f"<p>{HOSTILE}</p>")
    assert "script" in control.tags  # as it would be without escapes
    html, seen = page(HOSTILE), Tags()
    seen.feed(html)
    assert not seen.tags & {"script", "iframe", "object", "embed", "form"}
    assert not {name for name in seen.attributes if name.startswith("on")}
    assert HOSTILE not in html
    assert unescape(html).count(HOSTILE) > 5


def test_a_table_with_hostile_words_is_still_a_table(small, tmp_path):
    table = PSFTable(**{**vars(small), "provenance": {HOSTILE: HOSTILE}})
    store.write_table(table, tmp_path / "t.zarr.zip")
    assert store.read_table(tmp_path / "t.zarr.zip").provenance[HOSTILE] == HOSTILE
    assert layout.attributes_of(table)["provenance"][HOSTILE] == HOSTILE
