"""Steps of one rollout: segments between samples and jumps, cut into equal steps.

``loops/steps.hpp`` does the same for each lane; here it is written for the interpreted engine and for
integrators that only need to know where to stop.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from spacerobot.rollout.closed_loop_protocol import Array
from spacerobot.rollout.time_grid import TimeGrid, pieces

HERE = -2
"""What a segment begins at that an event began; see :class:`StepPlan`."""

FEWEST = 8
"""Steps at least of what begins and ends with a jump within a sample interval: a motion of its own."""


@dataclass(frozen=True)
class Segment:
    """A part of a sample interval without a jump inside.

    Attributes
    ----------
    begin_s, end_s
        Its ends.
    steps
        How many it is cut into.
    first, last
        The jump it begins and ends at, -1 for none.
    samples
        Whether a sample interval ends with it.
    """

    begin_s: float
    end_s: float
    steps: int
    first: int
    last: int
    samples: bool

    def length(self, grid: TimeGrid) -> float:
        """Length of a step in s; exactly the grid's where nothing jumps."""
        if self.samples and self.steps == grid.every and self.first == -1 and self.last == -1:
            return grid.step_s
        return (self.end_s - self.begin_s) / self.steps


def in_order(times: Sequence[float] | Array, duration_s: float, *, backwards: bool = False) -> list[int]:
    """The jumps that a rollout meets, in turn: places in ``times`` of those inside it.

    Backwards those at one instant are the other way round.
    """
    inside = [e for e, when in enumerate(times) if 0 < when < duration_s]
    return sorted(inside, key=lambda e: (times[e], -e if backwards else e))


def segments(grid: TimeGrid, times: Sequence[float] | Array, *, backwards: bool = False) -> Iterator[Segment]:
    """Segments of a rollout whose dynamics jump at given times [s]."""
    samples = grid.time
    ahead, first = in_order(times, samples[-1], backwards=backwards), -1
    for begin, until in pairwise(samples):
        here, done = float(begin), False
        while not done:
            last = ahead.pop(0) if ahead and times[ahead[0]] <= until else -1
            end = float(until if last < 0 else times[last])
            whole = here == begin and end == until
            piece = (first >= 0 or here == 0) and last >= 0 and end > here
            fewest = FEWEST / grid.finer if piece else 1
            steps = grid.every if whole else max(int(fewest), pieces(end - here, grid.step_s))
            done = end == until
            yield Segment(here, end, steps, first, last, done)
            here, first = end, last


def graded(step_s: float, window_s: float, near: float) -> float:
    """Longest step [s] that part of a window away from where the law is rough; see ``loops/steps.hpp``."""
    least, part = (step_s / window_s) ** 2, 1.0
    while part > least and part**3 > near * near:
        part /= 2
    return part * step_s


@dataclass(frozen=True)
class StepPlan:
    """Every step of a rollout, K of them.

    Attributes
    ----------
    t, h
        Where each begins and its length [s], shape (K,).
    index, number
        Which of how many of its segment each is, shape (K,).
    first, last
        The jump that its segment begins and ends at, -1 for none, shape (K,); :data:`HERE` where it begins
        with an event.
    sampled
        Steps done at each sample, shape (samples,).
    """

    t: Array
    h: Array
    index: npt.NDArray[np.int64]
    number: npt.NDArray[np.int64]
    first: npt.NDArray[np.int64]
    last: npt.NDArray[np.int64]
    sampled: npt.NDArray[np.int64]

    @property
    def steps(self) -> int:
        """How many there are."""
        return len(self.t)

    @property
    def passes(self) -> npt.NDArray[np.int64]:
        """The steps that begin at a jump, which then lies behind."""
        return np.flatnonzero((self.first >= 0) & (self.index == 0))


def plan(grid: TimeGrid, times: Sequence[float] | Array, *, backwards: bool = False) -> StepPlan:
    """All steps of a rollout whose dynamics jump at given times [s]."""
    parts = list(segments(grid, times, backwards=backwards))
    number = np.array([part.steps for part in parts], dtype=np.int64)
    ends = np.cumsum(number)
    index = np.arange(ends[-1]) - np.repeat(ends - number, number)
    h = np.repeat([part.length(grid) for part in parts], number)
    begin = np.repeat([part.begin_s for part in parts], number)
    first, last = (np.repeat([getattr(part, end) for part in parts], number) for end in ("first", "last"))
    sampled = np.concatenate([[0], ends[[part.samples for part in parts]]])
    return StepPlan(begin + index * h, h, index, np.repeat(number, number), first, last, sampled)
