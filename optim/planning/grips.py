"""Rigid grasps that hold while a plan lasts: the wrench of each, and that its two frames move as one.

The wrench acts on the tip at its origin, and opposite on the target's point there. It does no work on motions
that the grasp allows, so its generalized forces are A' w with A the slopes of the relative velocity A v.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from spacerobot.dynamics import Kinematics, frame_placement, frame_velocity
from spacerobot.dynamics.algebra import cross
from spacerobot.errors import ScenarioError
from spacerobot.scene import Scene
from spacerobot.scene.closing import begun, is_rigid
from spacerobot.scene.scene import SceneGrasp

AXES = "xyz"


def held(scene: Scene) -> tuple[SceneGrasp, ...]:
    """Grasps that hold from the beginning to the end.

    Raises
    ------
    ScenarioError
        If one of them is not rigid.
    """
    found = begun(scene.grasps)
    for grasp in found:
        if not is_rigid(grasp):
            raise ScenarioError(
                f"found {grasp.config.kind!r}, closed from the start; plans know rigid grasps alone: give "
                "`kind: weld` or `point`",
                source=scene.source,
                where=grasp.path,
            )
    return found


def axes_of(scene: Scene, grasp: SceneGrasp) -> list[str]:
    """Names of the entries of a grasp's wrench: ``fx``, ... and for a weld ``tz``, ..., world axes."""
    forces = [f"f{AXES[i]}" for i in scene.translation_axes]
    turns = scene.rotation_axes if grasp.config.fixes_orientation else ()
    return forces + [f"t{AXES[i]}" for i in turns]


def slip(scene: Scene, kinematics: Kinematics, grasps: Sequence[SceneGrasp]) -> ca.SX:
    """Velocity of each tip relative to the target's point there (n x 1), in the order of :func:`axes_of`."""
    model, found = scene.model, ca.SX(0, 1)
    for grasp in grasps:
        (speed, spin), (moving, turning) = (
            frame_velocity(model, kinematics, frame) for frame in (grasp.tip.frame, grasp.frame)
        )
        tip, mate = (frame_placement(model, kinematics, frame)[1] for frame in (grasp.tip.frame, grasp.frame))
        linear = speed - moving - cross(turning, tip - mate)
        found = ca.vertcat(found, linear[list(scene.translation_axes)])
        if grasp.config.fixes_orientation:
            found = ca.vertcat(found, (spin - turning)[list(scene.rotation_axes)])
    return found
