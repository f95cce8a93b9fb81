"""Many machines: chunks of a campaign on Dask's workers.

A chunk is a recipe and the draws of its samples. Only the calling process writes files. If a worker dies,
another one repeats its chunk, and nothing else is lost.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

from optim.campaign.rollouts.evaluator import CampaignEvaluator, SampleTable
from optim.campaign.run import CHUNK_S, ChunkQueue, first_size, sized
from optim.workers.cluster import connect, distributed_module, faults_of, submit, threads_of
from spacerobot.common.arrays import Array

AHEAD = 2  # chunks in flight for each thread of a worker: one runs, one waits


@dataclass(frozen=True)
class DaskExecutor:
    """Executor on Dask's workers.

    Attributes:
        address: Address for :func:`optim.workers.cluster.connect`.
        chunk_s: Target duration of a chunk [s].
        size: Number of samples of a chunk; None derives it from ``chunk_s``.
    """

    address: str
    chunk_s: float = CHUNK_S
    size: int | None = None

    def work(
        self, evaluator: CampaignEvaluator, draws: Array, chunks: ChunkQueue
    ) -> Iterator[tuple[int, SampleTable]]:
        """Tables of the chunks in order of completion; see :class:`optim.campaign.Executor`.

        Raises:
            SpaceRobotError: If Dask is not installed, cannot be reached, or a chunk fails on one worker after
                the other.
        """
        with connect(self.address) as client:
            # keep every worker busy, with few chunks in flight, and give out results as they come
            flight = distributed_module().as_completed([], loop=client.loop, with_results=False)
            pieces: dict[str, tuple[int, int]] = {}

            def fill(size: int) -> None:
                threads = threads_of(client)
                while len(pieces) < AHEAD * threads and (piece := chunks.take(size)) is not None:
                    future = submit(client, run_chunk, evaluator.recipe, draws[piece[0] : piece[1]])
                    pieces[future.key] = piece
                    flight.add(future)

            fill(self.size or first_size(evaluator))
            for future in flight:
                begin, end = pieces.pop(future.key)
                with faults_of(f"samples {begin} to {end - 1}"):
                    table, seconds = future.result()
                yield begin, table
                with faults_of("the rest"):
                    fill(self.size or sized(len(table), seconds, self.chunk_s))


def run_chunk(evaluator: CampaignEvaluator, draws: Array) -> tuple[SampleTable, float]:
    """Table of the samples of one chunk, and the duration of its rollouts [s].

    One thread rolls out, because a worker runs one chunk in each of its threads.
    """
    since = time.perf_counter()
    table = evaluator.evaluate(draws, threads=1)
    return table, time.perf_counter() - since
