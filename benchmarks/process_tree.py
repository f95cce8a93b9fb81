"""Processor time of everything that a job starts, browsers and encoders among it (Linux)."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from pathlib import Path

PERIOD_S = 0.1  # a process that ends is missed by as much at most


def tree_s() -> dict[int, float]:
    """Processor time of each process that this one has started, and theirs, by number [s]."""
    children: dict[int, list[tuple[int, int]]] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text().rsplit(")", 1)[1].split()
            except OSError:
                continue
            spent = int(fields[11]) + int(fields[12])
            children.setdefault(int(fields[1]), []).append((int(entry.name), spent))
    found, open_ = {}, [os.getpid()]
    while open_:
        for process, spent in children.get(open_.pop(), []):
            found[process] = spent / os.sysconf("SC_CLK_TCK")
            open_.append(process)
    return found


def spent_s(job: Callable[[], object]) -> float:
    """Processor time of a job in this process and in all that it starts [s]."""
    before, own, latest, ended = tree_s(), os.times(), dict[int, float](), threading.Event()

    def watch() -> None:
        """Note the processes' times until the job has ended."""
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
    started = sum(spent - before.get(process, 0.0) for process, spent in latest.items())
    return started + now.user + now.system - own.user - own.system
