"""Results to show, and a real browser to show them in."""

import asyncio
import base64
import functools
import io
import json
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest
import tornado.httpclient
import tornado.websocket
from PIL import Image

from spacerobot.result import save
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from tests.oracles.free_bodies import FLAT, free_bodies
from viz.figures.comparison import write_figures

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--no-first-run",
    "--hide-scrollbars",
    "--remote-debugging-port=0",
    "about:blank",
)


@pytest.fixture(scope="session")
def paper(tmp_path_factory):
    """The paper's scenario, 10 s, saved."""
    return save(simulate(load_scene("paper")), tmp_path_factory.mktemp("paper") / "amnesia")


@pytest.fixture(scope="session")
def blind(tmp_path_factory):
    """The same without the amnesia controller."""
    scene = load_scene("paper", {"robots.*.tips.tip.amnesia": None})
    return save(simulate(scene), tmp_path_factory.mktemp("blind") / "pid")


CAPTURE = {"distance": 0.05, "spin_deg": 60}


@pytest.fixture(scope="session")
def docked(tmp_path_factory):
    """Two free bodies that meet, go on together and part, in phases."""
    phases = {
        "approach": {"until": {"captured": ["left"]}, "at_most": 2.5, "otherwise": "end"},
        "carry": {"until": {"time": 0.6}},
        "part": {"releases": ["left"], "captures": [], "at_most": 0.5},
    }
    folder = tmp_path_factory.mktemp("docked")
    scene = free_bodies(folder, FLAT, {"kind": "weld", "capture": CAPTURE}, phases=phases)
    return save(simulate(scene, backend="interpreted"), folder / "result")


@pytest.fixture(scope="session")
def diverged(tmp_path_factory):
    """The paper's scenario with far too long a step."""
    return save(
        simulate(
            load_scene("paper", {"simulation.step": 0.02, "simulation.method": "rk4"}), backend="interpreted"
        ),
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
        save(_short(), folder / "base-five" / name)
    contest = {
        "name": "base-five",
        "objective": {"kind": "minimax"},
        "unit": {"factor": 1e3, "name": "mm"},
        "variables": {"kp": {}},
        "currency": {"operations": 3.2e7, "gradient": 4.69, "slope": 2.86, "sample": 1.22},
        "best_known": 0.25,
        "start_objective": 0.5,
        "baseline": _design(0.5),
        "sensitivity": None,
        "methods": {"ga": _method(0.3, gains, active), "nlp": _method(0.25, gains, [])},
    }
    share = {"share": [0.1, 0.9], "low": [0.0, 0.8], "high": [0.2, 1.0]}
    profiles = {"budgets": [1.0, 100.0], "methods": {"ga": share, "nlp": share}}
    data = {"name": "<b>", "verdict": "nlp is ahead <b>", "precisions": [0.1, 0.01], "profiles": profiles}
    (folder / "comparison.json").write_text(json.dumps(data | {"contests": [contest]}))
    write_figures(data | {"contests": [contest]}, folder)
    return folder


@pytest.fixture(scope="session")
def make_comparison():
    """Function that writes a comparison of two methods into a folder, by GA's gains and those at a bound."""
    return _comparison


class Page:
    """One page of a browser, driven by its debugging protocol; keeps errors and requests."""

    def __init__(self, port):
        self.loop = asyncio.new_event_loop()
        self.errors, self.requests, self.count = [], [], 0
        self.socket = self.loop.run_until_complete(self._connect(port))
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    async def _connect(self, port):
        listed = await tornado.httpclient.AsyncHTTPClient().fetch(f"http://127.0.0.1:{port}/json/list")
        address = next(page for page in json.loads(listed.body) if page["type"] == "page")
        return await tornado.websocket.websocket_connect(
            address["webSocketDebuggerUrl"], max_message_size=100_000_000
        )

    def call(self, method, **params):
        self.count += 1
        return self.loop.run_until_complete(
            asyncio.wait_for(self._call({"id": self.count, "method": method, "params": params}), 30)
        )

    async def _call(self, message):
        await self.socket.write_message(json.dumps(message))
        while True:
            answer = json.loads(await self.socket.read_message())
            if answer.get("id") == message["id"]:
                assert "error" not in answer, answer
                return answer["result"]
            self._note(answer.get("method"), answer.get("params", {}))

    def _note(self, method, params):
        if method == "Log.entryAdded" and params["entry"]["level"] == "error":
            self.errors.append(params["entry"]["text"])
        elif method == "Runtime.exceptionThrown":
            self.errors.append(str(params["exceptionDetails"]))
        elif method == "Runtime.consoleAPICalled" and params["type"] in ("error", "warning"):
            self.errors.append(str(params["args"]))
        elif method in ("Network.requestWillBeSent", "Network.webSocketCreated"):
            self.requests.append(params.get("url") or params["request"]["url"])

    def resize(self, width, height):
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.call("Emulation.setDeviceMetricsOverride", **size)

    def open(self, url, width=1000, height=700):
        self.resize(width, height)
        self.call("Page.navigate", url="about:blank")
        self.errors, self.requests = [], []
        self.call("Page.navigate", url=url)
        return self

    def evaluate(self, expression):
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def wait_for(self, expression, timeout_s=20):
        end = time.monotonic() + timeout_s
        while not self.evaluate(expression):
            assert time.monotonic() < end, f"waited in vain for {expression}"
            time.sleep(0.02)

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
    if CHROMIUM is None:
        pytest.skip("no chromium on this computer: the page was not opened in a real browser")
    home = Path(tempfile.mkdtemp(prefix="chromium-"))
    process = subprocess.Popen(
        [CHROMIUM, f"--user-data-dir={home}", *FLAGS], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        port_file, end = home / "DevToolsActivePort", time.monotonic() + 30
        while not (port_file.exists() and port_file.read_text().strip()):
            assert time.monotonic() < end, "chromium did not start"
            assert process.poll() is None, "chromium ended at once"
            time.sleep(0.02)
        time.sleep(0.2)
        yield Page(int(port_file.read_text().split()[0]))
    finally:
        process.terminate()
        process.wait(20)
        shutil.rmtree(home, ignore_errors=True)


@pytest.fixture
def browser(_chromium):
    """A page of a real headless Chromium; what a test leaves on it does not go on playing."""
    yield _chromium
    _chromium.call("Page.navigate", url="about:blank")
