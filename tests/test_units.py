import pytest
from hypothesis import given
from hypothesis import strategies as st

from psflut.errors import PsflutError
from psflut.units import METRES, format_length, parse_length


@given(st.floats(1e-9, 1e6))
def test_format_and_parse_are_inverse(metres):
    assert parse_length(format_length(metres)) == pytest.approx(metres, rel=1e-3)


@given(st.floats(1e-3, 1e6), st.sampled_from(sorted(METRES)))
def test_every_unit_scales(value, unit):
    assert parse_length(f"{value!r} {unit}") == pytest.approx(value * METRES[unit])


@pytest.mark.parametrize("text", ["", "16", "mm", "16 parsec", "1,5 m", "nan m", "inf m", "--1 m", 3, None])
def test_what_is_no_length_is_refused_in_one_sentence(text):
    with pytest.raises(PsflutError, match="a number with a unit"):
        parse_length(text)
