"""Threads of this process."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from optim.workers.workers import LANES, Arrays, Ended, Operation, Portable
from spacerobot.common.arrays import Array
from spacerobot.compiled import usable_cores


@dataclass(frozen=True)
class Threads:
    """Threads of this process.

    Attributes:
        threads: Number of threads; one for each usable core if None.
    """

    threads: int | None = None

    def map(self, problem: Portable, operation: Operation, rows: Array, *, grain: int = LANES) -> Arrays:
        """Results of an operation on rows, split evenly between threads; see :class:`optim.workers.Workers`.

        Args:
            problem: Problem that the operation is applied to.
            operation: Operation on rows, computed for each row.
            rows: Rows, (N, n).
            grain: Smallest number of rows per thread.

        Returns:
            Mapping: Arrays by name with N as their first axis.
        """
        count = max(1, min(self.threads or usable_cores(), len(rows) // grain))
        if count == 1:
            return operation(problem, rows)
        with ThreadPoolExecutor(count) as pool:
            results = list(pool.map(lambda share: operation(problem, share), np.array_split(rows, count)))
        return joined(results)

    def together(self, searches: Sequence[Callable[[], Ended]]) -> list[Ended]:
        """One after the other, since each of them uses all threads."""
        ended: list[Ended] = []
        for search in searches:
            ended.append(search())
            if ended[-1].status == "interrupted":
                break
        return ended


def joined(parts: Sequence[Arrays]) -> Arrays:
    """Arrays of pieces, one after the other."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
