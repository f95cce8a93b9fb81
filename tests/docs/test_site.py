"""The documentation's site, which `make docs` built without a warning, loads nothing from another host."""

import importlib
import os
import re
import shutil
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest

LOADS = re.compile(r"<(?:script|img|iframe|link)\b[^>]*?\b(?:src|href)=[\"']?((?:https?:)?//[^\"'\s>]+)")


@pytest.fixture
def site():
    if "SPACEROBOT_SITE" not in os.environ:
        pytest.skip("`make docs` builds the site and then looks at it")
    return Path(os.environ["SPACEROBOT_SITE"])


def test_nothing_is_loaded_from_another_host(site):
    pages = list(site.rglob("*.html"))
    assert len(pages) > 20
    assert [
        (page.name, LOADS.findall(page.read_text())) for page in pages if LOADS.search(page.read_text())
    ] == []
    styles = [path.read_text() for path in site.rglob("*.css")]
    assert styles
    assert not any(re.search(r"url\([\"']?(?:https?:)?//", text) for text in styles)


@pytest.fixture
def rendered(site):
    """Function from a page's place in the site, and a query, to its document after its scripts ran."""
    program = shutil.which("chromium") or shutil.which("google-chrome")
    if program is None:
        pytest.skip("no chromium on this computer")
    options = ("--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=8000", "--dump-dom")

    def document(page, query=""):
        address = f"{(site / page).resolve().as_uri()}{query}"
        return subprocess.run([program, *options, address], capture_output=True, text=True, check=True).stdout

    return document


def test_pages_opened_from_the_disk_have_a_search(rendered):
    for page in ("index.html", "reference/api/index.html"):
        document = rendered(page, "?q=thrusters")
        assert re.search(r'md-search-result__item"><a href="file:[^"]*/base_actuation.html', document), page


def test_formulas_are_typeset(site, rendered):
    """Every formula of the site is one that KaTeX accepts; Chromium typesets those of the theory."""
    pages = {
        page.relative_to(site).as_posix(): page.read_text().count('class="arithmatex"')
        for page in site.rglob("*.html")
        if 'class="arithmatex"' in page.read_text()
    }
    assert pages["explanation/theory.html"] > 30
    for page, count in pages.items():
        document = rendered(page)
        assert document.count('class="katex-html"') == count, page
        assert "katex-error" not in document, page
        assert "<mfrac>" in document or page != "explanation/theory.html"


def test_diagrams_are_drawn_for_both_schemes(site):
    diagrams = sorted((site / "diagrams").glob("*.svg"))
    assert {path.stem for path in diagrams} == {"control_loop", "frames", "phases", "transmission"}
    for path in diagrams:
        drawing = ElementTree.fromstring(path.read_text())
        assert drawing.find("{*}title").text
        assert "prefers-color-scheme: dark" in path.read_text()
        assert any(f"/diagrams/{path.name}" in page.read_text() for page in site.rglob("*.html")), path.name


def test_links_of_the_repository_are_links_of_the_site(site):
    assert 'href="../examples/05_tune.html"' in (site / "how_to" / "tune.html").read_text()
    assert 'href="tutorials/plugin.html"' in (site / "contributing.html").read_text()
    assert 'href="05_tune.html"' in (site / "examples" / "index.html").read_text()
    assert "examples/index.html" in (site / "index.html").read_text()


def test_names_of_packages_are_in_the_reference(site):
    """Names that a package loads when they are used are hidden from the generator of the reference."""
    pages = "".join(page.read_text() for page in (site / "reference" / "api").glob("*.html"))
    described = set(re.findall(r'id="[\w.]+\.(\w+)"', pages))
    for package in ("spacerobot", "spacerobot.elements", "optim", "optim.campaign", "viz"):
        assert set(importlib.import_module(package).__all__) - described <= {"__version__"}, package


def test_docstrings_are_shown_without_marks_and_with_every_name_of_a_line(site):
    """A line of a docstring may describe several attributes; none is the type of another."""
    reference = {page.name: page.read_text() for page in (site / "reference" / "api").glob("*.html")}
    for name, page in reference.items():
        assert not re.search(r"<code>~|:(?:class|func):", page), name
        assert not re.search(r",(?:</span>)?</code></b>\s*\(<code>", page), name
    bands = re.sub(r"<[^>]+>", "", reference["campaign.html"])
    assert re.search(r"name, unit\s+–\s+Name and unit of the signal", bands)
    assert re.search(r"least, low, median, high, greatest\s+–", bands)


def test_options_and_numbers_are_not_broken_at_their_hyphens(site):
    assert '<code><span class="whole">--starts</span>' in (site / "how_to" / "reliability.html").read_text()
    assert '<span class="whole">2e-6</span>' in (site / "validation" / "margins.html").read_text()
    assert ">=\N{NO-BREAK SPACE}0.0001," in (
        site / "reference" / "scenario" / "contacts.html"
    ).read_text().replace("&gt;", ">")
    for page in site.rglob("*.html"):
        assert not re.search(r'class="arithmatex">[^<]*<span class="whole"', page.read_text()), page
