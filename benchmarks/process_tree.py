"""Processor time of all processes that a job starts, such as browsers and encoders (Linux)."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from pathlib import Path

PERIOD_S = 0.1  # largest time of a process that is missed at its end


def tree_s() -> dict[int, float]:
    """Processor times of all descendants of this process, by process number [s]."""
    children: dict[int, list[tuple[int, int]]] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text().rsplit(")", 1)[1].split()
            except OSError:
                continue
            ticks = int(fields[11]) + int(fields[12])
            children.setdefault(int(fields[1]), []).append((int(entry.name), ticks))
    times, open_ = {}, [os.getpid()]
    while open_:
        for process, ticks in children.get(open_.pop(), []):
            times[process] = ticks / os.sysconf("SC_CLK_TCK")
            open_.append(process)
    return times


def spent_s(job: Callable[[], object]) -> float:
    """Processor time of a job in this process and in all that it starts [s]."""
    before, begin, latest, ended = tree_s(), os.times(), dict[int, float](), threading.Event()

    def watch() -> None:
        """Record the processes' times until the job has ended."""
        while not ended.wait(PERIOD_S):
            latest.update(tree_s())

    watching = threading.Thread(target=watch)
    watching.start()
    try:
        job()
        latest.update(tree_s())
    finally:
        ended.set()
        watching.join()
    now = os.times()
    children_s = sum(spent - before.get(process, 0.0) for process, spent in latest.items())
    return children_s + now.user + now.system - begin.user - begin.system
