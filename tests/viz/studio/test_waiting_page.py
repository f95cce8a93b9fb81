"""The page that is served while the studio loads."""

import subprocess
import sys
import urllib.error
import urllib.request

import pytest

import spacerobot as sr
from spacerobot.common.errors import ScenarioError
from viz.studio.waiting import WAITING, WaitingPage

HEAVY = ("casadi", "numpy", "pinocchio", "xarray", "scipy")


def test_it_says_what_the_studio_waits_for_to_who_knows_the_token():
    words = []
    with WaitingPage("a<b>.yaml", 7660) as waiting:
        tell = waiting.telling(words.append)
        tell("loading")
        tell("building <it>")
        with urllib.request.urlopen(waiting.url) as answer:
            page = answer.read().decode()
            assert answer.headers[WAITING] == "1"
        assert "<li>loading</li><li>building &lt;it&gt;</li>" in page
        assert "a&lt;b&gt;.yaml" in page
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(waiting.url[:-1])
    assert words == ["loading", "building <it>"]
    with pytest.raises(urllib.error.URLError, match="refused"):
        urllib.request.urlopen(waiting.url)


def test_it_loads_no_library_that_takes_long():
    code = f"import sys, viz.studio.waiting; print(*(n for n in {HEAVY} if n in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


@pytest.mark.parametrize(
    ("scenario", "changes", "message"),
    [
        ("examples/receding.yaml", {}, r"robots\.arm\.controllers\.lead: found kind 'mpc'.*run --view"),
        ("paper", {"simulation.duration": "high"}, "simulation.duration: found 'high'"),
    ],
)
def test_a_scenario_that_the_studio_does_not_simulate_is_refused_before_the_page_is_served(
    scenario, changes, message
):
    pages = []
    with pytest.raises(ScenarioError, match=message):
        sr.studio(scenario, changes, on_start=pages.append)
    assert pages == []
