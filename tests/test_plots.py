"""What figures hold, not how they look."""

import numpy as np
import pytest

from psflut import plots
from psflut.estimation import Curve, Estimate, Outcome


@pytest.fixture
def estimates():
    positions = np.linspace(1, 2, 20)
    curve = Curve(positions, -((positions - 1.5) ** 2) * 100, "log evidence")
    cost = Curve(positions, 0.1 + (positions - 1.5) ** 2, "cost (4.2.7)")
    samples = np.random.default_rng(0).normal(1.5, 0.01, 500)
    return {
        "grid": [Estimate(1.5, (1.4, 1.6), 0.95, curve=curve)] * 2,
        "search": [Estimate(1.3, (1.2, 1.6), 0.95, Outcome.AT_EDGE, curve=cost)] * 2,
        "chain": [Estimate(1.5, (1.48, 1.52), 0.95, detail={"distances": samples})] * 2,
    }


def test_curves_show_truth_estimate_and_interval_in_every_panel(estimates):
    figure = plots.curves(estimates, [1.45, 1.55])
    assert len(figure.axes) == 6
    for axis, truth in zip(figure.axes, [1.45, 1.55] * 3, strict=True):
        lines = [line.get_xdata()[0] for line in axis.lines]
        assert truth in lines
        assert axis.get_ylabel()
    assert all("(m)" in axis.get_xlabel() for axis in figure.axes[-2:])
    assert any("at_edge" in text.get_text() for text in figure.axes[2].texts)


def test_one_capture_puts_the_methods_side_by_side(estimates):
    figure = plots.curves({name: found[:1] for name, found in estimates.items()}, [1.5])
    assert all("(m)" in axis.get_xlabel() for axis in figure.axes)
    assert [axis.get_subplotspec().rowspan.start for axis in figure.axes] == [0, 0, 0]


def test_a_contact_sheet_has_a_psf_and_a_cut_for_every_distance(lab16mm):
    figure = plots.psfs(lab16mm, count=5)
    assert len(figure.axes) == 10
    np.testing.assert_allclose(figure.axes[0].images[0].get_array(), lab16mm.psf[0])
    assert all("um" in axis.get_xlabel() for axis in figure.axes[5:])


def test_pictures_keep_their_grey_values(rng):
    images = {"one": rng.random((8, 8)), "flat": np.full((8, 8), 0.5), "three": rng.random((8, 8))}
    figure = plots.pictures(images, columns=2)
    shown = [axis for axis in figure.axes if axis.images]
    assert [axis.get_title() for axis in shown] == list(images)
    for axis, image in zip(shown, images.values(), strict=True):
        np.testing.assert_array_equal(axis.images[0].get_array(), image)


def test_the_same_figure_gives_the_same_bytes(lab16mm, tmp_path):
    for name in ("a.png", "b.png"):
        plots.save(plots.psfs(lab16mm, count=3), tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "b.png"]


def test_a_figure_shows_itself_in_a_notebook(lab16mm):
    assert plots.psfs(lab16mm, count=3)._repr_png_().startswith(b"\x89PNG")
