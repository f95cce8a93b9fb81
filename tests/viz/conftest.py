"""Results to show, and a real browser to show them in."""

import base64
import functools
import io
import json

import numpy as np
import pytest
from PIL import Image

from spacerobot.common.errors import SpaceRobotError
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from tests.oracles.free_bodies import FLAT, free_bodies
from viz.figures.comparison import write_figures
from viz.recording.browser import NO_3D, Browser, started


@pytest.fixture(scope="session")
def paper(tmp_path_factory):
    """The paper's scenario, 10 s, saved."""
    return simulate(load_scene("paper")).save(tmp_path_factory.mktemp("paper") / "amnesia")


@pytest.fixture(scope="session")
def blind(tmp_path_factory):
    """The same without the amnesia controller."""
    scene = load_scene("paper", {"robots.*.tips.tip.amnesia": None})
    return simulate(scene).save(tmp_path_factory.mktemp("blind") / "pid")


CAPTURE = {"distance": 0.05, "spin_deg": 60}


@pytest.fixture(scope="session")
def docked(tmp_path_factory):
    """Two free bodies that meet, go on together and part, in phases."""
    phases = {
        "approach": {"until": {"captured": ["left"]}, "timeout": 2.5, "on_timeout": "end"},
        "carry": {"until": {"time": 0.6}},
        "part": {"releases": ["left"], "captures": [], "timeout": 0.5},
    }
    folder = tmp_path_factory.mktemp("docked")
    scene = free_bodies(folder, FLAT, {"kind": "weld", "capture": CAPTURE}, phases=phases)
    return simulate(scene, backend="interpreted").save(folder / "result")


@pytest.fixture(scope="session")
def diverged(tmp_path_factory):
    """The paper's scenario with far too long a step."""
    return simulate(
        load_scene("paper", {"simulation.step": 0.02, "simulation.method": "rk4"}), backend="interpreted"
    ).save(
        tmp_path_factory.mktemp("d") / "diverged",
    )


@pytest.fixture(scope="session")
def spatial():
    """The servicer for a quarter of a second, interpreted."""
    scene = load_scene("servicer", {"simulation.duration": 0.24, "simulation.step": 0.02})
    return simulate(scene, backend="interpreted")


def _time(expected):
    bounds = {"low": expected, "high": expected, "rate_low": 0.5, "rate_high": 1.0}
    return {"expected": expected, "met": 4 if expected else 0, "runs": 5, **bounds}


def _design(reached, **more):
    plants = {"objective": {"median": 0.005, "worst": 0.009}, "values": [0.005, 0.009], "diverged": 0}
    peaks = {"joint_torque_peak": 3.25, "tip_error_peak": 0.0123}
    return {"peaks": peaks, "other_plants": plants, "nominal_objective": reached} | more


def _method(best, gains, active):
    found = _design(best, objective=best, gains=gains, active_bounds=active, feasible=True, status="settled")
    return {
        "ranked": True,
        "objective": {"best": best, "median": 2 * best},
        "best": found,
        "spent": {"equivalent_rollouts": 123.4, "wall_s": 1.5, "wall_with_compilation_s": 9.5},
        "running_times": [_time(1234.0 * best), _time(None)],
        "trials": [{"spent": 123.4, "history": [[10.0, 2 * best], [60.0, best]]}],
    }


@functools.cache
def _short():
    return simulate(load_scene("paper", {"simulation.duration": 0.2}))


def _comparison(folder, gains, active):
    for name in ("baseline", "nlp"):
        _short().save(folder / "base-five" / name)
    benchmark = {
        "name": "base-five",
        "objective": {"kind": "minimax"},
        "unit": {"factor": 1e3, "name": "mm"},
        "variables": {"kp": {}},
        "cost_unit": {"operations": 3.2e7, "gradient": 4.69, "slope": 2.86, "sample": 1.22},
        "best_known": 0.25,
        "start_objective": 0.5,
        "baseline": _design(0.5),
        "sensitivity": None,
        "methods": {"ga": _method(0.3, gains, active), "nlp": _method(0.25, gains, [])},
    }
    share = {"share": [0.1, 0.9], "low": [0.0, 0.8], "high": [0.2, 1.0]}
    profiles = {"budgets": [1.0, 100.0], "methods": {"ga": share, "nlp": share}}
    data = {"name": "<b>", "conclusion": "nlp is ahead <b>", "precisions": [0.1, 0.01], "profiles": profiles}
    (folder / "comparison.json").write_text(json.dumps(data | {"problems": [benchmark]}))
    write_figures(data | {"problems": [benchmark]}, folder)
    return folder


@pytest.fixture(scope="session")
def make_comparison():
    """Function that writes a comparison of two methods into a folder, by GA's gains and those at a bound."""
    return _comparison


COARSEST = 5
"""Of the levels of ``viz/web/quality.js``: what is drawn costs a tenth of what it does at the finest."""

NO_CONTEXT = "THREE.WebGLRenderer: Error creating WebGL context."
"""Error that a page without a three-dimensional scene writes once."""


class Page(Browser):
    """One page of a browser, driven by its debugging protocol; keeps errors and requests."""

    def __init__(self, port):
        super().__init__(port)
        self.errors, self.requests, self.flat = [], [], False
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def note(self, event, about):
        if event == "Log.entryAdded" and about["entry"]["level"] == "error":
            self.errors.append(about["entry"]["text"])
        elif event == "Runtime.exceptionThrown":
            self.errors.append(str(about["exceptionDetails"]))
        elif event == "Runtime.consoleAPICalled" and about["type"] in ("error", "warning"):
            if not (self.flat and NO_CONTEXT in str(about["args"])):
                self.errors.append(str(about["args"]))
        elif event in ("Network.requestWillBeSent", "Network.webSocketCreated"):
            self.requests.append(about.get("url") or about["request"]["url"])

    def resize(self, width, height):
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.call("Emulation.setDeviceMetricsOverride", **size)

    def open(self, url, width=1000, height=700, quality=COARSEST):
        """Open an address; ``quality``: how finely its scene is drawn, None for as a user sees it."""
        self.resize(width, height)
        self.call("Page.navigate", url="about:blank")
        self.errors, self.requests = [], []
        if quality is not None and url != "about:blank" and "quality=" not in url:
            url += f"{'&' if '#' in url else '#'}quality={quality}"
        self.call("Page.navigate", url=url)
        return self

    def wait_for(self, expression, timeout_s=20):
        """Wait until an expression is true, also where the page opens itself again meanwhile."""
        try:
            super().wait_for(expression, timeout_s)
        except SpaceRobotError as error:
            if "navigated" not in str(error):
                raise
            self.wait_for(expression, timeout_s)

    def drawn(self):
        """Wait until the page has drawn what it was asked for."""
        self.evaluate(
            "new Promise((ok) => requestAnimationFrame(() => requestAnimationFrame(() => ok(true))))"
        )

    def picture(self):
        """Pixels of the page (height, width, 3) once it has drawn what it was asked for."""
        self.drawn()
        shot = self.call("Page.captureScreenshot", format="png", optimizeForSpeed=True)["data"]
        return np.asarray(Image.open(io.BytesIO(base64.b64decode(shot))).convert("RGB")).astype(np.int16)


@pytest.fixture(scope="session")
def _chromium():
    with started() as port:
        if port is None:
            pytest.skip("no chromium on this computer: the page was not opened in a real browser")
        yield Page(port)


@pytest.fixture
def browser(_chromium):
    """A page of a real headless Chromium; what a test leaves on it does not go on playing."""
    yield _chromium
    _chromium.call("Page.navigate", url="about:blank")


@pytest.fixture
def flat(browser):
    """Pages draw no three-dimensional scene, where a test asserts nothing of it: half the time of a page."""
    script = browser.call("Page.addScriptToEvaluateOnNewDocument", source=NO_3D)["identifier"]
    browser.flat = True
    yield
    browser.flat = False
    browser.call("Page.removeScriptToEvaluateOnNewDocument", identifier=script)
