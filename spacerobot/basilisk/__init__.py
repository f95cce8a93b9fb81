"""Basilisk both ways: a scene in its world of messages, and its flight software on our base."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

from spacerobot.basilisk.flight_software import BasiliskController, BasiliskModules
from spacerobot.common.files import StrPath
from spacerobot.common.optional import optional_module
from spacerobot.scene import Scene

if TYPE_CHECKING:
    from spacerobot.basilisk.controller_module import ControllerModule
    from spacerobot.basilisk.scene_module import SceneModule

__all__ = ["BasiliskController", "BasiliskModules", "make_basilisk_controller", "make_basilisk_scene"]


def make_basilisk_scene(
    scenario: Scene | StrPath,
    robot: str | None = None,
    spacecraft: Any = None,
    *,
    period: float = 0.1,
    extrapolated: bool = True,
    backend: Literal["auto", "compiled", "interpreted"] = "auto",
) -> SceneModule:
    """Make a module of Basilisk (``SysModel``) that steps a scene.

    Add it to a task first, then the spacecraft, then modules that read its messages: commands computed at one
    step act until the next.

    Args:
        scenario: A scene, or the name or file of its scenario.
        robot: Name of the robot whose base is the spacecraft; the first on a floating base by default.
        spacecraft: Basilisk's ``spacecraft.Spacecraft`` with a gravity field and dynamic effectors (drag,
            solar pressure, magnetic torque rods, thrusters, external forces), which act on the base. It
            follows the base. The scene's origin begins at its ``hub.r_CN_NInit`` and ``hub.v_CN_NInit`` and
            falls in its gravity. None: no forces but the commands.
        period: Time step of the task [s], for which the scene's own step is chosen.
        extrapolated: Whether gravity and effectors are extrapolated over a step by a line, which makes the
            coupling second-order; False holds them, for thrusters that switch.
        backend: ``auto``, ``compiled`` or ``interpreted``.

    Returns:
        SceneModule: Its attributes are the messages; ``result()`` gives the simulation as a result.

    Raises:
        SpaceRobotError: If the extra ``basilisk`` is not installed, or if state effectors are attached to
            the spacecraft.
        ScenarioError: If the scene has no such robot.
    """
    optional_module("Basilisk.architecture.sysModel", "basilisk", "spacerobot.basilisk")
    from spacerobot.basilisk.scene_module import SceneModule

    return SceneModule(scenario, robot, spacecraft, period=period, extrapolated=extrapolated, backend=backend)


def make_basilisk_controller(
    scenario: Scene | StrPath,
    bodies: Any = None,
    *,
    period: float = 0.01,
    backend: Literal["auto", "compiled", "interpreted"] = "auto",
) -> ControllerModule:
    """Make a module of Basilisk (``SysModel``) that controls an ``MJScene`` by a scene's controllers.

    Args:
        scenario: A scene, or the name or file of its scenario.
        bodies: ``mujoco.MJScene`` with the bodies of the scene; made of the scene by default.
        period: Time step of the task [s], over which torques are held.
        backend: ``auto``, ``compiled`` or ``interpreted``.

    Returns:
        ControllerModule: Its attribute ``bodies`` is the ``MJScene``.

    Raises:
        SpaceRobotError: If the extra ``basilisk`` is not installed.
    """
    optional_module("Basilisk.architecture.sysModel", "basilisk", "spacerobot.basilisk")
    from spacerobot.basilisk.controller_module import ControllerModule

    return ControllerModule(scenario, bodies, period=period, backend=backend)
