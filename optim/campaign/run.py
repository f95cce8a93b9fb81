"""Run of a campaign in chunks of a target duration; each is stored when done, so that a run resumes."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from optim.campaign.rollouts.evaluator import CampaignEvaluator, SampleTable, all_draws, build_evaluator
from optim.campaign.rollouts.gain_sets import Gains
from optim.campaign.store.folder import Interval, check_place, open_store
from optim.campaign.store.run_settings import notes_of
from spacerobot.common.arrays import Array
from spacerobot.common.files import StrPath
from spacerobot.scene import Scene

CHUNK_S = 4.0  # long enough to hide what a chunk costs, short enough to lose
FIRST = 128  # rollouts of the first chunk, from which the rate is learnt
MPC_SAMPLES = 16  # of a chunk in which plans are solved
CHUNK_BYTES = 32_000_000  # of series in a chunk, of which several copies exist for a moment
ROLLING_OUT = "rolling out"
"""The phase in which samples are kept."""
GRAIN = 64  # samples by which chunks grow: whole groups of lanes for every thread


@dataclass(frozen=True)
class CampaignProgress:
    """Progress of a campaign.

    Attributes:
        phase: ``building the closed loop``, ``rolling out`` or ``merging``.
        done, total: Samples, each rolled out once for every set of gains; 0 where a phase begins.
        rate: Rollouts per second since this process began.
        left_s: Time likely left.
    """

    phase: str
    done: int = 0
    total: int = 0
    rate: float = math.nan
    left_s: float = math.nan

    def __str__(self) -> str:
        """Progress in one line, as ``progress=print`` shows it."""
        if not self.total:
            return self.phase
        done = f"{self.done} of {self.total} samples, {100 * self.done / self.total:.0f} %"
        return f"{done}, {self.rate:.0f} rollouts a second, about {self.left_s:.0f} s left"


class ChunkQueue:
    """Samples still to do, handed out in pieces of any size up to ``most``, in order."""

    def __init__(self, missing: Sequence[Interval], most: int | None = None) -> None:
        self._left = list(reversed(missing))
        self._most = most

    def take(self, size: int) -> Interval | None:
        """Next chunk of at most ``size`` samples that fits into memory; None if none is left."""
        if not self._left:
            return None
        begin, end = self._left.pop()
        cut = min(end, begin + max(1, size if self._most is None else min(size, self._most)))
        if cut < end:
            self._left.append((cut, end))
        return begin, cut


class Executor(Protocol):
    """Executor of chunks: this process, or many machines."""

    def work(
        self, evaluator: CampaignEvaluator, draws: Array, chunks: ChunkQueue
    ) -> Iterator[tuple[int, SampleTable]]:
        """Table of every chunk with the index of its first sample, in any order.

        Args:
            evaluator: Evaluator of the campaign.
            draws: Draws of all samples (N, k).
            chunks: Queue of the chunks that remain.
        """


@dataclass(frozen=True)
class LocalExecutor:
    """Executor in this process.

    Attributes:
        threads: Number of threads; one for each usable core if None.
        chunk_s: Target duration of a chunk [s].
        size: Number of samples of a chunk, if it is not chosen by its duration.
    """

    threads: int | None = None
    chunk_s: float = CHUNK_S
    size: int | None = None

    def work(
        self, evaluator: CampaignEvaluator, draws: Array, chunks: ChunkQueue
    ) -> Iterator[tuple[int, SampleTable]]:
        """Table of every chunk with the index of its first sample, in order; see :class:`Executor`.

        Args:
            evaluator: Evaluator of the campaign.
            draws: Draws of all samples (N, k).
            chunks: Queue of the chunks that remain.
        """
        size = self.size or first_size(evaluator)
        while (piece := chunks.take(size)) is not None:
            since = time.perf_counter()
            table = evaluator.evaluate(draws[piece[0] : piece[1]], self.threads)
            yield piece[0], table
            if evaluator.has_updates:
                continue  # chunks of few seconds would leave processes without work
            size = self.size or sized(len(table), time.perf_counter() - since, self.chunk_s)


def first_size(evaluator: CampaignEvaluator) -> int:
    """Number of samples in the first chunk, whose duration is unknown."""
    return MPC_SAMPLES if evaluator.has_updates else max(1, FIRST // len(evaluator.members))


def most_samples(evaluator: CampaignEvaluator) -> int | None:
    """Maximum number of samples whose series fit into a chunk; None if no series is recorded."""
    each = evaluator.bytes_per_sample
    return max(1, CHUNK_BYTES // each) if each else None


def sized(samples: int, seconds: float, chunk_s: float) -> int:
    """Number of samples of the next chunk, so that it takes about ``chunk_s`` [s].

    It is at most eight times that of the last chunk, and from ``GRAIN`` on a multiple of ``GRAIN``.

    Args:
        samples, seconds: Number of samples and duration [s] of the last chunk.
        chunk_s: Target duration [s].
    """
    wish = samples * chunk_s / max(seconds, 1e-6)
    wish = min(wish, 8 * samples)
    return max(1, int(wish)) if wish < GRAIN else GRAIN * int(wish // GRAIN)


@dataclass(frozen=True)
class CampaignRun:
    """State of a campaign after a call.

    Attributes:
        folder: Folder of the store; read it with :func:`optim.campaign.load_campaign`.
        evaluator: Evaluator of the samples.
        done, total: Numbers of finished samples and of all samples.
        interrupted: Whether it was interrupted; a call with the same folder resumes it.
    """

    folder: Path
    evaluator: CampaignEvaluator
    done: int
    total: int
    interrupted: bool


def run_campaign(
    scene: Scene,
    folder: StrPath,
    *,
    gains: Gains | None = None,
    executor: Executor | None = None,
    progress: Callable[[CampaignProgress], object] | None = None,
) -> CampaignRun:
    """Roll out every sample of a campaign that is not in its folder yet.

    An interrupted campaign resumes when it is called again. Its numbers do not depend on interruptions,
    chunks, threads or workers.

    Args:
        scene: A scene whose scenario has a ``campaign`` section.
        folder: Folder of the store; created if it does not exist.
        gains: Sets of gains by name, each of changes by dotted path; the section's if None.
        executor: Executor of the chunks; this process if None.
        progress: Callback at the beginning of each phase, and after each chunk.

    Raises:
        ScenarioError: If the campaign does not fit the scene.
        ResultError: If the folder holds another campaign, is in use, or cannot be written.
    """
    folder = Path(folder)
    say = progress or repr
    check_place(folder)
    say(CampaignProgress("building the closed loop"))
    evaluator = build_evaluator(scene, gains)
    draws = all_draws(evaluator)
    notes = notes_of(evaluator)
    with open_store(folder, evaluator.identity(draws), len(draws), notes) as store:
        before, since, interrupted = store.done, time.perf_counter(), False
        chunks = ChunkQueue(store.missing, most_samples(evaluator))
        say(CampaignProgress(ROLLING_OUT))
        try:
            for begin, table in (executor or LocalExecutor()).work(evaluator, draws, chunks):
                store.add(begin, table)
                done, total, sets = store.done, len(draws), len(evaluator.members)
                per_second = (done - before) / max(time.perf_counter() - since, 1e-9)
                left_s = (total - done) / per_second
                say(CampaignProgress(ROLLING_OUT, done, total, sets * per_second, left_s))
        except KeyboardInterrupt:
            interrupted = True
        say(CampaignProgress("merging"))
        store.merge(evaluator, notes["about"])
        return CampaignRun(folder, evaluator, store.done, len(draws), interrupted)
