"""One self-contained page that plays a result: MeshCat and this project's player, without network."""

from __future__ import annotations

import html
import json
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from spacerobot.common.errors import SpaceRobotError
from spacerobot.common.files import StrPath, write_text
from spacerobot.result import Result, note_derived
from viz.page.animation import animation
from viz.page.es_modules import joined
from viz.page.meshcat_scene import encoded, script_hash

PLAYER, STUDIO = "main.js", "studio/main.js"
"""Entry modules of a page of results, and of a studio's page."""

CHARTS = "vendor/uPlot.iife.min.js"
"""Chart library."""

STYLES = ("vendor/uPlot.min.css", "page.css", "studio/studio.css")
"""Style sheets, in order."""


def animation_page(*results: Result, title: str | None = None, autoplay: bool = True) -> str:
    """HTML of a page that plays one result, or compares several; it needs no network.

    A suffix ``#t=3`` of its address shows it paused at 3 s; the page updates this suffix.

    Raises:
        ResultError: If the results cannot be compared.
    """
    return page(animation(*results, title=title, autoplay=autoplay))


def write_animation(result: Result, path: StrPath, *others: Result, title: str | None = None) -> None:
    """Write the page of :func:`animation_page` of a result, or of several compared.

    Raises:
        ResultError: If the file cannot be written or the results cannot be compared.
    """
    write_text(path, animation_page(result, *others, title=title))
    note_derived([each.folder for each in (result, *others)], [path])


def page(payload: Mapping[str, Any], *, connect: str = "'none'") -> str:
    """HTML of the player with its data.

    Args:
        payload: Data made by :func:`viz.page.animation.animation`.
        connect: Allowed connections of the page, as a CSP source expression; none by default.
    """
    entry = STUDIO if payload.get("studio") else PLAYER
    parts = {
        "policy": policy(connect, entry=entry),
        "title": html.escape(str(payload["title"])),
        "style": "".join(map(_web, STYLES)),
        "payload": json_text(payload),
        "meshcat": meshcat_script(),
        "charts": _web(CHARTS),
        "player": player_script(entry),
    }
    return fill(_web("page.html"), parts)


def policy(connect: str = "'none'", *, entry: str = PLAYER) -> str:
    """Content Security Policy: only the player's own scripts run, and nothing is fetched."""
    scripts = " ".join(map(script_hash, (meshcat_script(), _web(CHARTS), player_script(entry))))
    return (
        f"default-src 'none'; script-src {scripts}; style-src 'unsafe-inline'; img-src data: blob:; "
        f"connect-src {connect}; base-uri 'none'; form-action 'none'"
    )


def fill(template: str, parts: Mapping[str, str]) -> str:
    """Template with ``@@name@@`` replaced; inserted text is not searched again."""
    pieces = template.split("@@")
    return "".join(piece if k % 2 == 0 else parts[piece] for k, piece in enumerate(pieces))


def json_text(data: Any) -> str:
    """JSON text that is safe inside a script element; arrays are encoded in base 64."""
    text = json.dumps(data, allow_nan=False, separators=(",", ":"), default=encoded)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


@cache
def meshcat_script() -> str:
    """MeshCat's viewer script from its package."""
    spec = find_spec("meshcat")  # found, not imported: its import starts loading a server
    if spec is None or spec.origin is None:
        raise SpaceRobotError("the package meshcat is not installed")
    path = Path(spec.origin).parent / "viewer" / "dist" / "main.min.js"
    return path.read_text(encoding="utf-8")


@cache
def player_script(entry: str = PLAYER) -> str:
    """Script of the player in its own scope; ``entry`` is the module to run."""
    return joined(entry, _web)


@cache
def _web(name: str) -> str:
    return (files("viz") / "web" / name).read_text(encoding="utf-8")
