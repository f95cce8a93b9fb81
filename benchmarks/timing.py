"""Times to trust on a shared machine: processor time, medians of turns taken, ratios pair by pair."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Paired:
    """Median processor times of two jobs that took turns [s], and of their ratios, second over first."""

    first_s: float
    second_s: float
    ratio: float


def time_of(job: Callable[[], object]) -> float:
    """Time of one call on the clock [s]."""
    begin = time.perf_counter()
    job()
    return time.perf_counter() - begin


def cpu_time_of(job: Callable[[], object]) -> float:
    """Processor time that one call takes in this process, all its threads together [s]."""
    begin = time.process_time()
    job()
    return time.process_time() - begin


def paired(
    first: Callable[[], object],
    second: Callable[[], object],
    *,
    turns: int = 7,
    calls: tuple[int, int] = (1, 1),
) -> Paired:
    """Let two jobs take turns after a warm-up of each.

    ``calls`` is what each job's one call does; times are divided by it.
    """
    first(), second()
    pairs = [(cpu_time_of(first) / calls[0], cpu_time_of(second) / calls[1]) for _ in range(turns)]
    return Paired(
        statistics.median(a for a, _ in pairs),
        statistics.median(b for _, b in pairs),
        statistics.median(b / a for a, b in pairs),
    )
