"""Pictures of a page's scene, rendered by a headless Chromium."""

from __future__ import annotations

import base64
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from spacerobot.common.errors import ResultError
from viz.page.page import page
from viz.recording.browser import Browser, chromium

FINE, MOVING = 0, 3
"""Levels of ``viz/web/quality.js``: all that can be drawn, for one picture; and for many."""

_READY = "document.body?.dataset.ready === 'true'"


OPENED_PX = 640
"""Largest width of a page when it opens [pixels]."""


def resize(browser: Browser, width: int, height: int, pixel_ratio: float = 1.0) -> None:
    """Set the size of the page [pixels], and the pixels of the screen per pixel of the page."""
    size = {"width": width, "height": height, "deviceScaleFactor": pixel_ratio, "mobile": False}
    browser.call("Emulation.setDeviceMetricsOverride", **size)


def page_pictures(
    payload: Mapping[str, Any],
    times: Sequence[float],
    size_px: tuple[int, int],
    *,
    level: int = MOVING,
    kind: str = "jpeg",
    pixel_ratio: float = 1.0,
) -> Iterator[bytes]:
    """Encoded pictures of a page's scene at some times, without text and charts.

    Args:
        payload: Data of the page, from :func:`viz.page.animation.animation`.
        times: Times of the simulation [s].
        size_px: Width and height [pixels].
        level: Level of detail, 0 for the finest.
        kind: ``jpeg`` or ``png``.
        pixel_ratio: Pixels of a picture per pixel of the page, by which texts are enlarged.

    Raises:
        ResultError: If there is no Chromium, or it cannot draw in three dimensions.
    """
    width, height = size_px
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        if browser is None:
            raise ResultError("no Chromium on this computer; record with the built-in renderer")
        file = Path(folder) / "page.html"
        file.write_text(page(payload), encoding="utf-8")
        browser.call("Page.enable")
        # small until the page is staged: it draws itself until then
        page_width, page_height = width / pixel_ratio, height / pixel_ratio
        small = min(1.0, OPENED_PX / width)
        resize(browser, round(small * page_width), round(small * page_height), pixel_ratio)
        browser.call("Page.navigate", url=f"{file.as_uri()}#t=0&play=0&quality={level}")
        browser.wait_for(_READY)
        if browser.evaluate("document.body.classList.contains('blind')"):
            raise ResultError(
                "this Chromium cannot draw in three dimensions; record with the built-in renderer"
            )
        resize(browser, round(page_width), round(page_height), pixel_ratio)
        browser.evaluate(f"spacerobotFilm.begin({level})")
        for time in times:
            picture = browser.evaluate(f"spacerobotFilm.picture({time:.9g}, {width}, 'image/{kind}')")
            yield base64.b64decode(picture.partition(",")[2])
