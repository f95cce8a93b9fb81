"""Steps and samples of a rollout, derived from integers."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from spacerobot.common.errors import SpaceRobotError
from spacerobot.rollout.closed_loop_protocol import Array

ROUNDING = 1e-9
"""Relative tolerance by which a duration may exceed whole steps without another step."""


@dataclass(frozen=True)
class TimeGrid:
    """Duration divided into equal sample intervals, each divided into equal steps.

    Attributes:
        duration_s: Duration [s].
        intervals: Number of sample intervals; there is one sample more.
        every: Steps in each interval. An interval with a jump is divided there, and may have one step more.
        finer: Divisor of the closed loop's own maximum steps, such as those during contact.
        locates_peaks: Whether derivatives of peaks are taken at the vertex between steps, instead of the step
            with the largest value.
    """

    duration_s: float
    intervals: int
    every: int
    finer: float = 1.0
    locates_peaks: bool = False

    @property
    def steps(self) -> int:
        """Total number of steps, without jumps."""
        return self.intervals * self.every

    @property
    def step_s(self) -> float:
        """Longest step [s]."""
        return self.duration_s / self.steps

    @property
    def halved(self) -> TimeGrid:
        """Time grid with the same samples and steps of half the length."""
        return replace(self, every=2 * self.every, finer=self.finer / 2)

    @property
    def time(self) -> Array:
        """Sample times, shape (intervals + 1,): step index times step, never a sum."""
        return np.asarray(np.arange(self.intervals + 1) * self.every * self.step_s, dtype=np.float64)


def time_grid(duration_s: float, step_s: float, output_step_s: float | None = None) -> TimeGrid:
    """Time grid with steps no longer than requested.

    A length that does not divide the next one is shortened, so that all intervals are whole.

    Args:
        duration_s, step_s: Duration and longest step [s].
        output_step_s: Longest time between samples [s]; each step is a sample if None.

    Raises:
        SpaceRobotError: A length is not positive and finite.
    """
    sample_s = step_s if output_step_s is None else output_step_s
    for name, value in (("duration", duration_s), ("step", step_s), ("output step", sample_s)):
        if not (math.isfinite(value) and value > 0):
            raise SpaceRobotError(f"the {name} of a rollout is {value} s, allowed: above zero and finite")
    intervals = pieces(duration_s, sample_s)
    return TimeGrid(float(duration_s), intervals, pieces(duration_s / intervals, step_s))


def pieces(whole_s: float, piece_s: float) -> int:
    """Number of equal pieces of a duration, none longer than ``piece_s`` within rounding; at least one."""
    return max(1, math.ceil(whole_s / piece_s * (1 - ROUNDING)))
