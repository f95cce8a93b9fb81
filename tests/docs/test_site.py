"""The documentation's site, which `make docs` built without a warning, loads nothing from another host."""

import os
import re
import shutil
import subprocess
from pathlib import Path

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


def test_pages_opened_from_the_disk_have_a_search(site):
    program = shutil.which("chromium") or shutil.which("google-chrome")
    if program is None:
        pytest.skip("no chromium on this computer")
    for page in ("index.html", "reference/api/index.html"):
        address = f"{(site / page).resolve().as_uri()}?q=thrusters"
        options = ("--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=8000", "--dump-dom")
        found = subprocess.run([program, *options, address], capture_output=True, text=True, check=True)
        assert re.search(r'md-search-result__item"><a href="file:[^"]*/base_actuation.html', found.stdout), (
            page
        )


def test_links_of_the_repository_are_links_of_the_site(site):
    assert 'href="../examples/05_tune.html"' in (site / "how_to" / "tune.html").read_text()
    assert 'href="tutorials/plugin.html"' in (site / "contributing.html").read_text()
    assert 'href="05_tune.html"' in (site / "examples" / "index.html").read_text()
    assert "examples/index.html" in (site / "index.html").read_text()


def test_names_of_packages_are_in_the_reference(site):
    import optim
    import viz

    pages = {
        package.__name__: (site / "reference" / "api" / f"{package.__name__}.html").read_text()
        for package in (optim, viz)
    }
    rollout = (site / "reference" / "api" / "rollout.html").read_text()
    for package in (optim, viz):
        for name in package.__all__:
            assert re.search(rf'id="[\w.]+\.{name}"', pages[package.__name__] + rollout), name
