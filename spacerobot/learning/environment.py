"""Scene as an environment of Gymnasium: each step holds the actions for one period and reads outputs."""

from __future__ import annotations

import dataclasses
from typing import Any, Unpack

import gymnasium
import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.files import StrPath
from spacerobot.learning.episodes import Episodes, Segment
from spacerobot.learning.task import EnvironmentOptions, SceneTask
from spacerobot.result import Result
from spacerobot.result.assembly import build_result
from spacerobot.rollout import Trajectory, time_grid
from spacerobot.rollout.resumable_loop import joined
from spacerobot.scene import Scene, build_scene
from spacerobot.updates.plant import ROUNDING, SHORT

FIRST = np.array([0])
"""Index of the only episode."""


def spaces_of(task: SceneTask) -> tuple[gymnasium.spaces.Box, gymnasium.spaces.Box]:
    """Spaces of the observations and of the actions."""
    observations = gymnasium.spaces.Box(-task.high, task.high, dtype=np.float64)
    return observations, gymnasium.spaces.Box(-1.0, 1.0, (len(task.action_names),), np.float32)


class SceneEnvironment(gymnasium.Env):
    """A scene as an environment; see :func:`spacerobot.learning.make_environment`.

    Attributes:
        task: Spaces, reward, terminations and initial states.
        scene: Scene with a policy for each robot.
        observation_names: Name of each component of the observations.
        action_names: Name of each component of the actions.

    Args:
        scenario: A scene, the name or file of its scenario, or the name of an environment that ships.
        **options: See :class:`spacerobot.learning.task.EnvironmentOptions`.

    Raises:
        ScenarioError: If the scene has no such outputs, actions or events, or Python updates controllers.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 (Gymnasium's interface)

    def __init__(self, scenario: Scene | StrPath, **options: Unpack[EnvironmentOptions]) -> None:
        self.task = SceneTask(scenario, **options)
        self.scene = self.task.scene
        self.observation_names, self.action_names = self.task.observation_names, self.task.action_names
        self.observation_space, self.action_space = spaces_of(self.task)
        self._episodes = Episodes(self.task, 1, self._roll)
        self._pieces = list[tuple[float, Trajectory]]()

    def _roll(self, rows: Array, duration_s: float) -> Segment:
        """Roll out one row, and record the wall time."""
        rollout = self.task.rollout
        grid = time_grid(duration_s, rollout.grid.step_s * (1 + ROUNDING), self.task.sample_s)
        with np.errstate(over="ignore", invalid="ignore"):
            piece = dataclasses.replace(rollout, grid=grid).run(rows[0], estimate=True)
        if duration_s > SHORT:
            begin = float(rows[0, len(self.task.loop.parameter_paths)])
            self._pieces.append((begin, piece))
        return Segment.of_trajectory(piece)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin an episode in a random initial state.

        Args:
            seed: Seed of this episode and those that follow; the generator continues if None.
            options: Not used.

        Returns:
            tuple: Observation (n,) and the drawn numbers by dotted path.
        """
        super().reset(seed=seed, options=options)
        self._pieces.clear()
        observations = self._episodes.begin(FIRST, [self.np_random])
        return observations[0], {"draws": self.task.drawn_numbers(self._episodes.drawn[0])}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Hold an action for one period.

        Args:
            action: Action (m,), clipped to -1 and 1, which are its limits.

        Returns:
            tuple: Observation (n,), reward, whether an event, a limit or divergence ended the episode,
                whether its duration is over, and ``info``: ``time_s``, ``events`` (names) of this step, and
                at the end of an episode ``metrics`` and ``summary``, as :class:`spacerobot.Result` has it; a
                rollout that was lost has a ``cause``.
        """
        if not self._episodes.running[0]:
            raise self.task.not_begun()
        step = self._episodes.step(FIRST, np.asarray(action, dtype=float)[None, :])
        info = self._episodes.info(0, float(step.times_s[0]), step.events[0], step.causes[0])
        terminated, truncated = bool(step.terminated[0]), bool(step.truncated[0])
        if terminated or truncated:
            info["summary"] = self.result().summary
        return step.observations[0], float(step.rewards[0]), terminated, truncated, info

    def result(self) -> Result:
        """Episode so far as a result, to save, plot or animate.

        Raises:
            ScenarioError: If the episode has not started.
        """
        if not self._pieces:
            raise self.scene.error("the episode has not begun: call reset() and step()", "")
        parameter_values = self._episodes.drawn[0]
        scene = build_scene(
            self.scene.scenario, self.task.drawn_numbers(parameter_values), source=self.scene.source
        )
        loop = dataclasses.replace(self.task.loop, parameter_values=parameter_values)
        return build_result(scene, loop, joined(self._pieces))
