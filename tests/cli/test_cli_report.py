"""`psflut report` and `--posterior`: their contract."""

import numpy as np
import pytest

from psflut import Noise, reporting
from psflut.estimation import Observation, estimate
from psflut.images import read_image

WORDS = ("--table", "lab16mm", "--noise", "0.003", "--patch", "96,96,64")


@pytest.fixture(autouse=True)
def two_methods(monkeypatch):
    monkeypatch.setattr(reporting, "for_any_scene", lambda: ("posterior", "wiener"))


def test_a_page_and_its_chain(psflut, shelf, tmp_path):
    capture = tmp_path / "a&b.tif"
    capture.write_bytes((shelf / "capture.tif").read_bytes())
    words = ("report", capture, *WORDS, "--seed", "2", "-o", "page.html", "--posterior", "chain.nc")
    code, out, err = psflut(*words)
    assert code == 0, err
    page = (tmp_path / "page.html").read_text()
    assert "a&amp;b.tif" in page
    assert "96,96,64" in page
    assert out.splitlines()[1].split()[1] == "posterior"
    assert "exists" in psflut(*words)[2]


@pytest.mark.parametrize("name", ["chain.nc", "chain.zarr"])
@pytest.mark.filterwarnings("ignore:.*ArviZ is undergoing a major refactor:FutureWarning")
def test_the_chain_comes_back_as_it_was(psflut, shelf, lab16mm, tmp_path, name):
    import xarray

    code, _, err = psflut(
        "estimate", shelf / "capture.tif", *WORDS, "--method", "wiener,posterior:steps=60:seed=4", "--posterior", name
    )
    assert code == 0, err
    patch = read_image(shelf / "capture.tif").image[96:160, 96:160]
    found = estimate(Observation(patch, Noise(0.003)), lab16mm, "posterior:steps=60:seed=4")
    tree = xarray.open_datatree(tmp_path / name, engine="zarr" if name.endswith("zarr") else "h5netcdf")
    chain = found.detail["chain"]
    assert tree["posterior"].attrs["inference_library"] == "emcee"
    assert tree["posterior"]["distance"].attrs["units"] == "m"
    np.testing.assert_array_equal(tree["posterior"]["vergence"].transpose("draw", "chain"), chain[:, :, 0])
    waves = [("theta", "coefficient"), ("alpha", "turn"), ("beta", "turn"), ("gamma", "turn")]
    scene = [tree["posterior"][wave].transpose("draw", "chain", number) for wave, number in waves]
    np.testing.assert_array_equal(np.concatenate(scene, axis=2), chain[:, :, 1:])
    drawn = tree["posterior"]["distance"].transpose("draw", "chain").to_numpy().ravel()
    np.testing.assert_array_equal(drawn, found.detail["distances"])
    np.testing.assert_array_equal(tree["observed_data"]["power"], found.detail["prediction"].power)
    assert set(tree.children) == {"posterior", "sample_stats", "posterior_predictive", "observed_data", "constant_data"}
    assert tree.attrs["distance_m"] == found.distance
    assert '"lab16mm"' in tree.attrs["about"]
    arviz = pytest.importorskip("arviz", reason="no ArviZ")
    old = arviz.__version__.startswith("0.")
    opened = arviz.InferenceData.from_datatree(tree) if old else arviz.convert_to_datatree(tree)
    row = arviz.summary(opened, var_names=["distance"]).loc["distance"]
    assert row["mean"] == pytest.approx(found.distance, abs=0.01)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["report", "{capture}", "-o", "page.pdf"], ".html"),
        (["report", "{capture}", "-o", "missing/page.html"], "missing"),
        (["report", "missing.tif", "-o", "page.html"], "missing.tif"),
        (["report", "{capture}", "-o", "page.html", "--posterior", "chain.csv"], "chain.csv"),
        (["report", "{capture}", "-o", "page.html", "--imager", "laplace"], "laplacian"),
        (["estimate", "{capture}", "--posterior", "chain.nc"], "posterior"),
        (["estimate", "{capture}", "{capture}", "--method", "posterior", "--posterior", "chain.nc"], "one image"),
    ],
)
def test_a_mistake_is_refused_before_the_work(refused, shelf, words, sentence):
    command, *rest = [word.format(capture=shelf / "capture.tif") for word in words]
    assert sentence in refused(command, *rest, *WORDS)


def test_a_small_patch_is_refused(refused, shelf):
    words = ("--table", "lab16mm", "--patch", "0,0,20", "-o", "page.html")
    assert "smaller than the table's PSF" in refused("report", shelf / "capture.tif", *words)
