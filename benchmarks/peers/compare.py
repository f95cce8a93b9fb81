"""Two programs on one scene: refined until each has converged, then timed at equal error."""

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

    ``ready`` builds the simulation at a level, each of half the step of the one before; what it returns
    simulates and gives the final state. ``setting`` has method and step of a level in words.
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
    """A scene that a peer simulates too: ``measure`` raises ImportError where its package is missing."""

    peer: str
    package: str
    title: str
    note: str
    measure: Callable[[], Outcome]


def spent_s() -> float:
    """Processor time of this process and its ended children, compilers among them [s]."""
    return time.process_time() + sum(os.times()[2:4])


def timed(job: Callable[[], Any]) -> tuple[Any, float]:
    """Result of a job, and the processor time that it takes [s]."""
    before = spent_s()
    result = job()
    return result, spent_s() - before


def distance(a: Array, b: Array) -> float:
    """Greatest difference of two states, each component by the larger of one and its size.

    Turns of planar bases may be counted or not: whole turns do not matter.
    """
    gap = a - b
    gap = np.where(np.abs(gap) > np.pi, gap - 2 * np.pi * np.round(gap / (2 * np.pi)), gap)
    return float(np.max(np.abs(gap) / np.maximum(1, np.abs(b))))


def converged(side: Side, tolerance: float) -> tuple[int, float, Array]:
    """Coarsest level that is within a tolerance of the next, their difference, the finer result."""
    before = side.ready(0)()
    for level in range(MOST_LEVELS):
        after = side.ready(level + 1)()
        change = distance(before, after)
        if change <= tolerance:
            break
        before = after
    return level, change, after


def compare(ours: Side, theirs: Side, tolerance: float, quantity: str = "state") -> Outcome:
    """Refine both up to a tolerance, compare the results, let them take turns at the levels found."""
    _, prepare_s = timed(lambda: ours.ready(0))
    sides = (ours, theirs)
    results = [converged(side, tolerance) for side in sides]
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(TURNS):
        for side, (level, _, _), kept in zip(sides, results, times, strict=True):
            kept.append(timed(side.ready(level))[1])
    words = [side.setting(level) for side, (level, _, _) in zip(sides, results, strict=True)]
    apart, errors = distance(results[0][2], results[1][2]), [change for _, change, _ in results]
    return Outcome(
        f"{quantity} {apart:.0e}",
        " / ".join(f"{error:.0e}" for error in errors),
        statistics.median(times[0]),
        statistics.median(times[1]),
        f"{words[0]}; compiled in {prepare_s:.1f} s",
        words[1],
        {"apart": apart, "errors": errors, "times_s": times, "prepare_s": prepare_s},
    )


def our_side(scene: Scene, step_s: float, state: Callable[[Array], Array], method: str = "tanaka6") -> Side:
    """Ours: the compiled rollout of a scene; ``state`` gives the coordinates in which both are compared."""
    duration_s = scene.scenario.simulation.duration
    loop = build_closed_loop(scene)

    def ready(level: int) -> Job:
        rollout = build_rollout(
            loop, duration_s=duration_s, step_s=step_s / 2**level, output_step_s=duration_s, method=method
        )

        def run() -> Array:
            trajectory = rollout.run()
            final = state(trajectory.state[-1])
            # numbers of a rollout that diverged are none, so that its level does not count as converged
            return final if trajectory.status == "completed" else np.full_like(final, np.nan)

        return run

    return Side(ready, lambda level: f"{method}, {step_s / 2**level * 1e3:g} ms")
