"""A vector environment of a scene for stable-baselines3, which refuses those of Gymnasium."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from spacerobot.common.arrays import Array
from spacerobot.learning.episodes import Flags
from spacerobot.learning.vector_environment import SceneVectorEnvironment


class SceneVecEnv(VecEnv):
    """A ``VecEnv`` of stable-baselines3 over simulations that are rolled out together.

    ``infos`` have ``episode`` (return, length and time) of episodes that ended, as its ``Monitor`` adds it.

    Args:
        environments: The simulations.
    """

    def __init__(self, environments: SceneVectorEnvironment) -> None:
        self.environments = environments
        self.render_mode = None
        self._actions = np.zeros(environments.action_space.shape)
        self._returns, self._lengths = np.zeros(environments.num_envs), np.zeros(environments.num_envs, int)
        self._began_s = time.perf_counter()
        super().__init__(
            environments.num_envs, environments.single_observation_space, environments.single_action_space
        )

    def reset(self) -> Array:
        """Begin all episodes; by the seeds of :meth:`seed`, if it was called since.

        Returns:
            numpy.ndarray: Observations (N, n).
        """
        observations, _ = self.environments.reset(seed=self._seeds)
        self._returns[:], self._lengths[:] = 0.0, 0
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: Array) -> None:
        """Take the actions (N, m) of the next step."""
        self._actions = actions

    def step_wait(self) -> tuple[Array, Array, Flags, list[dict[str, Any]]]:
        """Hold the actions for one period.

        Returns:
            tuple: Observations (N, n), rewards (N,), whether episodes ended (N,), and a dictionary for each.
        """
        observations, rewards, terminated, truncated, info = self.environments.step(self._actions)
        self._returns += rewards
        self._lengths += 1
        ended = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for row in np.flatnonzero(ended).tolist():
            infos[row] = {
                "terminal_observation": info["final_obs"][row],
                "TimeLimit.truncated": bool(truncated[row]),
                "events": info["final_info"]["events"][row],
                "episode": {
                    "r": float(self._returns[row]),
                    "l": int(self._lengths[row]),
                    "t": time.perf_counter() - self._began_s,
                },
            }
        self._returns[ended], self._lengths[ended] = 0.0, 0
        return observations, rewards, ended, infos

    def close(self) -> None:
        """Close the environment."""
        self.environments.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Attribute of the environment, once for each of some indices."""
        return [getattr(self.environments, attr_name)] * len(self._rows(indices))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of the environment, which all simulations share."""
        del indices
        setattr(self.environments, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method of the environment once; its value for each of some indices."""
        value = getattr(self.environments, method_name)(*method_args, **method_kwargs)
        return [value] * len(self._rows(indices))

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Whether wrappers are around the environments: none are."""
        del wrapper_class
        return [False] * len(self._rows(indices))

    def _rows(self, indices: int | Iterable[int] | None) -> Sequence[int]:
        return list(self._get_indices(indices))
