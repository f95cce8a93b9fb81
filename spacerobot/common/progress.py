"""Progress: printed reports, and compilations reported to listeners such as the command line."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

Listener = Callable[[int, int], None]
"""Callback with the number of compiled sources and the number of all sources."""

_listeners: list[Listener] = []  # of the process, since any thread may compile

INTERVAL_S = 1.0
"""Minimum time between two printed reports of one stage [s]."""

_last_printed: dict[str, Any] = {"stage": "", "time_s": 0.0}  # of the process


def print_progress(report: object) -> None:
    """Print a report of progress: the first one of each stage, and then at most one a second.

    Functions with an argument ``progress`` accept it: ``sr.tune(scene, progress=sr.print_progress)``. With
    ``print`` itself, a search may print hundreds of reports a second. A stage is the text in front of the
    first number.

    Args:
        report: Text of the report, or an object whose text it is.
    """
    text, now_s = str(report), time.monotonic()
    stage = re.split(r"\d", text, maxsplit=1)[0]
    if stage != _last_printed["stage"] or now_s >= _last_printed["time_s"] + INTERVAL_S:
        _last_printed.update(stage=stage, time_s=now_s)
        print(text, flush=True)


@contextmanager
def hearing(listener: Listener) -> Iterator[None]:
    """Report the compilations of this process to a listener during the block."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)


def tell(done: int, total: int) -> None:
    """Report progress to all listeners."""
    for listener in tuple(_listeners):
        listener(done, total)
