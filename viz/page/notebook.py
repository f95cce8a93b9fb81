"""Animations of results in notebook cells."""

from __future__ import annotations

import html
from dataclasses import dataclass

from spacerobot.result import Result
from viz.page.page import animation_page


@dataclass(frozen=True)
class EmbeddedPage:
    """An animated page inside another one.

    Attributes:
        page: Its HTML.
        height_px: Height of the frame.
    """

    page: str
    height_px: int = 600

    def __repr__(self) -> str:
        """Size of the page, in one line."""
        return f"<Embedded page of {len(self.page) / 1e6:.1f} MB>"

    def _repr_html_(self) -> str:
        return frame(self.page, self.height_px)


def embed(*results: Result, height_px: int = 600) -> EmbeddedPage:
    """Animation of one result, or of several compared, for the last line of a notebook cell.

    It needs no server and stays in the saved notebook.

    Raises:
        ResultError: If the results cannot be compared.
    """
    return EmbeddedPage(animation_page(*results, autoplay=False), height_px)


def frame(page: str, height_px: int) -> str:
    """Frame element with a whole page, whose scripts cannot access anything outside it."""
    return (
        f'<iframe loading="lazy" sandbox="allow-scripts allow-downloads" title="animation" '
        f'style="width:100%;height:{height_px}px;border:0" '
        f'srcdoc="{html.escape(page)}"></iframe>'
    )
