"""Live viewer: the animated page, served only to this computer, with data from a running program."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from spacerobot.result import Result
from spacerobot.scene import Scene
from viz.page.animation import animation, still
from viz.page.loopback import FIRST_PORT, LocalRequestHandler, Loopback, Stream
from viz.page.page import json_text, page


class LiveViewer(Loopback):
    """A page in the browser that a program fills; see :class:`~viz.page.loopback.Loopback`.

    Args:
        port: First port to try; a busy one is stepped over.

    Raises:
        SpaceRobotError: If no port is free.
    """

    def __init__(self, port: int = FIRST_PORT) -> None:
        self._shown = self._message = ""
        self._connected = threading.Event()
        super().__init__(port)

    def handlers(self) -> list[Any]:
        """The page and its stream."""
        return [(r"/", _Page, {"server": self}), (r"/stream", Stream, {"server": self})]

    def tell(self, text: str) -> None:
        """Display a progress message until a scene is shown; for ``simulate(..., progress=viewer.tell)``.

        A percentage in the text, such as ``40 %``, is displayed as a bar as well.
        """
        self._send({"tell": text})

    def show_scene(self, scene: Scene) -> None:
        """Show a scene's initial state."""
        self._send({"show": still(scene)})

    def show(self, *results: Result) -> None:
        """Show a result, or compare several, in place of the present content.

        Raises:
            ResultError: If the results cannot be compared.
        """
        self.show_data(animation(*results))

    def show_data(self, data: dict[str, Any]) -> None:
        """Show data made by :func:`viz.page.animation.animation`."""
        self._send({"show": data})

    def wait_for_page(self, timeout_s: float | None = None) -> bool:
        """Wait until a browser shows the page; whether one does."""
        return self._connected.wait(timeout_s)

    def admit(self, stream: Stream) -> None:
        """Send a new page the present content and message."""
        for text in filter(None, (self._shown, self._message)):
            stream.send(text)
        super().admit(stream)
        self._connected.set()

    def _send(self, message: dict[str, Any]) -> None:
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._broadcast, json_text(message), "show" in message)

    def _broadcast(self, text: str, shows: bool) -> None:
        """Send a message to every page, and store it for pages that open later."""
        if shows:
            self._shown, self._message = text, ""
        else:
            self._message = text
        for stream in list(self._streams):
            stream.send(text)


class _Page(LocalRequestHandler):
    def get(self) -> None:
        waiting = {"title": "spacerobot", "about": "waiting for a result", "runs": [], "live": True}
        self.set_header("Cache-Control", "no-store")
        self.write(page(waiting, connect=f"ws://{self.request.host}"))


@contextmanager
def view_run(scene: Scene, *, port: int = FIRST_PORT) -> Iterator[LiveViewer]:
    """Viewer in the browser of a scene while it is simulated; see :class:`LiveViewer` for ``port``.

    Examples:
        >>> with view_run(scene) as viewer:  # doctest: +SKIP
        ...     result = simulate(scene, progress=viewer.tell)
        ...     viewer.show(result)
        ...     viewer.wait()
    """
    with LiveViewer(port) as viewer:
        viewer.show_scene(scene)
        viewer.open()
        yield viewer
