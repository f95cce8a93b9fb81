"""Scenes as environments of Gymnasium and stable-baselines3 (extras ``learning`` and ``sb3``)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, Unpack

from spacerobot.common.errors import SpaceRobotError
from spacerobot.common.files import StrPath
from spacerobot.common.optional import optional_module
from spacerobot.learning.registration import register_environments
from spacerobot.scene import Scene

if TYPE_CHECKING:
    from spacerobot.learning.environment import SceneEnvironment
    from spacerobot.learning.task import EnvironmentOptions

__all__ = ["make_environment", "make_vector_environment", "register_environments"]

INTERFACES = ("gymnasium", "stable_baselines3")


def make_environment(scenario: Scene | StrPath, **options: Unpack[EnvironmentOptions]) -> SceneEnvironment:
    """Make an environment of Gymnasium from a scene.

    Args:
        scenario: A scene, the name or file of its scenario, or the name of an environment that ships, such as
            ``spacerobot/Capture-v0``.
        **options: Observations, actions, reward and terminations, see
            :class:`spacerobot.learning.task.EnvironmentOptions`.

    Returns:
        SceneEnvironment: A ``gymnasium.Env`` with spaces of type ``Box``.

    Raises:
        SpaceRobotError: If the extra ``learning`` is not installed.
        ScenarioError: If an output, action or event does not exist in the scene.
    """
    optional_module("gymnasium", "learning", "spacerobot.learning")
    from spacerobot.learning.environment import SceneEnvironment

    return SceneEnvironment(scenario, **options)


def make_vector_environment(
    scenario: Scene | StrPath,
    num_envs: int = 1,
    *,
    threads: int | None = None,
    interface: Literal["gymnasium", "stable_baselines3"] = "gymnasium",
    **options: Unpack[EnvironmentOptions],
) -> Any:
    """Make an environment of many simulations of a scene, rolled out in SIMD lanes.

    Args:
        scenario: Scene, scenario or environment; see :func:`make_environment`.
        num_envs: Number of simulations; best a multiple of lanes times threads.
        threads: Number of threads; one for each usable core if None. Episodes do not depend on it.
        interface: ``gymnasium``, or ``stable_baselines3`` (extra ``sb3``).
        **options: See :func:`make_environment`.

    Returns:
        A ``gymnasium.vector.VectorEnv`` that resets an episode in the step in which it ends
            (``AutoresetMode.SAME_STEP``), or a ``VecEnv`` of stable-baselines3.

    Raises:
        SpaceRobotError: If an extra is not installed, or the interface is unknown.
        ScenarioError: If an output, action or event does not exist in the scene.
    """
    if interface not in INTERFACES:
        raise SpaceRobotError(f"interface: found {interface!r}, allowed: {', '.join(INTERFACES)}")
    optional_module("gymnasium", "learning", "spacerobot.learning")
    from spacerobot.learning.vector_environment import SceneVectorEnvironment

    environments = SceneVectorEnvironment(scenario, num_envs, threads=threads, **options)
    if interface == "gymnasium":
        return environments
    optional_module("stable_baselines3", "sb3", "the interface stable_baselines3")
    from spacerobot.learning.stable_baselines import SceneVecEnv

    return SceneVecEnv(environments)


register_environments()
