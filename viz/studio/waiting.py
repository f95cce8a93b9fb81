"""Page that is served while the studio loads; it imports none of the libraries that take long to load."""

from __future__ import annotations

import time
from collections.abc import Callable
from html import escape
from typing import Any

from viz.page.loopback import FIRST_PORT
from viz.studio.token_server import TokenHandler, TokenServer

WAITING = "X-Studio-Waiting"
"""Header of this page's answers; the studio's own page, which takes its place, does not have it."""

PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>studio: %(name)s</title>
<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="icon" href="data:,">
<style>
:root { color-scheme: light dark; --ink: #16202b; --dim: #4d5b6a; --page: #fff; --accent: #0068a3; }
@media (prefers-color-scheme: dark) { :root {
  --ink: #e8edf3; --dim: #9aa8b8; --page: #0f151c; --accent: #56b4e9; } }
body { font: 16px/1.6 system-ui, sans-serif; margin: 0 16px; color: var(--ink); background: var(--page);
  display: grid; place-content: center; min-height: 90vh; }
h1 { font-size: 20px; margin: 0 0 8px; }
ol { list-style: none; margin: 0; padding: 0; color: var(--dim); }
li::before { content: "\\2713"; display: inline-block; width: 26px; }
li:last-child { color: var(--ink); }
li:last-child::before { content: ""; width: 12px; height: 12px; margin: 0 10px -2px 0;
  border: 2px solid var(--accent); border-right-color: transparent; border-radius: 50%%;
  animation: turn 1s linear infinite; }
@keyframes turn { to { transform: rotate(1turn); } }
@media (prefers-reduced-motion: reduce) { li::before { animation: none !important; } }
p { margin: 8px 0 0; color: var(--dim); font-size: 14px; }
</style>
<h1>The studio of %(name)s starts</h1>
<ol id="steps" role="status">%(steps)s</ol>
<p><output id="seconds">%(seconds)d</output> s. When it has started, each number can be changed,
and motion, curves and metrics follow.</p>
<script>
const begin = performance.now() - 1000 * Number(document.getElementById("seconds").textContent);
setInterval(() => {
  document.getElementById("seconds").textContent = ((performance.now() - begin) / 1000).toFixed(0);
}, 200);
const look = async () => {
  try {
    const answer = await fetch(location.href, { cache: "no-store" });
    if (!answer.headers.has("X-Studio-Waiting")) { location.reload(); return; }
    const page = new DOMParser().parseFromString(await answer.text(), "text/html");
    const steps = document.getElementById("steps"), now = page.getElementById("steps");
    if (steps.textContent !== now.textContent) steps.replaceWith(now);
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
        self.name, self.steps = name, list[str]()
        self._begin = time.monotonic()
        super().__init__(port)

    def handlers(self) -> list[Any]:
        """The page."""
        return [(r"/", _WaitingAnswer, {"server": self})]

    def page(self) -> str:
        """HTML of the page, with the steps that have begun."""
        seconds, steps = time.monotonic() - self._begin, self.steps or ["starting"]
        items = "".join(f"<li>{escape(step)}</li>" for step in steps)
        return PAGE % {"name": escape(self.name), "steps": items, "seconds": seconds}

    def telling(self, tell: Callable[[str], None]) -> Callable[[str], None]:
        """Function that reports words by another one, and on the page."""

        def both(words: str) -> None:
            if words:
                self.steps.append(words)
            tell(words)

        return both


class _WaitingAnswer(TokenHandler):
    def get(self) -> None:
        self.set_header("Cache-Control", "no-store")
        self.set_header("Referrer-Policy", "no-referrer")
        self.set_header(WAITING, "1")
        self.write(self.server.page())
