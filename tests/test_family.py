"""The registry, over every family there is."""

import dataclasses
import sys
from subprocess import run

import pytest

from psflut import family
from psflut.errors import PsflutError

FAMILIES = ("psflut.psfs", "psflut.imagers", "psflut.estimators", "calib.targets")
PARTS = [(group, name) for group in FAMILIES for name in family.names(group)]


@pytest.mark.parametrize(("group", "name"), PARTS)
def test_every_part_is_a_frozen_dataclass_that_works_by_default(group, name):
    part = family.load(group, name)
    assert dataclasses.fields(part) is not None
    assert part.__dataclass_params__.frozen
    assert part.__doc__
    assert family.parse(group, name) == part()


@pytest.mark.parametrize(("group", "name"), PARTS)
def test_describe_and_parse_are_inverse(group, name):
    part = family.load(group, name)()
    assert family.parse(group, family.describe(part)) == part


@pytest.mark.parametrize(("group", "name"), PARTS)
def test_no_setting_takes_what_is_no_number(group, name):
    for field in dataclasses.fields(family.load(group, name)):
        if isinstance(field.default, float):
            for text in ("nan", "inf", "-inf"):
                with pytest.raises(PsflutError):
                    family.parse(group, f"{name}:{field.name}={text}")


def test_lists_ride_on_names_too():
    pupil = family.parse("psflut.psfs", "pupil:zernikes=[[4, 0, 0.2]]:wavelengths=[5e-7, 6e-7]")
    assert pupil.zernikes == ((4, 0, 0.2),)
    assert family.parse("psflut.psfs", family.describe(pupil)) == pupil


def test_settings_ride_on_names():
    assert family.parse("psflut.imagers", "laplacian:0.5").alpha == 0.5
    method = family.parse("psflut.estimators", "golden_section:start=table:subtract_noise=true")
    assert (method.start, method.subtract_noise) == ("table", True)
    assert family.parse("psflut.estimators", family.describe(method)) == method


@pytest.mark.parametrize(
    "text",
    ["nonsense", "laplacian:2", "laplacian:beta=0.2", "laplacian:alpha=much", "laplacian:0.2:0.3", "plain:1", ""],
)
def test_unknown_names_and_settings_are_refused(text):
    with pytest.raises(PsflutError):
        family.parse("psflut.imagers", text)


def test_listing_a_family_imports_none_of_it():
    code = (
        "import sys; from psflut import family; family.names('psflut.estimators');"
        "assert not any(m.startswith('psflut.estimators.') for m in sys.modules)"
    )
    assert run([sys.executable, "-c", code], check=False).returncode == 0
