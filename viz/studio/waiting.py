"""Page that is served while the studio loads; it imports none of the libraries that take long to load."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from typing import Any

from viz.page.loopback import FIRST_PORT
from viz.studio.token_server import TokenHandler, TokenServer

WAITING = "X-Studio-Waiting"
"""Header of this page's answers; the studio's own page, which takes its place, does not have it."""

PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>studio: loading</title>
<style>
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; margin: 0 16px;
  display: grid; place-content: center; min-height: 90vh; }
p { margin: 4px 0; }
</style>
<p>The studio of <b>%s</b> is loading.</p><p id="words" role="status">%s</p>
<script>
const look = async () => {
  try {
    const answer = await fetch(location.href, { cache: "no-store" });
    if (!answer.headers.has("X-Studio-Waiting")) { location.reload(); return; }
    const page = new DOMParser().parseFromString(await answer.text(), "text/html");
    document.getElementById("words").textContent = page.getElementById("words").textContent;
  } catch { /* the servers change places */ }
  setTimeout(look, 300);
};
setTimeout(look, 300);
</script></html>"""


class WaitingPage(TokenServer):
    """Server of a page with the progress of the studio's start, at the studio's address and with its token.

    Args:
        name: Name of the scenario.
        port: First port to try; busy ports are skipped.

    Raises:
        SpaceRobotError: If no port is free.
    """

    def __init__(self, name: str, port: int = FIRST_PORT) -> None:
        self.name, self.words = name, "loading the libraries and the scenario"
        super().__init__(port)

    def handlers(self) -> list[Any]:
        """The page."""
        return [(r"/", _WaitingAnswer, {"server": self})]

    def telling(self, tell: Callable[[str], None]) -> Callable[[str], None]:
        """Function that reports words by another one, and on the page."""

        def both(words: str) -> None:
            self.words = words
            tell(words)

        return both


class _WaitingAnswer(TokenHandler):
    def get(self) -> None:
        self.set_header("Cache-Control", "no-store")
        self.set_header("Referrer-Policy", "no-referrer")
        self.set_header(WAITING, "1")
        self.write(PAGE % (escape(self.server.name), escape(self.server.words)))
