"""The studio's server: the page and its session, for this computer and whoever knows the token."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from spacerobot.scene import Scene
from viz.page.animation import still
from viz.page.loopback import FIRST_PORT, Stream
from viz.page.page import page
from viz.studio.messages import MOST_BYTES
from viz.studio.prepared_design import Origin
from viz.studio.session import StudioSession
from viz.studio.token_server import TokenHandler, TokenServer
from viz.studio.waiting import WaitingPage

MOST_BEHIND = 2
"""Number of unsent messages to a page from which its requests wait."""


class Studio(TokenServer):
    """Server of a page on which every number of a scene can be changed.

    In addition to the checks of :class:`~viz.page.loopback.Loopback`, a request must contain the token in the
    page's address, which no other program on this computer knows.

    Args:
        origin: Scene from which designs differ.
        folder: Only folder in which files are written.
        port: First port to try; busy ports are skipped.
        tell: Callback for a message before each long step of the start.
        waiting: Page served until now, whose address the studio takes over; None without one.

    Raises:
        SpaceRobotError: If the scene cannot be rolled out, or no port is free.
    """

    largest_message = MOST_BYTES

    def __init__(
        self,
        origin: Origin,
        folder: Path,
        port: int = FIRST_PORT,
        tell: Callable[[str], None] = lambda _: None,
        waiting: WaitingPage | None = None,
    ) -> None:
        self.session, token = StudioSession(origin, folder, tell), None
        if waiting is not None:
            token, port = waiting.token, waiting.port
            waiting.close()
        super().__init__(port, token)

    @property
    def scene(self) -> Scene:
        """Scene from which designs differ."""
        return self.session.origin.scene

    def handlers(self) -> list[Any]:
        """The page and its connection."""
        arguments = {"server": self}
        return [(r"/", _StudioPage, arguments), (r"/studio", _Connection, arguments)]

    def later(self, call: Callable[[], None]) -> None:
        """Call something in the server's thread."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(call)

    def close(self) -> None:
        """Stop the server and its jobs; open pages keep their content."""
        self.session.close()
        super().close()


class _StudioPage(TokenHandler):
    def get(self) -> None:
        self.set_header("Cache-Control", "no-store")
        self.set_header("Referrer-Policy", "no-referrer")
        # the scene as it begins, until its motion is there
        waiting = still(self.server.scene, about="the motion is being simulated")
        self.write(page(waiting | {"studio": True}, connect=f"ws://{self.request.host}"))


class Peer:
    """A connected page, as the session's thread sees it."""

    def __init__(self, server: Studio, stream: Stream) -> None:
        self._server, self._stream = server, stream
        self._sending = 0
        self._lock = threading.Lock()

    @property
    def behind(self) -> bool:
        """Whether :data:`MOST_BEHIND` messages or more have not been sent completely."""
        return self._sending >= MOST_BEHIND

    def send(self, parts: Sequence[str | bytes]) -> None:
        """Send a message; from any thread."""
        with self._lock:
            self._sending += 1
        self._server.later(lambda: self._write(parts))

    def _write(self, parts: Sequence[str | bytes]) -> None:
        written = [self._stream.send(part) for part in parts]
        if written[-1] is None:
            self._taken()
        else:
            written[-1].add_done_callback(self._taken)

    def _taken(self, done: Any = None) -> None:
        if done is not None and not done.cancelled():
            done.exception()  # a page that went meanwhile
        with self._lock:
            self._sending -= 1
        self._server.session.wake()


class _Connection(TokenHandler, Stream):
    peer: Peer

    def open(self, *_: str, **__: str) -> None:
        super().open()
        self.peer = Peer(self.server, self)
        self.server.session.greet(self.peer)

    def on_message(self, message: str | bytes) -> None:
        self.server.session.ask(self.peer, message)

    def on_close(self) -> None:
        super().on_close()
        if hasattr(self, "peer"):
            self.server.session.leave(self.peer)
