"""Grasps that hold in a phase of a plan: rigid ones by an unknown wrench, others by springs and dampers.

The wrench acts on the tip at its origin; the opposite wrench acts on the target at the same point. The wrench
of a rigid grasp does no work in motions that the grasp allows. With the relative velocity A(q) v = 0 its
generalized forces are therefore A' w.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
import pinocchio as pin

from spacerobot.dynamics import Kinematics, frame_placement, frame_velocity, rotation_log
from spacerobot.dynamics.algebra import cross
from spacerobot.dynamics.joints import exact_directions
from spacerobot.elements.grasps.grasp import Displacement
from spacerobot.scene import Scene
from spacerobot.scene.grasp_closing import begun, is_rigid
from spacerobot.scene.scene import SceneGrasp

AXES = "xyz"


def closed_grasps(scene: Scene) -> tuple[SceneGrasp, ...]:
    """Grasps that hold at the start.

    Raises:
        ScenarioError: If one of them is neither rigid nor made of springs and dampers.
    """
    initial_grasps = begun(scene.grasps)
    for grasp in initial_grasps:
        if not is_rigid(grasp) and not grasp.config.has_springs:
            raise scene.error(
                f"found {grasp.config.kind!r}, closed from the start; plans know rigid grasps, "
                "and springs and dampers",
                grasp.path,
            )
    return initial_grasps


def wrench_axes(scene: Scene, grasp: SceneGrasp) -> list[str]:
    """Names of a grasp's wrench components in world axes: forces ``fx``, ... and torques ``tz``, ...

    There are torques only if the grasp holds the orientation.
    """
    forces = [f"f{AXES[i]}" for i in scene.translation_axes]
    turns = scene.rotation_axes if grasp.config.holds_orientation else ()
    return forces + [f"t{AXES[i]}" for i in turns]


def tip_slip(scene: Scene, kinematics: Kinematics, grasps: Sequence[SceneGrasp]) -> ca.SX:
    """Velocity of each tip relative to the target's coincident point (n x 1); see :func:`wrench_axes`."""
    model, velocities = scene.model, ca.SX(0, 1)
    for grasp in grasps:
        (speed, spin), (moving, turning) = (
            frame_velocity(model, kinematics, frame) for frame in (grasp.tip.frame, grasp.frame)
        )
        linear = speed - moving - cross(turning, _gap(scene, kinematics, grasp))
        velocities = ca.vertcat(velocities, linear[list(scene.translation_axes)])
        if grasp.config.holds_orientation:
            velocities = ca.vertcat(velocities, (spin - turning)[list(scene.rotation_axes)])
    return velocities


def spring_wrench(scene: Scene, kinematics: Kinematics, grasp: SceneGrasp) -> tuple[ca.SX, ca.SX]:
    """Force [N] and torque [N m] of springs and dampers on a tip, world axes (3x1 each)."""
    config, turns = grasp.config, grasp.config.holds_orientation
    along, about = list(scene.translation_axes), list(scene.rotation_axes)
    rate = tip_slip(scene, kinematics, [grasp])
    gap, twist, velocity, spin = (ca.SX(3, 1) for _ in range(4))
    gap[along], velocity[along] = _gap(scene, kinematics, grasp)[along], rate[: len(along)]
    if turns:
        # rotation vector from the rest orientation of the springs, world axes
        held, mate = (
            frame_placement(scene.model, kinematics, frame)[0] for frame in (grasp.tip.frame, grasp.frame)
        )
        # orientation of a tip in the mating frame at which rotational springs are unstrained (3x3)
        capture = grasp.config.capture
        if grasp.config.begins == "open":
            rest = np.asarray(
                pin.rpy.rpyToMatrix(np.radians(capture.mated_deg if capture else (0.0, 0.0, 0.0)))
            )
        else:
            data = scene.model.createData()
            pin.framesForwardKinematics(scene.model, data, np.array(scene.q))
            rest = np.asarray(data.oMf[grasp.frame].rotation.T @ data.oMf[grasp.tip.frame].rotation)
        rest_rotation = ca.mtimes(mate, exact_directions(rest))
        relative = ca.mtimes(rest_rotation.T, held)
        flat = ca.atan2(relative[1, 0], relative[0, 0])
        twist[about] = flat if scene.planar else ca.mtimes(rest_rotation, rotation_log(relative))
        spin[about] = rate[len(along) :]
    tip = Displacement(gap, twist, velocity, spin)
    force, torque = config.spring_wrench(lambda key: ca.SX(getattr(config, key)), tip)
    return -force[along], -torque[about] if turns else ca.SX(0, 1)


def _gap(scene: Scene, kinematics: Kinematics, grasp: SceneGrasp) -> ca.SX:
    """Vector from mating frame to tip, world axes (3x1) [m]."""
    tip, mate = (
        frame_placement(scene.model, kinematics, frame)[1] for frame in (grasp.tip.frame, grasp.frame)
    )
    return tip - mate
