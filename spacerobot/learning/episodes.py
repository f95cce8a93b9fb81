"""Episodes of a task: each step holds actions for one period and evaluates observations and rewards."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spacerobot.common.arrays import Array
from spacerobot.learning.rewards import DIVERGED, Outputs
from spacerobot.learning.task import SceneTask
from spacerobot.rollout import Batch, Trajectory
from spacerobot.rollout.resumable_loop import STATE
from spacerobot.updates.plant import SHORT

Rows = NDArray[np.int64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Segment:
    """Rollouts of one step of n episodes.

    Attributes:
        measures: Measures of the rollouts by name (n, k).
        fired: Indices of their events in the closed loop.
        ended: Whether an event of the scenario ended the simulation (n,).
        causes: Reason why a rollout was lost; empty for the others.
        reached_s: Time from the beginning of the step that was reached (n,) [s].
    """

    measures: Mapping[str, Array]
    fired: Sequence[Sequence[int]]
    ended: Flags
    causes: Sequence[str]
    reached_s: Array

    @classmethod
    def of_batch(cls, batch: Batch, duration_s: float) -> Segment:
        """Segment of many rollouts."""
        count, events = len(batch.done), batch.events
        fired: Sequence[Sequence[int]] = [()] * count
        ended_at, chattering = np.full(count, np.nan), np.zeros(count, bool)
        if events is not None:
            fired = [row[row >= 0].tolist() for row in events.event]
            ended_at, chattering = events.ended_at_s, events.chattering
        causes = [
            "" if np.isnan(at) else unclosed or ("chattering" if chatters else DIVERGED)
            for at, unclosed, chatters in zip(batch.diverged_at_s, batch.unclosed, chattering, strict=True)
        ]
        reached = np.where(np.isnan(batch.diverged_at_s), duration_s, batch.diverged_at_s)
        reached = np.where(np.isnan(ended_at), reached, ended_at)
        return cls(batch.measures, fired, np.isfinite(ended_at), causes, reached)

    @classmethod
    def of_trajectory(cls, trajectory: Trajectory) -> Segment:
        """Segment of one rollout."""
        lost, ended_at = trajectory.status != "completed", trajectory.ended_at_s
        return cls(
            {name: value[None, :] for name, value in trajectory.measures.items()},
            [[one.event for one in trajectory.events]],
            np.array([ended_at is not None]),
            [(trajectory.cause or trajectory.status) if lost else ""],
            np.array([trajectory.time[-1] if ended_at is None else ended_at]),
        )


Roll = Callable[[Array, float], Segment]
"""Function that rolls out rows (n, np + 1 + nx + ns) for a duration [s]."""


@dataclass(frozen=True)
class Step:
    """Outcome of a step of n episodes.

    Attributes:
        observations, rewards: Observations (n, no) and rewards (n,) of each episode.
        terminated, truncated: Whether it ended, and whether its duration is over (n,).
        times_s: Time that was reached (n,) [s].
        events: Names of the events of each.
        causes: Reason why a rollout was lost; empty for the others.
    """

    observations: Array
    rewards: Array
    terminated: Flags
    truncated: Flags
    times_s: Array
    events: Sequence[Sequence[str]]
    causes: Sequence[str]


class Episodes:
    """N episodes of a task, each with its own time.

    Args:
        task: The task.
        count: Number of episodes N.
        roll: Function that rolls out some episodes for one step.
    """

    def __init__(self, task: SceneTask, count: int, roll: Roll) -> None:
        self.task, self._roll, self._np = task, roll, len(task.loop.parameter_paths)
        width = self._np + len(task.loop.state_names) + 1 + len(task.loop.switches)
        # parameters, time, state and switches at the start of the next step
        self.rows = np.zeros((count, width))
        self.drawn = np.zeros((count, self._np))
        self.running = np.zeros(count, bool)
        self._steps = np.zeros(count, np.int64)
        self._worst = np.zeros(count)
        self._totals: dict[str, Array] = {}
        self._last: dict[str, Array] = {}

    def begin(self, rows: Rows, generators: Sequence[np.random.Generator]) -> Array:
        """Begin new episodes in random initial states.

        Args:
            rows: Indices of the episodes (n,).
            generators: Random number generator of each episode.

        Returns:
            numpy.ndarray: Observations (n, no).
        """
        task = self.task
        self.drawn[rows] = [task.draw(generator) for generator in generators]
        self.rows[rows] = task.begin(self.drawn[rows])
        # outputs and quantities with a nonzero initial value, after zero time
        segment = self._roll(self.rows[rows], SHORT)
        for name, measure in task.quantity_measures.items():
            values = segment.measures[name]
            self._keep(self._totals, name, rows, 0.0 * values if measure.kind == "integral" else values)
        outputs = task.outputs(segment.measures)
        for name, values in outputs.items():
            self._keep(self._last, name, rows, values)
        still = np.zeros((len(rows), len(task.action_names)))
        self._worst[rows] = np.minimum(0.0, task.reward.running(outputs, still))
        self._steps[rows], self.running[rows] = 0, True
        return task.observe(outputs)

    def step(self, rows: Rows, actions: Array) -> Step:
        """Hold actions (n, m) for one period.

        Args:
            rows: Indices of the episodes (n,).
            actions: Actions of each, clipped to -1 and 1.
        """
        task = self.task
        actions = np.clip(np.asarray(actions, dtype=float), -1.0, 1.0)
        begins = task.act(self.rows[rows], actions)
        remainder = task.duration - (task.steps - 1) * task.period
        # all full periods are equal to the bit, so that they share a batch; the last one may be shorter
        last = self._steps[rows] + 1 == task.steps
        durations = np.where(last, remainder, task.period)
        parts = list[tuple[Rows, Step]]()
        for duration in np.unique(durations):
            places = np.flatnonzero(durations == duration)
            segment = self._roll(begins[places], float(duration))
            parts.append((places, self._evaluate(rows[places], begins[places], actions[places], segment)))
        if len(parts) == 1:
            return parts[0][1]
        return _merged(parts)

    def _evaluate(self, rows: Rows, begins: Array, actions: Array, segment: Segment) -> Step:
        """Rewards and terminations of a step; the states are carried over."""
        task = self.task
        lost = np.array([bool(cause) for cause in segment.causes])
        words = [task.words(fired) for fired in segment.fired]
        for place in np.flatnonzero(lost):
            words[place].append(DIVERGED)
        good = rows[~lost]
        for name, values in task.outputs(segment.measures).items():
            self._last[name][good] = values[~lost]
        outputs = {name: values[rows] for name, values in self._last.items()}
        before = {name: values[rows] for name, values in self._totals.items()}
        for name, measure in task.quantity_measures.items():
            values, totals = segment.measures[name][~lost], self._totals[name]
            if measure.kind == "integral":
                totals[good] += values
            elif measure.kind == "peak":
                totals[good] = np.maximum(totals[good], values)
            else:
                totals[good] = values
        after = {name: values[rows] for name, values in self._totals.items()}
        rewards = self._rewards(rows, lost, (outputs, before, after), actions, words)
        times_before = begins[:, self._np]
        self._steps[rows] += 1
        self.rows[rows, : self._np] = begins[:, : self._np]
        self.rows[rows, self._np] = self._steps[rows] * task.period
        self.rows[good, self._np + 1 :] = segment.measures[STATE][~lost]
        terminated = lost | segment.ended | task.terminates(outputs, words)
        truncated = ~terminated & (self._steps[rows] >= task.steps)
        self.running[rows] = ~(terminated | truncated)
        names = [[task.loop.events[place].name for place in fired] for fired in segment.fired]
        times = times_before + segment.reached_s
        observations = task.observe(outputs)
        return Step(observations, rewards, terminated, truncated, times, names, segment.causes)

    def _rewards(
        self,
        rows: Rows,
        lost: Flags,
        measured: tuple[Outputs, Outputs, Outputs],
        actions: Array,
        words: Sequence[Sequence[str]],
    ) -> Array:
        """Rewards (n,) of a step.

        A diverged rollout must not be rewarded: it costs the worst step reward so far (at most zero), for
            this step and each remaining one. Otherwise a policy with a positive reward per step learns to
            diverge.
        """
        task, (outputs, before, after) = self.task, measured
        if task.function is not None:
            each = [{name: values[i] for name, values in outputs.items()} for i in range(len(rows))]
            values = [task.function(*one) for one in zip(each, actions, words, strict=True)]
            return np.array(values, dtype=float)
        rewards = task.reward.running(outputs, actions) + task.reward.of_quantities(before, after)
        worst = np.minimum(self._worst[rows], rewards)
        self._worst[rows] = worst
        rewards = np.where(lost, worst * (task.steps - self._steps[rows]), rewards)
        return np.asarray(rewards + [task.reward.of_events(each) for each in words])

    def metrics(self, row: int, elapsed_s: float) -> dict[str, float]:
        """Quantities of one episode so far."""
        return self.task.metrics({name: values[row] for name, values in self._totals.items()}, elapsed_s)

    def info(self, row: int, time_s: float, step_events: Sequence[str], cause: str) -> dict[str, Any]:
        """``info`` after a step of one episode: metrics at its end, the cause if it was lost."""
        info: dict[str, Any] = {"time_s": time_s, "events": list(step_events)}
        if cause:
            info["cause"] = cause
        if not self.running[row] and self.task.quantities:
            info["metrics"] = self.metrics(row, time_s)
        return info

    def _keep(self, table: dict[str, Array], name: str, rows: Rows, values: Array) -> None:
        table.setdefault(name, np.zeros((len(self.rows), values.shape[1])))[rows] = values


def _merged(parts: Sequence[tuple[Rows, Step]]) -> Step:
    """Outcome of episodes that were evaluated in parts, in their order."""
    order = np.argsort(np.concatenate([places for places, _ in parts]))

    def joined(arrays: Sequence[NDArray[Any]]) -> NDArray[Any]:
        return np.concatenate(arrays)[order]

    steps = [step for _, step in parts]
    events = [each for step in steps for each in step.events]
    causes = [each for step in steps for each in step.causes]
    return Step(
        joined([step.observations for step in steps]),
        joined([step.rewards for step in steps]),
        joined([step.terminated for step in steps]),
        joined([step.truncated for step in steps]),
        joined([step.times_s for step in steps]),
        [events[place] for place in order],
        [causes[place] for place in order],
    )
