"""The table in memory: between its planes, its derivative, its transfer functions."""

import numpy as np
import pytest

from calib.recipe import read_recipe
from psflut.errors import PsflutError
from psflut.store import SHIPPED
from psflut.table import PSFTable


@pytest.mark.parametrize("name", ["lab16mm", "thesis", "thesis-fir"])
def test_between_planes_the_table_is_the_model_to_one_percent_of_the_peak(name):
    from psflut.store import read_table

    table = read_table(name)
    recipe = read_recipe(SHIPPED[1] / f"{name}.toml")
    vergence = 1 / table.axis
    middles = 2 / (vergence[1:] + vergence[:-1])
    worst = 0.0
    for distance in [*middles[:: 7 if name == "lab16mm" else 1].tolist(), float(middles[-1])]:
        model = recipe.model(recipe.camera, distance, recipe.size)
        worst = max(worst, np.abs(table.at(distance) - model).max() / model.max())
    assert worst < 0.01


def test_planes_are_met_exactly(lab16mm):
    np.testing.assert_allclose(lab16mm.at(lab16mm.axis), lab16mm.psf, atol=1e-12)


def test_every_interpolated_psf_is_non_negative_with_sum_one(lab16mm):
    planes = lab16mm.at(lab16mm.candidates(333))
    assert planes.min() >= 0
    np.testing.assert_allclose(planes.sum(axis=(1, 2)), 1.0, atol=1e-12)


@pytest.mark.parametrize("distance", [0.93, 1.71, 3.3])
def test_the_derivative_is_the_limit_of_differences(thesis, lab16mm, distance):
    table = lab16mm if distance < 3.2 else thesis
    step = 1e-5
    difference = (table.at(distance + step) - table.at(distance - step)) / (2 * step)
    slope = table.derivative(distance)
    # Clipping and normalising leave traces far below the slope itself.
    assert np.abs(difference - slope).max() < 5e-3 * np.abs(slope).max()


def test_the_otf_is_the_transform_of_the_psf_about_its_centre(lab16mm, rng):
    otf = lab16mm.otf((96, 80), 1.5)
    assert otf[0, 0] == pytest.approx(1.0)
    assert np.abs(otf.imag).max() < 1e-6  # a symmetric PSF, centred
    back = np.roll(np.fft.irfft2(otf, s=(96, 80)), (24, 24), axis=(0, 1))[:49, :49]
    np.testing.assert_allclose(back, lab16mm.at(1.5), atol=1e-12)
    np.testing.assert_allclose(lab16mm.power((96, 80), 1.5), np.abs(otf) ** 2)


def test_candidates_are_even_in_vergence_and_span_the_table(lab16mm):
    candidates = lab16mm.candidates(50)
    assert (candidates[0], candidates[-1]) == lab16mm.span
    assert np.ptp(np.diff(1 / candidates)) < 1e-12


def test_a_stage_axis_is_interpolated_as_it_is():
    axis = np.linspace(-1e-3, 1e-3, 5)
    planes = np.stack([np.full((3, 3), 1 / 9)] * 5)
    planes[:, 1, 1] += (tilt := 0.01 * axis / 1e-3)
    planes[:, 0, 0] -= tilt
    table = PSFTable(axis, planes, 1e-6, kind="stage")
    assert table.at(0.25e-3)[1, 1] == pytest.approx(1 / 9 + 0.0025)
    assert table.derivative(0.0)[1, 1] == pytest.approx(10.0)


def test_what_is_no_table_is_refused(lab16mm):
    axis, psf = lab16mm.axis, lab16mm.psf
    for bad_axis, bad_psf in (
        (axis[:2], psf[:2]),
        (axis[::-1], psf),
        (-axis[::-1], psf),
        (axis, psf[:, :48, :48]),
        (axis, psf * 2),
        (axis, psf - 1e-3),
        (axis, np.where(psf == psf.max(), np.nan, psf)),
    ):
        with pytest.raises(PsflutError):
            PSFTable(bad_axis, bad_psf, 6e-6)
    with pytest.raises(PsflutError, match=r"outside the table, which runs from 800 mm to 5 m"):
        lab16mm.at(0.5)
