"""Results of a comparison: what is written is read back, and other programs can read it."""

import numpy as np
import pytest

from psflut import results
from psflut.errors import PsflutError
from psflut.trial import Record


@pytest.fixture
def records():
    """Two methods on three runs at two distances; the second has seen but one of them."""
    rng = np.random.default_rng(3)

    def record(method, position, run):
        truth = (1.25, 1.0 / 3.0)[position]
        found = [float(z) for z in np.sort(truth + 0.01 * rng.standard_normal(3))]
        return Record(method, position, run, truth, "moon, full", 7 * run, 2, found[1], found[0], found[2], "ok", 0.125)

    seen = [("wiener", k, r) for k in (1, 0) for r in range(3)] + [("posterior:steps=9", 0, 2)]
    return [record(*each) for each in seen]


def without_seconds(records):
    """By position in the order of distance, and without what neither file holds."""
    truths = sorted({record.truth for record in records})
    return [record._replace(seconds=0, position=truths.index(record.truth)) for record in records]


@pytest.mark.parametrize("kind", ["csv", "zarr"])
def test_what_is_written_is_read_back_exactly(records, tmp_path, kind):
    path = tmp_path / f"results.{kind}"
    getattr(results, f"write_{kind}")(records, path, *([{"seed": 1}] if kind == "zarr" else []))
    assert without_seconds(getattr(results, f"read_{kind}")(path)) == without_seconds(records)
    results.write_csv(results.read_csv(path) if kind == "csv" else results.read_zarr(path), tmp_path / "again.csv")
    results.write_csv(records, tmp_path / "first.csv")
    assert (tmp_path / "again.csv").read_bytes() == (tmp_path / "first.csv").read_bytes()


def test_xarray_opens_the_zarr_with_names_and_units(records, tmp_path):
    import xarray

    results.write_zarr(records, tmp_path / "results.zarr", {"seed": 1})
    data = xarray.open_zarr(tmp_path / "results.zarr", consolidated=False)
    assert dict(data.sizes) == {"method": 2, "distance": 2, "run": 3}
    assert data.estimate.units == data.distance.units == "m"
    assert data.attrs["seed"] == 1
    one = data.sel({"method": "wiener", "distance": 1.25}).isel(run=2)
    (record,) = (r for r in records if (r.method, r.truth, r.run) == ("wiener", 1.25, 2))
    assert (float(one.estimate), str(one.outcome.values), int(one.corner_y)) == (record.estimate, "ok", 14)
    unseen = data.sel({"method": "posterior:steps=9", "distance": 1.25}).isel(run=0)
    assert np.isnan(unseen.estimate)
    assert str(unseen.outcome.values) == ""


def test_timings_have_a_file_of_their_own(records, tmp_path):
    results.write_csv(records, tmp_path / "results.csv")
    results.write_timings(records, tmp_path / "timings.csv")
    assert "seconds" not in (tmp_path / "results.csv").read_text()
    assert (tmp_path / "timings.csv").read_text().splitlines()[:2] == [
        "method,truth_m,run,seconds",
        f"wiener,{1 / 3},0,0.125",
    ]


@pytest.mark.parametrize("text", [None, "", "a,b\n1,2\n", "\0\xff"])
def test_what_is_no_results_is_refused(tmp_path, text):
    path = tmp_path / "results.csv"
    if text is not None:
        path.write_text(text)
    with pytest.raises(PsflutError, match="results"):
        results.read_csv(path)
    with pytest.raises(PsflutError, match="results"):
        results.read_zarr(path)


def test_a_damaged_number_is_refused(records, tmp_path):
    path = tmp_path / "results.csv"
    results.write_csv(records, path)
    path.write_text(path.read_text().replace("1.25", "1.2.5"))
    with pytest.raises(PsflutError, match="cannot read"):
        results.read_csv(path)
