"""Many simulations of a scene as a vector environment of Gymnasium, rolled out together in SIMD lanes."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, Unpack

import gymnasium
import numpy as np
from gymnasium.utils.seeding import np_random
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from spacerobot.common.arrays import Array
from spacerobot.common.errors import SpaceRobotError
from spacerobot.common.files import StrPath
from spacerobot.learning.environment import spaces_of
from spacerobot.learning.episodes import Episodes, Flags, Rows, Segment
from spacerobot.learning.task import EnvironmentOptions, SceneTask
from spacerobot.rollout import time_grid
from spacerobot.scene import Scene
from spacerobot.updates.plant import ROUNDING


class SceneVectorEnvironment(gymnasium.vector.VectorEnv):
    """Many simulations of a scene; see :func:`spacerobot.learning.make_vector_environment`.

    An episode that ends is reset in the same step (``AutoresetMode.SAME_STEP``), alone: the other episodes
    continue, each with its own time. The step's last observation is ``info["final_obs"]``. Episode i depends
    on its seed alone, not on the number of environments, lanes or threads.

    Attributes:
        task: Spaces, reward, terminations and initial states.
        scene: Scene with a policy for each robot.

    Args:
        scenario: A scene, the name or file of its scenario, or the name of an environment that ships.
        num_envs: Number of simulations.
        threads: Number of threads; one for each usable core if None.
        **options: See :class:`spacerobot.learning.task.EnvironmentOptions`.

    Raises:
        ScenarioError: If the scene has no such outputs, actions or events, or Python updates controllers.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 (Gymnasium's interface)
        "render_modes": [],
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }

    def __init__(
        self,
        scenario: Scene | StrPath,
        num_envs: int = 1,
        *,
        threads: int | None = None,
        **options: Unpack[EnvironmentOptions],
    ) -> None:
        if num_envs < 1:
            raise SpaceRobotError(f"num_envs: found {num_envs}, allowed: at least 1")
        self.task = SceneTask(scenario, many=True, **options)
        self.scene, self.num_envs, self._threads = self.task.scene, num_envs, threads
        self.single_observation_space, self.single_action_space = spaces_of(self.task)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._episodes = Episodes(self.task, num_envs, self._roll)
        self._all: Rows = np.arange(num_envs, dtype=np.int64)
        self._generators = [np_random()[0] for _ in range(num_envs)]

    def _roll(self, rows: Array, duration_s: float) -> Segment:
        """Roll out rows of parameters together for a duration, without samples over time."""
        rollout = self.task.rollout
        grid = time_grid(duration_s, rollout.grid.step_s * (1 + ROUNDING), duration_s)
        with np.errstate(over="ignore", invalid="ignore"):
            batch = dataclasses.replace(rollout, grid=grid).batch(
                rollout.loop.parameter_paths, rows, threads=self._threads
            )
        return Segment.of_batch(batch, duration_s)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin all episodes in initial states that are drawn.

        Args:
            seed: Seed s of the first environment, s + i of environment i; or one seed for each; the
                generators continue if None.
            options: Not used.

        Returns:
            tuple: Observations (N, n), and the drawn numbers by dotted path in ``info["draws"]``, each (N,).
        """
        del options
        if seed is None or isinstance(seed, int | np.integer):
            seeds: Sequence[int | None] = [
                None if seed is None else int(seed) + i for i in self._all.tolist()
            ]
        else:
            seeds = seed
        if len(seeds) != self.num_envs:
            raise SpaceRobotError(f"seed: found {len(seeds)} seeds, allowed: {self.num_envs}, or one")
        for place, one in enumerate(seeds):
            if one is not None:
                self._generators[place] = np_random(one)[0]
        return self._begin(self._all), self._add_draws({}, self._all)

    def _begin(self, rows: Rows) -> Array:
        return self._episodes.begin(rows, [self._generators[row] for row in rows])

    def _add_draws(self, info: dict[str, Any], rows: Rows) -> dict[str, Any]:
        """Drawn numbers of episodes that have just begun."""
        if self.task.drawn:
            for row in rows.tolist():
                draws = {"draws": self.task.drawn_numbers(self._episodes.drawn[row])}
                info = self._add_info(info, draws, row)
        return info

    def step(self, actions: Array) -> tuple[Array, Array, Flags, Flags, dict[str, Any]]:
        """Hold actions for one period.

        Args:
            actions: Actions (N, m), clipped to -1 and 1, which are their limits.

        Returns:
            tuple: Observations (N, n), rewards, terminations and truncations (N,), and ``info``: ``time_s``
                and ``events`` (names) of the step; of the episodes that ended, ``final_obs`` and
                ``final_info`` with ``metrics`` and, if the rollout was lost, its ``cause``. Their
                observations are those of the new episodes.
        """
        if not self._episodes.running.all():
            raise self.task.not_begun()
        actions = np.asarray(actions, dtype=float)
        if actions.shape != self.action_space.shape:
            raise self.scene.error(
                f"actions of shape {actions.shape}, allowed: {self.action_space.shape}", ""
            )
        step = self._episodes.step(self._all, actions)
        observations, info = step.observations.copy(), dict[str, Any]()
        ended: Rows = np.flatnonzero(step.terminated | step.truncated).astype(np.int64)
        for row in ended.tolist():
            last = self._episodes.info(row, float(step.times_s[row]), step.events[row], step.causes[row])
            final = {"final_obs": step.observations[row], "final_info": last}
            info = self._add_info(info, final, row)
        if len(ended):
            observations[ended] = self._begin(ended)
            info = self._add_draws(info, ended)
        info["time_s"], info["_time_s"] = step.times_s, np.ones(self.num_envs, bool)
        info["events"] = np.empty(self.num_envs, object)
        info["events"][:] = step.events
        info["_events"] = np.array([bool(each) for each in step.events])
        return observations, step.rewards, step.terminated, step.truncated, info
