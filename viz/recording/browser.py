"""A headless Chromium, driven by its debugging protocol."""

from __future__ import annotations

import asyncio
import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tornado.httpclient import AsyncHTTPClient
from tornado.websocket import WebSocketClientConnection, websocket_connect

from spacerobot.common.errors import SpaceRobotError

PROGRAMS = ("chromium", "chromium-browser", "google-chrome")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--no-first-run",
    "--disable-sync",
    "--hide-scrollbars",
    "--remote-debugging-port=0",
    "--window-size=1280,800",
    "about:blank",
)
NO_3D = """
HTMLCanvasElement.prototype.getContext = ((own) => function (kind, ...more) {
  return /webgl/.test(kind) ? null : own.call(this, kind, ...more);
})(HTMLCanvasElement.prototype.getContext);
"""
"""Takes the three-dimensional view from pages that are opened after it."""

START_S = 30.0
CALL_S = 300.0


class Browser:
    """The one page of a browser."""

    def __init__(self, port: int) -> None:
        self._loop = asyncio.new_event_loop()
        self._socket = self._loop.run_until_complete(_connect(port))
        self._count = 0

    def call(self, method: str, **params: Any) -> Any:
        """Answer to a command of the protocol."""
        self._count += 1
        text = json.dumps({"id": self._count, "method": method, "params": params})
        return self._loop.run_until_complete(asyncio.wait_for(self._call(text, self._count), CALL_S))

    async def _call(self, text: str, number: int) -> Any:
        await self._socket.write_message(text)
        while True:
            answer = json.loads(await self._socket.read_message() or "{}")
            if answer.get("id") == number:
                if "error" in answer:
                    raise SpaceRobotError(f"the browser refused a command: {answer['error']}")
                return answer["result"]
            self.note(answer.get("method"), answer.get("params", {}))

    def note(self, event: str | None, about: dict[str, Any]) -> None:
        """Handle an event of the protocol; ignored by default."""

    def evaluate(self, expression: str) -> Any:
        """Value of an expression, awaited."""
        reply = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in reply:
            about = reply["exceptionDetails"]
            raise SpaceRobotError(f"a script of the page failed: {about.get('exception', about)}")
        return reply["result"].get("value")

    def wait_for(self, expression: str, timeout_s: float = 300.0) -> None:
        """Wait until an expression is true.

        Raises:
            TimeoutError: If it is not.
        """
        end = time.monotonic() + timeout_s
        while not self.evaluate(expression):
            if time.monotonic() > end:
                raise TimeoutError(f"waited in vain for {expression}")
            time.sleep(0.02)


def program() -> str | None:
    """Path of the Chromium program on this computer; None if none is installed."""
    return next(filter(None, map(shutil.which, PROGRAMS)), None)


@contextmanager
def chromium() -> Iterator[Browser | None]:
    """Context of a headless browser; None if no Chromium is installed."""
    with started() as port:
        yield None if port is None else Browser(port)


@contextmanager
def started() -> Iterator[int | None]:
    """Context of a running Chromium with its debugging port; None if none is installed."""
    path = program()
    if path is None:
        yield None
        return
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as home:
        quiet = subprocess.DEVNULL
        process = subprocess.Popen([path, f"--user-data-dir={home}", *FLAGS], stdout=quiet, stderr=quiet)
        try:
            file = Path(home) / "DevToolsActivePort"
            end = time.monotonic() + START_S
            while not (file.exists() and file.read_text().strip()):
                if time.monotonic() > end:
                    raise TimeoutError("chromium did not start")
                time.sleep(0.05)
            yield int(file.read_text().split()[0])
        finally:
            process.terminate()
            process.wait(20)


async def _connect(port: int) -> WebSocketClientConnection:
    address = None
    while address is None:  # it listens before it has a page
        listed = await AsyncHTTPClient().fetch(f"http://127.0.0.1:{port}/json/list")
        address = next((page for page in json.loads(listed.body) if page["type"] == "page"), None)
    return await websocket_connect(address["webSocketDebuggerUrl"], max_message_size=2**26)
