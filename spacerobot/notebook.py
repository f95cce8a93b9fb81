"""How objects show themselves in a notebook: a small table."""

from __future__ import annotations

import html
from collections.abc import Iterable


def html_table(caption: str, rows: Iterable[tuple[str, object]]) -> str:
    """HTML table of names and what belongs to them, texts escaped; what has nothing is left out.

    Parameters
    ----------
    caption
        What is shown.
    rows
        Names and what stands beside them, written by ``str``.
    """
    shown = "".join(
        f"<tr><th style='text-align:left'>{html.escape(name)}</th><td>{html.escape(str(value))}</td></tr>"
        for name, value in rows
        if value != ""
    )
    return f"<table><caption>{html.escape(caption)}</caption>{shown}</table>"
