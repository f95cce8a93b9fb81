"""Rows of parameters over threads, with progress and cancellation."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from typing import Protocol, TypedDict

import numpy as np

from spacerobot.compiled import usable_cores
from spacerobot.rollout.adjoint import AdjointEngine
from spacerobot.rollout.closed_loop_protocol import Array
from spacerobot.rollout.coincident_events import check_orders
from spacerobot.rollout.engines import Engine, StopFlag
from spacerobot.rollout.rollout_arrays import MOST_EVENTS, CoincidentInstants, Integers, RolloutArrays
from spacerobot.rollout.time_grid import TimeGrid

TASK_STEPS = 20_000
"""Maximum number of steps in a task, over all groups: long against Python's overhead, short to cancel."""


@dataclass(frozen=True)
class BatchProgress:
    """Progress of a batch.

    Attributes:
        done, total: Number of finished rollouts and of all rollouts.
        wall_s: Elapsed time [s].
    """

    done: int
    total: int
    wall_s: float

    @property
    def rate(self) -> float:
        """Rollouts per second."""
        return self.done / max(self.wall_s, 1e-9)


class Stop(Protocol):
    """Cancellation flag that is polled, such as ``threading.Event``."""

    def is_set(self) -> bool:
        """Whether to stop."""


Progress = Callable[[BatchProgress], object]


class Controls(TypedDict, total=False):
    """Keyword arguments of threaded computations; see :class:`Control`."""

    threads: int | None
    progress: Progress | None
    stop: Stop | None
    orders: bool
    accuracy: bool | None


@dataclass(frozen=True)
class Control:
    """Threads, progress reports, cancellation and derivative checks of a threaded computation.

    Attributes:
        threads: Number of threads; one for each usable core if None. Results are bit-identical for any
            number.
        progress: Called repeatedly with a :class:`BatchProgress`; returning False cancels the remaining
            rollouts.
        stop: Event (``threading.Event``) that cancels when set.
        orders: Whether coincident events are evaluated in both orders, so that derivatives are reported as
            coincident only where the two orders differ. Without it, derivatives through all coincident events
            are. The check costs a gradient a fraction of a rollout, and sensitivities a second evaluation.
        accuracy: Whether derivatives are computed again with half the step, so that their status reports
            errors due to the step. This takes three times as long; without it the status is ``unchecked``.
            The value of ``orders`` if None.
        compared: Paths of the derivatives that this comparison covers; all if None.
        backwards: Whether coincident events fire in the reverse order.
    """

    threads: int | None = None
    progress: Progress | None = None
    stop: Stop | None = None
    orders: bool = True
    accuracy: bool | None = None
    compared: Collection[str] | None = None
    backwards: bool = False

    @property
    def halves(self) -> bool:
        """Whether derivatives are computed again with half the step."""
        return self.orders if self.accuracy is None else self.accuracy

    @property
    def thread_count(self) -> int:
        """Number of threads."""
        return max(1, self.threads or usable_cores())


@dataclass(frozen=True)
class Samples:
    """Samples of each rollout: outputs by their indices in y, and the states on request."""

    rows: Sequence[int] = ()
    states: bool = False


@dataclass(frozen=True)
class BatchArrays:
    """Result of :func:`run_batch`: arrays, threads used and time taken in s."""

    raw: RolloutArrays
    threads: int
    wall_s: float


def run_one(engine: Engine, grid: TimeGrid, p: Array, estimate: bool) -> RolloutArrays:
    """Single rollout of parameters p (np,) with every state and output, and the states at all its events."""
    outputs = range(engine.kernel.size("outputs", "y"))
    raw = RolloutArrays.empty(engine.kernel, grid, 1, True, outputs)
    raw = replace(raw, error=np.zeros(1)) if estimate else raw
    event_capacity = MOST_EVENTS if engine.kernel.events else 0
    while True:  # once more where there were more events than room for them
        raw = raw.with_events(event_capacity)
        engine.rollouts(p[None, :], grid, raw, outputs, StopFlag())
        if raw.log.fired[0] <= event_capacity:
            break
        event_capacity = int(raw.log.fired[0])
    raw.check_start(engine.kernel.closure, p[None, :])
    return raw


def run_batch(
    engine: Engine,
    grid: TimeGrid,
    p: Callable[[slice], Array],
    total: int,
    samples: Samples,
    control: Control,
) -> BatchArrays:
    """Roll out ``total`` rows of parameters on some threads.

    Every group of lanes does the same arithmetic on any thread, so results depend neither on threads nor on
    N. ``p`` returns the full rows (n, np) of a piece when a thread starts it, since all rows at once may not
    fit in memory. Sensitivities with coincident events or jumps are computed in both orders.
    """
    raw, flag = RolloutArrays.empty(engine.kernel, grid, total, samples.states, samples.rows), StopFlag()
    raw = replace(raw, backwards=control.backwards)

    def work(piece: slice) -> int:
        parameters, part = p(piece), raw.part(piece)
        engine.rollouts(parameters, grid, part, samples.rows, flag)
        part.check_start(engine.kernel.closure, parameters)
        part.mark_coincident(engine.kernel, parameters)
        return raw.count(piece)

    longest = max(1, TASK_STEPS // grid.steps)
    pieces = fair_pieces(total, engine.lanes, longest, control.thread_count)
    seconds = run_tasks(work, pieces, total, flag, control)
    raw.cost[~raw.completed] = np.nan
    if engine.kernel.rate is not None and control.orders and len(rows := raw.coincident):
        parameters = np.vstack([p(slice(row, row + 1)) for row in rows])
        reverse_control = replace(control, progress=None, orders=False, backwards=True)
        reverse_arrays = run_batch(
            engine, grid, parameters.__getitem__, len(rows), samples, reverse_control
        ).raw
        raw.trust_same(
            rows, reverse_arrays, _derivatives(raw, rows), _derivatives(reverse_arrays, slice(None))
        )
    return BatchArrays(raw, control.thread_count, seconds)


def _derivatives(raw: RolloutArrays, rows: Integers | slice) -> Array:
    """Everything that a rollout of sensitivities gave (n, ...)."""
    r = raw.r[rows]
    return r if raw.y is None else np.hstack([r, raw.y[rows].reshape(len(r), -1)])


def run_gradients(
    engine: AdjointEngine, grid: TimeGrid, p: Array, seed: Array, control: Control
) -> tuple[RolloutArrays, Array]:
    """Costs of every row of p (N, np), and gradients (N, k) of their sum weighted by ``seed`` (N, nj)."""
    kernel = engine.kernel
    raw, flag = RolloutArrays.empty(kernel, grid, len(p), False, ()), StopFlag()
    raw = replace(raw, instants=CoincidentInstants.empty(len(p), kernel) if control.orders else None)
    gradient = np.full((len(p), kernel.size("setup_reverse", "pbar")), np.nan)

    def work(piece: slice) -> int:
        part = raw.part(piece)
        engine.gradients(p[piece], seed[piece], grid, part, gradient[piece], flag)
        part.check_start(kernel.closure, p[piece])
        return raw.count(piece)

    pieces = fair_pieces(len(p), engine.lanes, 1, control.thread_count)
    run_tasks(work, pieces, len(p), flag, control)
    lost = ~raw.completed
    raw.cost[lost], gradient[lost] = np.nan, np.nan
    check_orders(kernel, p, seed, raw)
    return raw, gradient


def fair_pieces(total: int, lanes: int, longest: int, threads: int) -> Iterator[slice]:
    """Cut ``range(total)`` into pieces of whole groups of lanes; the last group may be shorter.

    A piece is at most one thread's share of the remaining rows, so that no thread waits at the end for more
    than one group of another thread.

    Args:
        total, lanes: Number of rows, and rows in a group.
        longest: Maximum number of groups in a piece.
        threads: Number of threads that take pieces.
    """
    begin = 0
    while begin < total:
        remaining_groups = -(-(total - begin) // lanes)
        end = min(total, begin + lanes * min(longest, -(-remaining_groups // threads)))
        yield slice(begin, end)
        begin = end


def run_tasks(
    work: Callable[[slice], int],
    pieces: Iterator[slice],
    total: int,
    flag: StopFlag,
    control: Control,
) -> float:
    """Call ``work`` on pieces of ``range(total)`` from several threads, and return the wall time [s].

    Args:
        work: Function that computes one piece and returns the number of rows it completed.
        pieces, total: The pieces in order, and the total number of rows.
        flag: Stop flag; it is set on cancellation, and running pieces then return early.
        control: Threads, progress reports and cancellation.
    """
    threads, progress, stop = control.thread_count, control.progress, control.stop
    begin_s = time.perf_counter()
    completed_rows = 0
    with ThreadPoolExecutor(threads) as pool:
        pending: set[Future[int]] = set()
        try:
            while True:
                while len(pending) < 2 * threads and not flag.is_set and (piece := next(pieces, None)):
                    pending.add(pool.submit(work, piece))
                if not pending:
                    break
                finished, pending = wait(pending, timeout=0.1, return_when=FIRST_COMPLETED)
                completed_rows += sum(future.result() for future in finished)
                report = BatchProgress(completed_rows, total, time.perf_counter() - begin_s)
                if (progress and finished and progress(report) is False) or (stop and stop.is_set()):
                    flag.set()
        except BaseException:
            flag.set()
            raise
    return time.perf_counter() - begin_s
