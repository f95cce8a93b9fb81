"""Times that are reproducible on a shared machine: processor times, medians over turns, ratios of pairs."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Paired:
    """Median processor times of two jobs in turns [s], and median of their ratios, second over first."""

    first_s: float
    second_s: float
    ratio: float


def time_of(job: Callable[[], object]) -> float:
    """Wall time of one call [s]."""
    begin = time.perf_counter()
    job()
    return time.perf_counter() - begin


def cpu_time_of(job: Callable[[], object]) -> float:
    """Processor time of one call in this process, all threads together [s]."""
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
    """Median processor times of two jobs that take turns, after a warm-up of each.

    Args:
        first, second: The jobs.
        turns: Number of turns.
        calls: Number of repetitions in one call of each job, by which its times are divided.
    """
    first(), second()
    pairs = [(cpu_time_of(first) / calls[0], cpu_time_of(second) / calls[1]) for _ in range(turns)]
    return Paired(
        statistics.median(a for a, _ in pairs),
        statistics.median(b for _, b in pairs),
        statistics.median(b / a for a, b in pairs),
    )
