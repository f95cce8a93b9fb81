"""Populations over threads."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from optim.objectives import OBJECTIVE
from optim.protocol import Array
from spacerobot.rollout import Rollout
from spacerobot.rollout.batch import usable_cores

LEAST_SHARE = 8  # rollouts of a thread: the lanes of the widest vectors


def roll_out(rollout: Rollout, paths: Sequence[str], rows: Array, threads: int | None) -> dict[str, Array]:
    """Objective (N,) and measures (N, n) of rows (N, k) of parameters, shared evenly between threads.

    A batch is cut into tasks of many rollouts each, too few for a population; so each thread gets a batch of
    its own here. The values do not depend on it.
    """
    count = max(1, min(threads or usable_cores(), len(rows) // LEAST_SHARE))
    shares = np.array_split(rows, count)
    with ThreadPoolExecutor(count) as pool:
        batches = list(pool.map(lambda share: rollout.batch(paths, share, threads=1), shares))
    found = [{OBJECTIVE: batch.costs[OBJECTIVE], **batch.measures} for batch in batches]
    return {name: np.concatenate([part[name] for part in found]) for name in found[0]}
