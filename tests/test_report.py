"""The report of a patch: what it says, and that its page needs nothing but itself."""

import re
import shutil
from html import unescape
from html.parser import HTMLParser

import numpy as np
import pytest

from psflut import Noise, Observation, estimate, findings, reporting
from psflut.density import Mode
from psflut.errors import PsflutError
from psflut.plots import posteriors
from psflut.reporting import report

HOSTILE = '<script>alert("1")</script>&.tif'
NOISE = Noise(0.005)
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")


class Page(HTMLParser):
    """Tags with their attributes, headings, and the values of <data> elements by the table they stand in."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.headings, self.values, self._table, self._inside = [], [], {}, "", ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.tags.append((tag, attributes))
        self._inside = tag
        if tag == "table":
            self._table = attributes.get("id", "")
        if tag == "data":
            self.values.setdefault(self._table, []).append(float(attributes["value"]))

    def handle_data(self, data):
        if self._inside in ("h1", "h2"):
            self.headings.append(data)
        self._inside = ""


@pytest.fixture(scope="module")
def observation(lab_patch):
    return Observation(lab_patch[32:96, 32:96], NOISE)


@pytest.fixture(scope="module")
def made(observation, lab16mm):
    return report(observation, lab16mm, name=HOSTILE, about={"table": HOSTILE}, seed=3)


@pytest.fixture
def two_methods(monkeypatch):
    """Leave the slow ones out."""
    monkeypatch.setattr(reporting, "for_any_scene", lambda: ("posterior", "wiener"))


def test_its_intervals_are_those_of_estimate(made, observation, lab16mm):
    found = estimate(observation, lab16mm, "posterior:seed=3")
    np.testing.assert_allclose(made.intervals[0.95], found.interval, rtol=1e-12)
    narrower = estimate(observation, lab16mm, "posterior:seed=3", level=0.5)
    np.testing.assert_allclose(made.intervals[0.5], narrower.interval, rtol=1e-12)
    values = Page(made.html).values
    np.testing.assert_allclose(np.reshape(values["intervals"], (3, 2)), list(made.intervals.values()))
    assert values["modes"] == [mode.distance for mode in found.modes]
    told = [end for each in made.estimates.values() for end in (each.distance, *each.interval)]
    assert values["estimates"] == pytest.approx(told)


def test_every_section_is_there(made):
    headings = Page(made.html).headings
    assert headings[0] == f"Distance of {HOSTILE}"
    assert headings[1:] == [
        "The patch",
        "Posterior of distance",
        "Prior and posterior",
        "Does the model fit?",
        "Where the uncertainty comes from",
        "Every estimator",
        "Pairs of parameters",
        "The chain",
        "What this rests on",
        "How to cite",
    ]
    assert set(made.estimates) == {"posterior", "wiener", "blind_rl", "golden_section"}
    assert "three in four photographs stay below" in made.html


def test_names_cannot_become_markup(made):
    assert "<script" not in made.html
    assert unescape(made.html).count(HOSTILE) == 3  # title, heading, provenance


def test_the_page_needs_no_other_file_and_every_figure_has_words(made):
    page = Page(made.html)
    for tag, attributes in page.tags:
        assert tag not in ("script", "iframe", "object", "use") or attributes.get("xlink:href", "").startswith("#")
        for name in ("src", "href", "xlink:href", "srcset"):
            assert attributes.get(name, "#").startswith(("data:", "#"))
        if tag == "img":
            assert attributes["alt"]
        if tag == "svg":
            assert attributes["role"] == "img"
            assert len(attributes["aria-label"]) > 20
    assert [tag for tag, _ in page.tags].count("svg") == 7
    assert not re.search(r"https?://|@import", made.html)
    ids = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    assert set(re.findall(r"url\(#(\w+)\)|href=\"#(\w+)\"", made.html)) <= {(i, "") for i in ids} | {
        ("", i) for i in ids
    }


def test_the_same_seed_gives_the_same_bytes(observation, lab16mm, two_methods):
    first, second = (report(observation, lab16mm, seed=5).html for _ in range(2))
    assert first == second


def test_a_flat_patch_is_told_without_a_chain(lab16mm, two_methods, rng):
    blank = 0.5 + NOISE.read * rng.standard_normal((64, 64))
    made = report(Observation(blank, NOISE), lab16mm)
    headings = Page(made.html).headings
    assert "no texture beyond its noise" in made.html
    assert "Every estimator" in headings
    assert "The chain" not in headings


def test_a_method_that_refuses_has_a_row_of_its_own(observation, lab16mm, two_methods, monkeypatch):
    def refusing(observation, table, method):
        if type(method).__name__ == "Wiener":
            raise PsflutError("not <today>")
        return estimate(observation, table, method)

    monkeypatch.setattr(reporting, "estimate", refusing)
    monkeypatch.setattr(reporting, "_figures", lambda *_: {})
    made = report(observation, lab16mm)
    assert "not &lt;today&gt;" in made.html
    assert list(made.estimates) == ["posterior"]


def test_a_pattern_that_no_photograph_has_is_criticised(lab16mm, lab_patch, rng):
    stripes = 0.5 + 0.3 * np.sin(2 * np.pi * np.arange(128) / 16) + NOISE.read * rng.standard_normal((128, 128))
    for patch, words in ((stripes, "No distance of the table explains"), (lab_patch, "as well as that of most")):
        found = estimate(Observation(patch, NOISE), lab16mm, "posterior:steps=60")
        assert words in findings.sentences(found, lab16mm)["misfit"]


def test_every_mode_has_a_panel(rng):
    samples = np.concatenate([rng.normal(1.0, 0.01, 3000), rng.normal(3.0, 0.1, 1000)])
    modes = [Mode(1.0, 0.75), Mode(3.0, 0.25)]
    figure = posteriors.posterior(samples, {0.5: (0.99, 1.01), 0.95: (0.98, 3.1)}, modes, (0.5, 5.0), "distance (m)")
    near, far = figure.axes
    for axis, mode in zip((near, far), modes, strict=True):
        assert axis.get_xlim()[0] < mode.distance < axis.get_xlim()[1]
        x, y = axis.lines[0].get_data()
        assert np.trapezoid(y, x) == pytest.approx(mode.weight, abs=0.01)


def test_it_shows_itself_in_a_notebook_and_saves_itself(made, tmp_path):
    shown = made._repr_html_()
    assert unescape(re.search(r'srcdoc="([^"]*)"', shown)[1]) == made.html
    made.save(tmp_path / "page.html")
    assert (tmp_path / "page.html").read_text(encoding="utf-8") == made.html
    with pytest.raises(PsflutError, match="exists"):
        made.save(tmp_path / "page.html")
    with pytest.raises(PsflutError, match=r"\.html"):
        made.save(tmp_path / "page.pdf")


def test_an_estimate_shows_itself_as_a_card(made):
    card = made.estimates["wiener"]._repr_html_()
    assert "95% interval" in card
    assert 'role="img"' in card
    assert "1.6" in card


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_browser_opens_it_without_complaint(made, tmp_path, scheme):
    sync_api = pytest.importorskip("playwright.sync_api", reason="no playwright")
    binary = next(filter(None, map(shutil.which, BROWSERS)), None)
    if binary is None:
        pytest.skip(f"no browser: none of {', '.join(BROWSERS)} is on the path")
    made.save(tmp_path / "page.html")
    said, asked = [], []
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=binary, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 390, "height": 800}, color_scheme=scheme)
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on("request", lambda request: asked.append(request.url))
        page.goto((tmp_path / "page.html").as_uri())
        assert page.evaluate("[...document.images].every(image => image.complete && image.naturalWidth > 0)")
        assert page.evaluate(
            "[...document.querySelectorAll('svg')].every(one => one.getBoundingClientRect().width > 300)"
        )
        assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")  # nothing sticks out
        browser.close()
    assert said == []
    assert [url for url in asked if not url.startswith(("file:", "data:"))] == []
