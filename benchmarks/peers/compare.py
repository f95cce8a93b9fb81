"""Comparison of two programs on one scene: both are refined to a tolerance, then timed at that error."""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from spacerobot.closedloop import build_closed_loop
from spacerobot.common.arrays import Array
from spacerobot.rollout import build_rollout
from spacerobot.scene import Scene

TURNS, MOST_LEVELS = 5, 14
Job = Callable[[], Array]


@dataclass(frozen=True)
class Side:
    """One of the two programs.

    Attributes:
        ready: Builder of the simulation at a level, with half the step of the level before; the simulation
            returns the final state.
        setting: Method and step of a level in words.
    """

    ready: Callable[[int], Job]
    setting: Callable[[int], str]


@dataclass(frozen=True)
class Outcome:
    """Outcome of a scene: in words, the processor times of one run each [s], their settings, raw numbers."""

    agreement: str
    error: str
    ours_s: float
    theirs_s: float
    ours: str
    theirs: str
    numbers: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class PeerScene:
    """Scene that a peer simulates too; ``measure`` raises ImportError without the peer's package."""

    peer: str
    package: str
    title: str
    note: str
    measure: Callable[[], Outcome]


def spent_s() -> float:
    """Processor time of this process and its ended children, compilers among them [s]."""
    return time.process_time() + sum(os.times()[2:4])


def timed(job: Callable[[], Any]) -> tuple[Any, float]:
    """Result of a job, and its processor time [s]."""
    before = spent_s()
    result = job()
    return result, spent_s() - before


def distance(a: Array, b: Array) -> float:
    """Largest difference of two states, each component relative to the larger of one and its magnitude.

    Whole turns are ignored, since planar bases may count them or not.
    """
    gap = a - b
    gap = np.where(np.abs(gap) > np.pi, gap - 2 * np.pi * np.round(gap / (2 * np.pi)), gap)
    return float(np.max(np.abs(gap) / np.maximum(1, np.abs(b))))


def converged(side: Side, tolerance: float) -> tuple[int, float, Array]:
    """Coarsest level within a tolerance of the next one, their difference, and the finer result."""
    before = side.ready(0)()
    for level in range(MOST_LEVELS):
        after = side.ready(level + 1)()
        change = distance(before, after)
        if change <= tolerance:
            break
        before = after
    return level, change, after


def compare(ours: Side, theirs: Side, tolerance: float, quantity: str = "state") -> Outcome:
    """Outcome of two programs: refined to a tolerance, compared, and timed in turns at these levels."""
    _, prepare_s = timed(lambda: ours.ready(0))
    sides = (ours, theirs)
    results = [converged(side, tolerance) for side in sides]
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(TURNS):
        for side, (level, _, _), times_of_side in zip(sides, results, times, strict=True):
            times_of_side.append(timed(side.ready(level))[1])
    words = [side.setting(level) for side, (level, _, _) in zip(sides, results, strict=True)]
    difference, errors = distance(results[0][2], results[1][2]), [change for _, change, _ in results]
    return Outcome(
        f"{quantity} {difference:.0e}",
        " / ".join(f"{error:.0e}" for error in errors),
        statistics.median(times[0]),
        statistics.median(times[1]),
        f"{words[0]}; compiled in {prepare_s:.1f} s",
        words[1],
        {"difference": difference, "errors": errors, "times_s": times, "prepare_s": prepare_s},
    )


def our_side(scene: Scene, step_s: float, state: Callable[[Array], Array], method: str = "tanaka6") -> Side:
    """Side of the compiled rollout of a scene; ``state`` returns the coordinates that are compared."""
    duration_s = scene.scenario.simulation.duration
    loop = build_closed_loop(scene)

    def ready(level: int) -> Job:
        rollout = build_rollout(
            loop, duration_s=duration_s, step_s=step_s / 2**level, output_step_s=duration_s, method=method
        )

        def run() -> Array:
            trajectory = rollout.run()
            final = state(trajectory.state[-1])
            # NaN for a diverged rollout, so that its level does not count as converged
            return final if trajectory.status == "completed" else np.full_like(final, np.nan)

        return run

    return Side(ready, lambda level: f"{method}, {step_s / 2**level * 1e3:g} ms")
