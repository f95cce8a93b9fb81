"""Arrays that engines fill."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from spacerobot.rollout.closed_loop_protocol import Array
from spacerobot.rollout.initial_gaps import Closure
from spacerobot.rollout.kernel import Kernel
from spacerobot.rollout.time_grid import TimeGrid

Integers = npt.NDArray[np.int64]

COMPLETED, DIVERGED, ENDED, CHATTERING = range(4)
"""Status codes: reached the last sample, diverged, ended by an event, ended by too many events."""

GRAZING, COINCIDENT, AT_END = 1, 2, 3
"""Gradient warnings: a guard only grazed zero; two coincident events may change order; an event coincides
with the rollout's end."""

SAME, FAINT, NOTHING = 1e-6, 1e-2, 1e-12
"""Relative tolerance of equal derivatives; part of the largest that is added to it; absolute tolerance."""

MOST_EVENTS = 64
"""Maximum number of events recorded per rollout of a batch; later ones are only counted."""

TOGETHER = 1e-9
"""Time within which two events are coincident [s]."""

MOST_INSTANTS, MAX_OCCURRENCES = 256, 16
"""Maximum number of coincident instants recorded per rollout, and of events and jumps at each instant."""


@dataclass(frozen=True)
class EventLog:
    """Event records of rollouts, up to a maximum number for each.

    Attributes:
        fired: Number of events in each rollout, shape (N,).
        event, when: Event indices and times [s], shape (N, most), -1 and NaN beyond the last event.
        jump: States before and after each event, shape (N, most, 2, nx), None if not requested.
        gradient_warning: Code of the gradient warning (0 for none) and index of the event, shape (N, 2).
    """

    fired: Integers
    event: Integers
    when: Array
    jump: Array | None
    gradient_warning: Integers

    @classmethod
    def empty(cls, count: int, most: int, nx: int | None) -> EventLog:
        """Empty log for up to ``most`` events per rollout, with states of ``nx`` entries unless None."""
        event, when = np.full((count, most), -1, dtype=np.int64), np.full((count, most), np.nan)
        jump = None if nx is None else np.full((count, most, 2, nx), np.nan)
        fired, gradient_warning = np.zeros(count, dtype=np.int64), np.zeros((count, 2), dtype=np.int64)
        return cls(fired, event, when, jump, gradient_warning)

    def part(self, rows: slice) -> EventLog:
        """View of some rollouts."""
        jump = None if self.jump is None else self.jump[rows]
        return EventLog(
            self.fired[rows], self.event[rows], self.when[rows], jump, self.gradient_warning[rows]
        )


@dataclass(frozen=True)
class CoincidentInstants:
    """Instants with several events or jumps, or one with others close by, from the last one backwards.

    Attributes:
        count: Number of such instants in each rollout, shape (N,).
        records: Records of the latest of them, shape (N, most); fields as in ``loops/adjoint.hpp``.
    """

    count: Integers
    records: npt.NDArray[np.void]

    @classmethod
    def empty(cls, count: int, kernel: Kernel) -> CoincidentInstants:
        """Empty records for ``count`` rollouts."""
        nx, modes = kernel.scale.size, len(kernel.switches) + len(kernel.jumps)
        sizes = {
            "occurrence": MAX_OCCURRENCES,
            "root": MAX_OCCURRENCES,
            "mode": modes + 1,
            "met": kernel.peaks + 1,
            "before": nx,
            "bar": nx,
        }
        numbers = [(name, np.float64) for name in ("first", "last", "missed", "number")]
        form = np.dtype([*numbers, *((name, np.float64, (size,)) for name, size in sizes.items())])
        return cls(np.zeros(count, dtype=np.int64), np.zeros((count, MOST_INSTANTS), dtype=form))

    def part(self, rows: slice) -> CoincidentInstants:
        """View of some rollouts."""
        return CoincidentInstants(self.count[rows], self.records[rows])


@dataclass(frozen=True)
class RolloutArrays:
    """Arrays that an engine fills, one row for each rollout.

    Attributes:
        x, y: Samples of the state (N, nt, nx) and of outputs (N, nt, rows), None if not requested; NaN after
            divergence, and from an event on that ended the rollout.
        r, cost: Measures (N, nr) and costs (N, nj).
        done: Number of completed steps, shape (N,); -1 for a rollout that did not run.
        reached: Time of the last valid state [s], shape (N,); the time of the last sample if the rollout
            completed.
        status: Status code of each rollout, shape (N,).
        gaps: Initial gaps of grasps that may begin open (N, n) [m].
        log: Event records.
        error: Largest estimate of a step's error, shape (N,), None if not requested.
        backwards: Whether coincident events fire in the reverse order.
        instants: Instants at which a gradient may depend on the order of events, None if not requested.
    """

    x: Array | None
    y: Array | None
    r: Array
    cost: Array
    done: Integers
    reached: Array
    status: Integers
    gaps: Array
    log: EventLog
    error: Array | None = None
    backwards: bool = False
    instants: CoincidentInstants | None = None

    @classmethod
    def empty(
        cls, kernel: Kernel, grid: TimeGrid, count: int, states: bool, rows: Sequence[int]
    ) -> RolloutArrays:
        """Arrays of NaN for ``count`` rollouts, without error estimates and states at events."""
        samples = grid.intervals + 1
        nx, nr, nj = kernel.nx + kernel.integrals, kernel.size("objective", "r"), len(kernel.costs)
        return cls(
            np.full((count, samples, nx), np.nan) if states else None,
            np.full((count, samples, len(rows)), np.nan) if len(rows) else None,
            np.full((count, nr), np.nan),
            np.full((count, nj), np.nan),
            np.full(count, -1, dtype=np.int64),
            np.full(count, np.nan),
            np.full(count, DIVERGED, dtype=np.int64),
            np.full((count, len(kernel.closure.largest)), np.nan),
            EventLog.empty(count, MOST_EVENTS if kernel.events else 0, None),
        )

    def part(self, rows: slice) -> RolloutArrays:
        """View of some rollouts."""
        x = None if self.x is None else self.x[rows]
        y = None if self.y is None else self.y[rows]
        error = None if self.error is None else self.error[rows]
        reductions = (self.r[rows], self.cost[rows], self.done[rows], self.reached[rows], self.status[rows])
        instants = None if self.instants is None else self.instants.part(rows)
        return RolloutArrays(
            x, y, *reductions, self.gaps[rows], self.log.part(rows), error, self.backwards, instants
        )

    def with_events(self, most: int) -> RolloutArrays:
        """Copy with a log for up to ``most`` events per rollout, and their states if states are sampled."""
        nx = None if self.x is None else self.x.shape[2]
        return replace(self, log=EventLog.empty(len(self.done), most, nx))

    @property
    def completed(self) -> npt.NDArray[np.bool_]:
        """Mask of the rollouts that reached their end, shape (N,)."""
        return np.asarray((self.status == COMPLETED) | (self.status == ENDED))

    def check_start(self, closure: Closure, p: Array) -> None:
        """Store the initial gaps of rollouts of p (N, np), and end rollouts that start open."""
        self.gaps[:] = closure.measure(p)
        lost = closure.is_open(self.gaps) & (self.done >= 0)
        self.done[lost], self.reached[lost], self.r[lost], self.cost[lost] = 0, 0.0, np.nan, np.nan
        self.status[lost], self.log.fired[lost] = DIVERGED, 0
        self.log.event[lost], self.log.when[lost] = -1, np.nan
        for samples in (self.x, self.y):
            if samples is not None:
                samples[lost, 1:] = np.nan

    def mark_coincident(self, kernel: Kernel, p: Array) -> None:
        """Set the gradient warning for p (N, np) where coincident jumps have different derivatives."""
        jumps = [k for k, place in enumerate(kernel.jump_slopes) if place >= 0]
        if not jumps or len(kernel.jumps) < 2:
            return
        c = kernel.functions["setup"](p.T)[1].full().T
        times, slopes = c[:, list(kernel.jumps)], np.zeros((len(p), len(kernel.jumps)))
        slopes[:, jumps] = c[:, [kernel.jump_slopes[k] for k in jumps]]
        order = np.argsort(times, axis=1)
        times, slopes = (np.take_along_axis(part, order, axis=1) for part in (times, slopes))
        is_within = (times[:, 1:] > 0) & (times[:, 1:] < self.reached[:, None])
        tied = ((np.diff(times) == 0) & (np.diff(slopes) != 0) & is_within).any(axis=1)
        self.log.gradient_warning[tied & (self.log.gradient_warning[:, 0] == 0)] = COINCIDENT, -1

    @property
    def coincident(self) -> Integers:
        """Rollouts of which two events may change places, by their rows."""
        return np.flatnonzero(self.log.gradient_warning[:, 0] == COINCIDENT)

    def trust_same(self, rows: Integers, again: RolloutArrays, derivatives: Array, other: Array) -> None:
        """Clear the warning of rows whose derivatives (n, ...) do not depend on the order of events."""
        is_reordered = (again.log.event != self.log.event[rows]).any(axis=1) | (
            self.log.gradient_warning[rows, 1] < 0
        )
        derivatives, other = derivatives.reshape(len(rows), -1), other.reshape(len(rows), -1)
        with np.errstate(invalid="ignore"):
            largest = np.abs(derivatives).max(axis=1, initial=0.0, keepdims=True)
            same = np.abs(other - derivatives) <= SAME * (np.abs(derivatives) + FAINT * largest) + NOTHING
        self.log.gradient_warning[rows[is_reordered & same.all(axis=1)]] = 0

    def count(self, rows: slice) -> int:
        """Number of rollouts that ran."""
        return int((self.done[rows] >= 0).sum())
