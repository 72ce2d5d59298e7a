"""Figures of a comparison: what they hold, not how they look."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from psflut import capture, family, gallery, plots
from psflut.limits import bound
from psflut.noise import Noise
from psflut.optics import blur_radius
from psflut.shots import Simulated, between
from psflut.trial import Bench, Record, Unit, method, trial

TRUTHS = (1.5, 2.0, 2.5)


@pytest.fixture
def records(rng):
    """Two methods told nothing and one told the scene: 11 runs at each of three distances."""

    def record(name, k, run, error):
        z = TRUTHS[k] + error
        return Record(name, k, run, TRUTHS[k], "a", 0, 0, z, z - 0.05, z + 0.05, "ok", 0.25)

    names = ("golden_section", "wiener", "golden_section+scene")
    return [record(m, k, r, 0.1 * rng.standard_normal()) for m in names for k in range(3) for r in range(11)]


def line(axis, label):
    (found,) = (each for each in axis.lines if each.get_label() == label)
    return found


def of(records, name, truth):
    return np.array([r.estimate for r in records if (r.method, r.truth) == (name, truth)])


def test_agreement_shows_median_band_and_best_run_of_every_method(records):
    figure = plots.agreement(records)
    assert [axis.get_title() for axis in figure.axes if axis.lines] == [
        "golden_section, 11 runs", "wiener, 11 runs", "golden_section+scene, 11 runs",
    ]  # fmt: skip
    axis = figure.axes[1]
    runs = [of(records, "wiener", truth) for truth in TRUTHS]
    assert_allclose(line(axis, "median").get_ydata(), [np.median(each) for each in runs])
    nearest = [min(each, key=lambda z, truth=truth: abs(z - truth)) for truth, each in zip(TRUTHS, runs, strict=True)]
    assert_allclose(line(axis, "best run (thesis)").get_ydata(), nearest)
    corners = axis.collections[0].get_paths()[0].vertices[:, 1]
    assert corners.max() == pytest.approx(max(np.percentile(each, 95) for each in runs))
    assert "(m)" in figure.axes[0].get_ylabel()
    assert "(m)" in axis.get_xlabel()
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["truth", "5 to 95 % of the runs", "median", "best run (thesis)"]


def test_relative_errors_are_medians_and_the_baselines_best_has_its_own_line(records):
    (axis,) = plots.relative_errors(records).axes
    expected = [100 * np.median(np.abs(of(records, "wiener", z) - z)) / z for z in TRUTHS]
    assert_allclose(line(axis, "wiener").get_ydata(), expected)
    best = [100 * np.min(np.abs(of(records, "golden_section", z) - z)) / z for z in TRUTHS]
    assert_allclose(line(axis, "golden_section, best run (thesis)").get_ydata(), best)
    assert "% of the distance" in axis.get_ylabel()
    assert "% of the range" in plots.relative_errors(records, span=2.0).axes[0].get_ylabel()


def test_scatter_is_that_of_the_runs_and_shows_the_bound(records, lab16mm):
    limit = bound(lab16mm, (64, 64), Noise(0.005), family.parse("psflut.imagers", "plain"))
    (axis,) = plots.scatter(records, limit).axes
    expected = [100 * np.std(of(records, "wiener", z), ddof=1) for z in TRUTHS]
    assert_allclose(line(axis, "wiener").get_ydata(), expected)
    assert_allclose(line(axis, "Cramer-Rao bound, median contrast").get_ydata(), 100 * limit.crb)
    assert "(cm)" in axis.get_ylabel()
    assert len(plots.scatter(records).axes[0].lines) == 3


def test_reliability_has_coverage_width_and_risk_of_every_method(records):
    covers, width, risk = plots.reliability(records, 0.95).axes
    inside = [100 * np.mean(np.abs(of(records, "wiener", z) - z) <= 0.05) for z in TRUTHS]
    assert_allclose(line(covers, "wiener").get_ydata(), inside)
    assert_allclose(line(width, "wiener").get_ydata(), 10.0)
    assert len(risk.lines) == 3
    assert all(each.get_xdata()[-1] == 100 for each in risk.lines)
    assert "(cm)" in width.get_ylabel()
    assert all("%" in label for label in (covers.get_ylabel(), risk.get_xlabel(), risk.get_ylabel()))


def test_times_are_medians_of_every_method_in_a_figure_of_their_own(records):
    (axis,) = plots.times(records).axes
    assert [bar.get_width() for bar in axis.patches] == [0.25] * 3
    assert "(s)" in axis.get_xlabel()


def test_a_method_keeps_its_colour_when_told_the_scene(records):
    covers = plots.reliability(records, 0.95).axes[0]
    colours = {name: line(covers, name).get_color() for name in ("golden_section", "wiener", "golden_section+scene")}
    assert colours["golden_section"] == colours["golden_section+scene"] != colours["wiener"]


def test_transfer_functions_begin_at_one_and_geometric_optics_vanishes_where_theory_says(lab16mm):
    figure = plots.otfs(lab16mm, [1.0, 2.0])
    assert [axis.get_title() for axis in figure.axes] == ["geometric optics (2.5.5)", "Gaussian (2.5.7)", "this table"]
    for axis in figure.axes:
        assert "cycles/mm" in axis.get_xlabel()
        for each in axis.lines[:2]:
            assert each.get_ydata()[0] == pytest.approx(1.0)
    frequency, values = figure.axes[0].lines[0].get_data()
    zero = 3.8317 / (2 * np.pi * 1e3 * float(blur_radius(lab16mm.camera, 1.0)))  # first of J1, cycles/mm
    assert np.interp(zero, frequency, values) == pytest.approx(0.0, abs=0.01)
    table = figure.axes[2].lines[0].get_ydata()
    assert np.abs(table - values)[frequency < zero].max() < 0.1  # wave optics of a lens without aberration is near it


def test_filters_show_psf_and_kernel(thesis):
    imager = family.parse("psflut.imagers", thesis.imager)
    left, right = plots.filters(thesis, 4.0, imager).axes[:2]
    assert left.images[0].get_array().max() == pytest.approx(thesis.at(4.0).max())
    assert_allclose(right.images[0].get_array(), imager.kernel())
    assert all("(pixels)" in axis.get_xlabel() for axis in (left, right))


def test_the_gallery_has_every_figure_of_the_thesis_for_simulated_captures(lab16mm, scene, tmp_path):
    shots = Simulated(lab16mm, capture.Setup(noise="0.005"), [("scene", scene)], between(lab16mm, 2), 2, 64, 0)
    names = ("wiener", "golden_section:redraws=2:iterations=2+scene")
    bench = Bench(lab16mm, shots, {name: method(name) for name in names})
    records = [r for k in range(2) for run in range(2) for r in trial(bench, Unit(k, run, names))]
    paths = gallery.draw(bench, records, tmp_path / "figures")
    numbers = {path.name.partition("-")[0] for path in paths}
    assert numbers == {
        "2.5.3", "4.1.2", "4.2.2", "5.1.1", "5.1.2", "5.2.1", "5.2.2", "5.2.3", "5.2.4", "5.2.5", "5.2.6", "5.2.7",
        "reliability.png", "times.png",
    }  # fmt: skip
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in paths)
