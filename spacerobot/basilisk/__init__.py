"""Coupling with Basilisk: scenes as Basilisk modules, and Basilisk's flight software as a controller."""

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
    """Make a Basilisk module (``SysModel``) that simulates a scene.

    Add the module to a task first, then the spacecraft, then modules that read its messages. Commands
    computed at one step act until the next.

    Args:
        scenario: A scene, or the name or file of its scenario.
        robot: Name of the robot whose base is the spacecraft; the first on a floating base if None.
        spacecraft: Basilisk's ``spacecraft.Spacecraft`` with a gravity field and dynamic effectors (drag,
            solar pressure, magnetic torque rods, thrusters, external forces), which act on the base. The
            spacecraft follows the base. The scene's origin starts at ``hub.r_CN_NInit`` with
            ``hub.v_CN_NInit`` and falls freely in the gravity field. If None, only commands act.
        period: Time step of the task [s].
        extrapolated: Whether gravity and effectors are extrapolated linearly over a step, which makes the
            coupling second-order in the step; False holds them, which suits thrusters that switch.
        backend: ``auto``, ``compiled`` or ``interpreted``.

    Returns:
        SceneModule: Module with the messages as attributes; ``result()`` returns the simulation's result.

    Raises:
        SpaceRobotError: If the extra ``basilisk`` is not installed.
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
    """Make a Basilisk module (``SysModel``) with a scene's controllers, which control an ``MJScene``.

    Args:
        scenario: A scene, or the name or file of its scenario.
        bodies: ``mujoco.MJScene`` with the bodies of the scene; built from the scene if None.
        period: Time step of the task [s], over which torques are held.
        backend: ``auto``, ``compiled`` or ``interpreted``.

    Returns:
        ControllerModule: Module whose attribute ``bodies`` is the ``MJScene``.

    Raises:
        SpaceRobotError: If the extra ``basilisk`` is not installed.
        ScenarioError: If a base has other actuators than wheels.
    """
    optional_module("Basilisk.architecture.sysModel", "basilisk", "spacerobot.basilisk")
    from spacerobot.basilisk.controller_module import ControllerModule

    return ControllerModule(scenario, bodies, period=period, backend=backend)
