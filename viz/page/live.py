"""Live viewer: the animated page, served to this computer alone, showing what the program sends it."""

from __future__ import annotations

import asyncio
import os
import threading
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import tornado.httpserver
import tornado.netutil
import tornado.web
import tornado.websocket

from spacerobot.errors import SpaceRobotError
from spacerobot.result import Result
from spacerobot.scene import Scene
from viz.page.animation import animation, still
from viz.page.page import json_text, page

ADDRESS = "127.0.0.1"
"""The only address listened on: this computer's own."""

FIRST_PORT, PORTS = 7000, 200


class LiveViewer:
    """A page in the browser that a program fills.

    Only this computer can reach it: the server is bound to the loopback address, and answers only requests
    that name that address, so that no foreign web page can read it through the browser either.

    Parameters
    ----------
    port
        First port to try; a busy one is stepped over.

    Raises
    ------
    SpaceRobotError
        If no port is free.
    """

    def __init__(self, port: int = FIRST_PORT) -> None:
        self._sockets, self.port = _bind(port)
        self._shown = self._told = ""
        self._streams: set[_Stream] = set()
        self._connected = threading.Event()
        started = threading.Event()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._serve, args=(started,), name="live viewer", daemon=True)
        self._thread.start()
        started.wait()

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{ADDRESS}:{self.port}/"

    def open(self) -> bool:
        """Open the page in the user's browser; whether one was found.

        One that would take over the terminal is not opened, unless the user chose it by ``BROWSER``.
        """
        try:
            browser = webbrowser.get()
        except webbrowser.Error:
            return False
        if type(browser) is webbrowser.GenericBrowser and "BROWSER" not in os.environ:
            return False
        return browser.open(self.url, new=2)

    def tell(self, text: str) -> None:
        """Say what is being done, until something is shown; fits ``simulate(..., progress=viewer.tell)``.

        Words with a percentage, such as ``40 %``, show as a bar as well.
        """
        self._send({"tell": text})

    def show_scene(self, scene: Scene, about: str | None = None) -> None:
        """Show a scene as it begins; ``about`` is said of it, its description by default."""
        self._send({"show": still(scene, about=about)})

    def show(self, *results: Result) -> None:
        """Play a result, or compare several; what was shown before goes.

        Raises
        ------
        ResultError
            If the results cannot be compared.
        """
        self._send({"show": animation(*results)})

    def wait_for_page(self, timeout_s: float | None = None) -> bool:
        """Wait until a browser shows the page; whether one does."""
        return self._connected.wait(timeout_s)

    def wait(self) -> None:
        """Serve until interrupted, by Ctrl-C for example, which is then done with."""
        with suppress(KeyboardInterrupt):
            while self._thread.is_alive():
                self._thread.join(0.5)

    def close(self) -> None:
        """Stop serving; pages keep what they have."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join(5)

    def __enter__(self) -> LiveViewer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _repr_html_(self) -> str:
        return f'<iframe src="{self.url}" style="width:100%;height:600px;border:0"></iframe>'

    def _serve(self, started: threading.Event) -> None:
        asyncio.set_event_loop(self._loop)
        handlers: list[Any] = [(r"/", _Page, {"viewer": self}), (r"/stream", _Stream, {"viewer": self})]
        elsewhere: dict[str, Any] = {
            "default_handler_class": _Nowhere,
            "default_handler_args": {"viewer": self},
        }
        server = tornado.httpserver.HTTPServer(
            tornado.web.Application(handlers, log_function=_quiet, **elsewhere)
        )
        server.add_sockets(self._sockets)
        self._loop.call_soon(started.set)
        self._loop.run_forever()
        server.stop()
        for stream in list(self._streams):
            stream.close()
        self._loop.run_until_complete(asyncio.sleep(0.05))  # lets the pages hear of it
        # a browser would keep what is left open for the next viewer at this port, and wait there in vain
        self._loop.run_until_complete(server.close_all_connections())
        self._loop.close()

    def _send(self, message: dict[str, Any]) -> None:
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._broadcast, json_text(message), "show" in message)

    def _broadcast(self, text: str, shows: bool) -> None:
        """Send to every page, and keep for pages that open later what they would have missed."""
        if shows:
            self._shown, self._told = text, ""
        else:
            self._told = text
        for stream in list(self._streams):
            stream.send(text)

    def _admit(self, stream: _Stream) -> None:
        for text in filter(None, (self._shown, self._told)):
            stream.send(text)
        self._streams.add(stream)
        self._connected.set()

    def allows(self, host: str) -> bool:
        """Whether a request may name this host."""
        return host in (f"{ADDRESS}:{self.port}", f"localhost:{self.port}")


class _Guarded(tornado.web.RequestHandler):
    """Answers requests that name this computer only.

    A foreign web page whose own name has been made to lead here (DNS rebinding) is one origin with this
    server in the browser's eyes; the name it was asked for by is what gives it away.
    """

    def initialize(self, viewer: LiveViewer) -> None:
        self.viewer = viewer

    def prepare(self) -> None:
        if not self.viewer.allows(self.request.host):
            raise tornado.web.HTTPError(403)


class _Nowhere(_Guarded):
    def prepare(self) -> None:
        super().prepare()
        raise tornado.web.HTTPError(404)


class _Page(_Guarded):
    def get(self) -> None:
        waiting = {"title": "spacerobot", "about": "waiting for a result", "runs": [], "live": True}
        self.set_header("Cache-Control", "no-store")
        self.write(page(waiting, connect=f"ws://{self.request.host}"))


class _Stream(_Guarded, tornado.websocket.WebSocketHandler):
    def check_origin(self, origin: str) -> bool:
        return self.viewer.allows(origin.removeprefix("http://"))

    def open(self, *_: str, **__: str) -> None:
        self.viewer._admit(self)

    def send(self, text: str) -> None:
        """Send, unless the page has gone."""
        with suppress(tornado.websocket.WebSocketClosedError):
            self.write_message(text)

    def on_message(self, message: str | bytes) -> None:
        """Messages from pages are ignored."""

    def on_close(self) -> None:
        self.viewer._streams.discard(self)


def _bind(first: int) -> tuple[list[Any], int]:
    for port in range(first, min(first + PORTS, 65536)):
        try:
            sockets = tornado.netutil.bind_sockets(port, address=ADDRESS)
            return sockets, int(sockets[0].getsockname()[1])
        except OSError:
            continue
    raise SpaceRobotError(f"no free port from {first} to {first + PORTS - 1} for the live viewer")


def _quiet(_: tornado.web.RequestHandler) -> None:
    """Log nothing, so that the command's output stays readable."""


@contextmanager
def view_run(scene: Scene, *, port: int = FIRST_PORT, open_browser: bool = True) -> Iterator[LiveViewer]:
    """Viewer that shows a scene while it is simulated; ``port`` is as :class:`LiveViewer` takes it.

    Examples
    --------
    >>> with view_run(scene) as viewer:  # doctest: +SKIP
    ...     result = simulate(scene, progress=viewer.tell)
    ...     viewer.show(result)
    ...     viewer.wait()
    """
    with LiveViewer(port) as viewer:
        viewer.show_scene(scene)
        if open_browser:
            viewer.open()
        yield viewer
