"""`psflut compare`: what it leaves in its folder, real frames, and what it refuses."""

import csv

import numpy as np
import pytest

from psflut import capture, gallery
from psflut.results import read_csv, read_zarr
from psflut.writing import write_tiff

FAST = ("--table", "lab16mm", "--distances", 2, "--runs", 2, "--size", 64, "--images", "camera", "--workers", 1)
METHODS = ("--method", "wiener,golden_section:redraws=2:iterations=3")


@pytest.fixture(scope="module")
def frames(tmp_path_factory, lab16mm, scene):
    """A manifest of frames at 1.21 and 2.03 m, 96 pixels a side."""
    folder = tmp_path_factory.mktemp("frames")
    rows = ["file,distance_m"]
    for k, distance in enumerate((1.21, 1.21, 2.03)):
        image, _ = capture.simulate(scene, lab16mm, distance, capture.Setup(noise="0.003"), seed=k)
        write_tiff(folder / f"{k}.tif", image[64:160, 64:160], {})
        rows.append(f"{k}.tif,{distance}")
    (folder / "captures.csv").write_text("\n".join(rows))
    return folder / "captures.csv"


@pytest.fixture(autouse=True)
def drawn(monkeypatch):
    """Folders in which figures would be drawn, which takes seconds; tests/test_plots_comparison.py draws them."""
    folders = []
    monkeypatch.setattr(gallery, "draw", lambda bench, records, folder: folders.append(folder.absolute()))
    return folders


def test_a_comparison_leaves_results_timings_and_a_summary(psflut, drawn, tmp_path):
    code, out, err = psflut("compare", *FAST, *METHODS, "-o", "out")
    assert code == 0, err
    records = read_csv(tmp_path / "out" / "results.csv")
    assert len(records) == 2 * 2 * 2
    assert [r._replace(seconds=0) for r in read_zarr(tmp_path / "out" / "results.zarr")] == [
        r._replace(seconds=0) for r in records
    ]
    assert drawn == [tmp_path / "out" / "figures"]
    assert len((tmp_path / "out" / "timings.csv").read_text().splitlines()) == 9
    with (tmp_path / "out" / "summary.csv").open() as file:
        summary = {row["method"]: row for row in csv.DictReader(file)}
    errors = [abs(r.estimate - r.truth) for r in records if r.method == "wiener"]
    assert float(summary["wiener"]["median_error_m"]) == pytest.approx(np.median(errors), rel=1e-3)
    assert all(name in out and name in (tmp_path / "out" / "summary.md").read_text() for name in summary)
    assert psflut("compare", *FAST, *METHODS, "-o", "out")[:2] == (0, out)  # nothing is left to do


def test_real_frames_are_read_where_they_lie(psflut, frames, tmp_path):
    code, _, err = psflut(
        "compare",
        "--table",
        "lab16mm",
        "--captures",
        frames,
        "--method",
        "wiener",
        "--size",
        80,
        "--workers",
        1,
        "-o",
        "o",
    )
    assert code == 0, err
    records = read_csv(tmp_path / "o" / "results.csv")
    assert [(r.truth, r.run, r.source, r.corner_y, r.corner_x) for r in records] == [
        (1.21, 0, "0.tif", 8, 8),
        (1.21, 1, "1.tif", 8, 8),
        (2.03, 0, "2.tif", 8, 8),
    ]
    assert all(abs(r.estimate / r.truth - 1) < 0.1 for r in records)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--method", "wienr"], "choose one of"),
        (["--method", "two_image"], "second image"),
        (["--method", "wiener+scene"], "does not use a known scene"),
        (["--images", "no-such-folder"], "folder of pictures"),
        (["--size", "31"], "larger --size"),
        (["--size", "999"], "--size"),
        (["--noise", "-1"], "positive"),
        (["--imager", "retina"], "retina"),
        (["--runs", "0"], "--runs"),
        (["-o", "/dev/null/out"], "choose another"),
    ],
)
def test_what_cannot_be_compared_is_refused(refused, words, sentence):
    assert sentence in refused("compare", *FAST, "-o", "out", *words)


CAMERA = '[camera]\nfocal_length = "16 mm"\nf_number = 2\nfocus_distance = "6 m"\npixel_pitch = "5 um"\n'


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--camera", "other.toml"], "pixels of 5 um, the table of 6 um"),
        (["--size", "128"], "another --size"),
        (["--table", "thesis"], "outside the table"),
        (["--method", "golden_section+scene"], "real frames"),
    ],
)
def test_frames_that_do_not_fit_the_table_are_refused(refused, frames, tmp_path, words, sentence):
    (tmp_path / "other.toml").write_text(CAMERA)
    common = ["--table", "lab16mm", "--captures", frames, "--size", 64, "--method", "wiener", "-o", "out"]
    assert sentence in refused("compare", *common, *words)
