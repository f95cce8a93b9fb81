"""Server that only this computer can reach, by the loopback address and its name."""

from __future__ import annotations

import asyncio
import os
import threading
import webbrowser
from contextlib import suppress
from typing import Any, Self

import tornado.httpserver
import tornado.netutil
import tornado.web
import tornado.websocket

from spacerobot.common.errors import SpaceRobotError

ADDRESS = "127.0.0.1"
"""Only address that the server listens on: this computer's loopback address."""

FIRST_PORT, PORTS = 7000, 200


class Loopback:
    """Server in its own thread.

    Only this computer can reach it: the server is bound to the loopback address and answers only requests
    with that host name, so that no foreign web page can read it through the browser.

    Args:
        port: First port to try; busy ports are skipped.

    Raises:
        SpaceRobotError: If no port is free.
    """

    largest_message = 4096
    """Bytes that a page's message may have; a longer one ends its connection."""

    def __init__(self, port: int = FIRST_PORT) -> None:
        for free in range(port, min(port + PORTS, 65536)):
            with suppress(OSError):
                self._sockets = tornado.netutil.bind_sockets(free, address=ADDRESS)
                break
        else:
            raise SpaceRobotError(f"no free port from {port} to {port + PORTS - 1} for the live viewer")
        self.port = int(self._sockets[0].getsockname()[1])
        self._streams: set[Stream] = set()
        started = threading.Event()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._serve, args=(started,), name="viewer", daemon=True)
        self._thread.start()
        started.wait()

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{ADDRESS}:{self.port}/"

    def handlers(self) -> list[Any]:
        """Routes of the server in tornado's form; each handler is a :class:`LocalRequestHandler`."""
        raise NotImplementedError

    def allows(self, host: str) -> bool:
        """Whether the server answers requests for this host name."""
        return host in (f"{ADDRESS}:{self.port}", f"localhost:{self.port}")

    def admit(self, stream: Stream) -> None:
        """A page has connected."""
        self._streams.add(stream)

    def leave(self, stream: Stream) -> None:
        """A page has gone."""
        self._streams.discard(stream)

    def open(self) -> bool:
        """Open the page in the user's browser and return whether one was found.

        A text browser in the terminal is used only if the user chose it by ``BROWSER``.
        """
        try:
            browser = webbrowser.get()
        except webbrowser.Error:
            return False
        if type(browser) is webbrowser.GenericBrowser and "BROWSER" not in os.environ:
            return False
        return browser.open(self.url, new=2)

    def wait(self) -> None:
        """Serve until interrupted, for example by Ctrl-C; returns without an exception."""
        with suppress(KeyboardInterrupt):
            while self._thread.is_alive():
                self._thread.join(0.5)

    def close(self) -> None:
        """Stop the server; open pages keep their content."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join(5)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _repr_html_(self) -> str:
        return f'<iframe src="{self.url}" style="width:100%;height:600px;border:0"></iframe>'

    def _serve(self, started: threading.Event) -> None:
        asyncio.set_event_loop(self._loop)
        elsewhere: dict[str, Any] = {
            "default_handler_class": _Nowhere,
            "default_handler_args": {"server": self},
            "websocket_max_message_size": self.largest_message,
            "log_function": lambda _: None,  # so that the command's output stays readable
        }
        server = tornado.httpserver.HTTPServer(tornado.web.Application(self.handlers(), **elsewhere))
        server.add_sockets(self._sockets)
        self._loop.call_soon(started.set)
        self._loop.run_forever()
        server.stop()
        for stream in list(self._streams):
            stream.close()
        self._loop.run_until_complete(asyncio.sleep(0.05))  # lets the pages hear of it
        # a browser would reuse an open connection for the next viewer at this port, and wait in vain
        self._loop.run_until_complete(server.close_all_connections())
        self._loop.close()


class LocalRequestHandler(tornado.web.RequestHandler):
    """Handler that answers only requests for this computer's name.

    A foreign web page whose host name resolves to this computer (DNS rebinding) has the same origin as this
    server for the browser; the host name in the request reveals it.
    """

    def initialize(self, server: Any) -> None:
        """Store the server."""
        self.server = server

    def prepare(self) -> None:
        """Reject requests for another host name."""
        if not self.server.allows(self.request.host):
            raise tornado.web.HTTPError(403)


class Stream(LocalRequestHandler, tornado.websocket.WebSocketHandler):
    """A page's connection."""

    def check_origin(self, origin: str) -> bool:
        """Whether a page of this origin may connect."""
        return bool(self.server.allows(origin.removeprefix("http://")))

    def open(self, *_: str, **__: str) -> None:
        """Register the connection with the server."""
        self.server.admit(self)

    def send(self, message: str | bytes) -> Any:
        """Send a message; return its future, or None if the page is closed."""
        try:
            return self.write_message(message, binary=isinstance(message, bytes))
        except tornado.websocket.WebSocketClosedError:
            return None

    def on_message(self, message: str | bytes) -> None:
        """Messages from pages are ignored."""

    def on_close(self) -> None:
        """Remove the connection from the server."""
        self.server.leave(self)


class _Nowhere(LocalRequestHandler):
    def prepare(self) -> None:
        super().prepare()
        raise tornado.web.HTTPError(404)
