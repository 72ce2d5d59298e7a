"""Planes that are too far apart near focus are named, with how many there should be."""

from dataclasses import replace

import numpy as np
import pytest

from psflut.optics import Camera
from psflut.psfs.pupil import Pupil
from psflut.sampling import advice, defocus_of, too_far
from psflut.store import read_table
from psflut.table import PSFTable

LAB = Camera.of(focus_distance=6.0, focal_length=16e-3, aperture_diameter=8e-3, pixel_pitch=6e-6)


def table_of(count):
    axis = np.sort(1 / np.linspace(1 / 0.95, 1 / 4.5, count))
    return PSFTable(axis, np.stack([Pupil()(LAB, z, 25) for z in axis]), LAB.pixel_pitch, camera=LAB)


def test_planes_far_from_focus_may_be_farther_apart_than_those_near_it():
    few = too_far(table_of(20))
    assert few[-3:].all()
    assert not few[:-3].any()
    assert not too_far(table_of(26)).any()


def test_the_advice_names_where_and_how_many_planes_and_following_it_ends_it():
    sentence = advice(table_of(20))
    assert sentence.startswith("planes between 2.83 m and 4.5 m are up to 0.64 waves of defocus apart")
    assert advice(table_of(int(sentence.split("use ")[1].split()[0]))) is None


def test_a_lens_that_a_calibration_found_serves_as_well_as_a_camera():
    table = table_of(20)
    radius = LAB.aperture_diameter * LAB.detector_distance / 2 / LAB.pixel_pitch
    sampling = LAB.pixel_pitch * LAB.aperture_diameter / LAB.detector_distance / LAB.wavelength
    lens = {"slope": radius, "focus": 1 / LAB.focus_distance, "sampling": sampling}
    found = replace(table, camera=None, check={"lens": lens})
    for ours, theirs in zip(defocus_of(found), defocus_of(table), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-6)
    assert advice(found) == advice(table)
    assert advice(replace(table, camera=None)) is None


@pytest.mark.parametrize("name", ["lab16mm", "thesis", "thesis-fir"])
def test_shipped_tables_are_fine_enough(name):
    assert advice(read_table(name)) is None
