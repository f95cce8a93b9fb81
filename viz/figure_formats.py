"""Formats of figures' files, checked without Matplotlib."""

from __future__ import annotations

from collections.abc import Iterable

from spacerobot.common.errors import ResultError, near_names

FORMATS = ("pdf", "svg", "png")


def check_formats(formats: Iterable[str]) -> None:
    """Check formats of files.

    Raises:
        ResultError: If a format is unknown.
    """
    for form in formats:
        if form not in FORMATS:
            raise ResultError(f"no format {form!r}; {near_names(form, FORMATS)}")
