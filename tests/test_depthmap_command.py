"""`psflut depthmap`: its files, its refusals, and that a run which was stopped goes on."""

import json
import warnings
from dataclasses import fields, replace

import numpy as np
import pytest
import tifffile

from psflut import capture, mapping, store
from psflut.batch import Batch
from psflut.frames import frames
from psflut.noise import Noise
from psflut.unfinished import Kept, settings
from psflut.writing import write_tiff

WORDS = ("--table", "lab16mm", "--noise", "0.005", "--stride", "64")


@pytest.fixture(scope="module")
def taken(lab16mm, scene):
    return capture.simulate(scene, lab16mm, 1.63, capture.Setup(noise="0.005"), 1)[0][:128, :192].astype(np.float32)


@pytest.fixture
def file(taken, tmp_path):
    path = tmp_path / "in" / "capture.tif"
    path.parent.mkdir()
    write_tiff(path, taken, {})
    return path


def test_a_map_in_three_formats(run, file, tmp_path, capsys):
    outputs = [tmp_path / f"map.{kind}" for kind in ("zarr", "tif", "png")]
    assert run("depthmap", file, *WORDS, "--smooth", "--json", *(w for path in outputs for w in ("-o", path))) == 0
    records = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [(r["y"], r["x"]) for r in records] == [(y, x) for y in (31.5, 95.5) for x in (31.5, 95.5, 159.5)]
    xarray = pytest.importorskip("xarray", reason="xarray is not installed: pip install psflut[lab]")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # zarr's note on numcodecs
        data = xarray.open_zarr(outputs[0], consolidated=False).load()
    assert data.distance.dims == ("y", "x")
    assert data.distance.attrs["units"] == data.near_wide.attrs["units"] == "m"
    assert data.distance.values.ravel().tolist() == [r["distance_m"] for r in records]
    assert data.outcome.attrs["flag_meanings"].split()[int(data.outcome[0, 0])] == records[0]["outcome"]
    pages = tifffile.imread(outputs[1])
    assert pages.dtype == np.float32
    flat = np.array([r["outcome"] == "flat" for r in records]).reshape(2, 3)
    np.testing.assert_allclose(pages[0], data.distance.where(~flat), rtol=1e-6)
    assert np.all((pages[3] <= pages[1]) & (pages[2] <= pages[4]) | flat)
    assert description(outputs[1], 5)["page"] == "distance_smooth"
    assert outputs[2].stat().st_size > 10_000
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in", "map.png", "map.tif", "map.zarr"]


def description(path, page):
    with tifffile.TiffFile(path) as file:
        return json.loads(file.pages[page].description)


def frames_of(kind, taken, folder):
    """The same two frames as a stack, a folder, an array."""
    both = np.stack([taken, taken[::-1]])
    if kind == "folder":
        for k, frame in enumerate(both):
            write_tiff(folder / f"{k}.tif", frame, {})
        return folder
    path = folder / f"frames.{kind}"
    if kind == "tif":
        tifffile.imwrite(path, both, photometric="minisblack")
    elif kind == "npy":
        np.save(path, both)
    else:
        import zarr

        zarr.save_array(path, both)
    return path


@pytest.mark.parametrize("kind", ["tif", "folder", "npy", "zarr"])
def test_sequences_have_a_time_axis(run, taken, tmp_path, kind):
    source = tmp_path / "in"
    source.mkdir()
    assert run("depthmap", frames_of(kind, taken, source), *WORDS, "--rate", "20", "-o", tmp_path / "map.tif") == 0
    pages = tifffile.imread(tmp_path / "map.tif")
    assert pages.shape == (10, 2, 3)
    assert description(tmp_path / "map.tif", 5)["frame"] == 1
    np.testing.assert_allclose(pages[5][::-1], pages[0], rtol=0.2)  # the same patches upside down


def test_a_run_that_was_stopped_goes_on(run, file, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(mapping, "PATCHES", 1)
    solved, whole = [], mapping.solve

    def solve(job, piece, threads=1):
        if len(solved) == 1:
            raise KeyboardInterrupt
        solved.append(piece)
        return whole(job, piece, threads)

    monkeypatch.setattr(mapping, "solve", solve)
    words = ("depthmap", file, *WORDS, "-o", tmp_path / "map.tif")
    assert run(*words) == 130
    assert "1 of 2 pieces are done" in capsys.readouterr().err
    for other in (("--level", "0.5"), ("--gamma", "1.1")):
        assert run(*words, *other) == 2
        assert "unfinished map of other settings" in capsys.readouterr().err
    solved.append(None)  # no more interruptions
    assert run(*words) == 0
    assert [piece.first for piece in solved if piece] == [0, 1]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in", "map.tif"]


def test_a_map_goes_on_only_where_all_that_decides_is_the_same(taken, lab16mm, tmp_path):
    def found(table=lab16mm, **encoding):
        sequence = frames([str(tmp_path)], **encoding)
        return settings(mapping.plan(sequence, table, 64, 64, Noise(0.005), None, 0.95), sequence)

    frames_of("folder", taken, tmp_path)
    one = found()
    assert found() == one
    assert one not in (found(gamma=2.0), found(srgb=True))
    assert found(replace(lab16mm, axis_std=np.full(len(lab16mm.axis), 0.01))) != one
    picture = tmp_path / "1.tif"
    picture.write_bytes(picture.read_bytes() + b"x")  # the folder itself stays as old as it was
    assert found() != one


def test_a_damaged_piece_is_worked_out_again(tmp_path):
    piece, batch = mapping.Piece(0, 0, 1), Batch(*(np.arange(3.0) for _ in fields(Batch)))
    kept = Kept(tmp_path / "kept", {})
    kept.keep(piece, batch)
    assert np.array_equal(kept.done(piece).distance, batch.distance)
    raw = kept.path(piece).read_bytes()
    for damaged in (raw[:-9], raw[:200] + b"x" + raw[201:], b""):
        kept.path(piece).write_bytes(damaged)
        assert kept.done(piece) is None


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--stride", "0"), "stride of at least 1 pixel"),
        (("--size", "32"), "smaller than the table's PSF"),
        (("--size", "200"), "smaller than a patch of 200"),
        (("--pixel-pitch", "5.5 um"), "the images have pixels of 5.5 um, the table of 6 um"),
        (("--pixel-pitch", "6"), "a length is a number with a unit"),
        (("-o", "map.jpg"), "a map's name ends in .zarr"),
        (("-o", "none/map.tif"), "is not a folder"),
        (("-o", "in/capture.tif"), "exists; choose another name or pass --overwrite"),
        (("-o", "map.tif", "-o", "map.tif"), "two outputs have one name"),
        (("--noise", "-1"), "noise must be positive"),
        (("--imager", "nothing"), "nothing"),
        (("--scheduler", "no address"), "no Dask scheduler answers"),
        (("--rate", "0"), "a rate is a positive number"),
        (("in/none.tif",), "no image file"),
        (("in/small.tif",), "frames must have one shape"),
        (("in/small.tif", "-o", "map.png"), "frames must have one shape"),
        (("in/capture.tif", "-o", "map.png"), "can show one frame, not 2"),
    ],
)
def test_refusals_are_one_sentence_and_leave_nothing(run, file, tmp_path, monkeypatch, capsys, words, sentence):
    monkeypatch.chdir(tmp_path)
    write_tiff(file.with_name("small.tif"), np.ones((70, 70)), {})
    before = sorted(tmp_path.rglob("*"))
    assert run("depthmap", file, *WORDS, *words) == 2
    said = capsys.readouterr()
    assert sentence in said.err
    assert said.err.count("\n") == 1
    assert not said.out
    assert sorted(tmp_path.rglob("*")) == before


def test_noise_that_nobody_knows_is_estimated_once_and_said(run, file, capsys):
    assert store.read_table("lab16mm").noise is None
    assert run("depthmap", file, "--table", "lab16mm", "--stride", "64") == 0
    said = capsys.readouterr()
    assert "is estimated from" in said.err
    assert "2 x 3" in said.out
