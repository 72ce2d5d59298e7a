"""`psflut limits`: its contract, and what it says to those who err."""

import json

import pytest

SMALL = ("--table", "lab16mm", "--patch-size", "64")


@pytest.fixture
def bound(psflut):
    """Run ``limits --json``: its objects, and what was said on stderr."""

    def run(*words):
        code, out, err = psflut("limits", *words, "--json")
        assert code == 0, err
        return [json.loads(line) for line in out.splitlines()], err

    return run


def test_one_json_object_a_distance(bound):
    found, err = bound(*SMALL, "--noise", "0.005")
    assert err == ""
    assert list(found[0]) == ["distance_m", "crb_m", "within_span_m"]
    distances = [each["distance_m"] for each in found]
    assert distances == sorted(distances)
    assert (distances[0], distances[-1]) == (0.8, 5.0)
    assert all(0 < each["within_span_m"] < each["crb_m"] for each in found)


def test_options_change_the_bound_as_they_should(bound):
    def at(*words):
        return bound(*SMALL, *words)[0][50]["crb_m"]

    usual = at("--noise", "0.005")
    assert at() == usual
    assert at("--noise", "0.02") > usual
    assert at("--contrast", "0.2") < usual
    assert at("--scene", "known") < usual
    assert at("--scene", "point") != usual
    assert at("--imager", "laplacian:0.2") != usual


def test_the_set_up_of_the_table_is_used_and_what_wins_is_said(bound):
    fixed, err = bound("--table", "thesis", "--patch-size", "64")
    assert err == ""
    same, err = bound("--table", "thesis", "--patch-size", "64", "--noise", "variance:1e-3")
    assert "in place of the table's" in err
    assert same == fixed
    other, _ = bound("--table", "thesis", "--patch-size", "64", "--noise", "relative:1e-3")
    assert other[50]["crb_m"] < 0.5 * fixed[50]["crb_m"]


def test_a_person_reads_a_table_and_where_it_is_good_and_blind(psflut, tmp_path):
    code, out, err = psflut("limits", *SMALL, "-o", "bound.png")
    assert code == 0
    assert "pass --noise" in err
    assert (tmp_path / "bound.png").read_bytes().startswith(b"\x89PNG")
    lines = out.splitlines()
    assert lines[0].split()[:2] == ["distance", "bound"]
    assert [line.split()[0] for line in lines[-3:]] == ["good", "blind", "scene"]


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (("--patch-size", "32"), "larger"),
        (("--contrast", "-1"), "positive"),
        (("--scene", "square"), "scene"),
        (("--noise", "loud"), "sigma"),
        (("-o", "no/where.png"), "folder"),
    ],
)
def test_mistakes_are_refused_in_a_sentence(refused, words, part):
    assert part in refused("limits", "--table", "lab16mm", *words)
