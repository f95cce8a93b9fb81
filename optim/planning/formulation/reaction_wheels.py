"""Reaction wheels in a plan: their momentum follows from conservation of angular momentum.

Only wheels exchange angular momentum with the bodies. With the wheels' axes A in the root link's axes,

    A h(t) = R(t)' (L(0) + R(0) A h(0) - L(q, v)),    h(t) = h(0) + A^+ A (h(t) - h(0)),

L is the angular momentum of a robot and of the object that it captures or holds, about their common centre of
mass. The momenta h therefore need no unknowns. A planned torque T on the base requires motor torques ``-A^+
(T + w x A h)`` with the base's angular velocity w. The feedback compensates for friction of the wheels.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.linalg import null_space

from optim.planning.formulation.grasps import closed_grasps
from optim.planning.formulation.stage import Stage
from spacerobot.dynamics import Inertias, Kinematics, centre_of_mass, forward_kinematics, momentum
from spacerobot.dynamics.algebra import cross
from spacerobot.dynamics.joints import sparse
from spacerobot.elements.actuators.actuator import MomentumStorage
from spacerobot.elements.goals.plan_instant import BoundedRow, zero
from spacerobot.scenario.bodies import Robot
from spacerobot.scenario.plan import PlanSection
from spacerobot.scene import Scene
from spacerobot.scene.configure import close_velocity
from spacerobot.scene.grasp_closing import is_rigid
from spacerobot.scene.scene import SceneBody


def only_wheels(body: SceneBody) -> MomentumStorage | None:
    """Wheel set of a robot whose base has no other actuator; None otherwise."""
    if not isinstance(body.config, Robot):
        return None
    actuators = [part for _, part in body.config.driven_by() if part.base_wrench]
    return actuators[0].momentum_storage() if len(actuators) == 1 else None


@dataclass(frozen=True, eq=False)
class WheelDrivenBase:
    """A robot whose base only wheels drive, at one instant.

    Attributes:
        wheels: The wheel set.
        momenta: Angular momentum of each wheel about its axis (n x 1) [N m s].
        speeds: Speed of each wheel relative to the base (n x 1) [rad/s].
        commanded: Torque commanded on the base, including the wheels' gyroscopic torque (3x1) [N m].
    """

    wheels: MomentumStorage
    momenta: ca.SX
    speeds: ca.SX
    commanded: ca.SX

    @property
    def motors(self) -> ca.SX:
        """Torques of the motors (n x 1) [N m]."""
        return ca.mtimes(sparse(-np.linalg.pinv(self.wheels.axes)), self.commanded)


def wheel_driven_bases(stage: Stage) -> dict[str, WheelDrivenBase]:
    """Robots whose bases only wheels drive, by name."""
    scene, driven_bases = stage.scene, {}
    for body in scene.robots:
        wheels, driven = only_wheels(body), stage.driven.of_base(body.name)
        if wheels is None or not driven or not all(axis.startswith("t") for axis in driven):
            continue
        axes, inertia = wheels.axes, wheels.inertia
        first, size = int(scene.model.idx_vs[body.root_joint]), int(scene.model.nvs[body.root_joint])
        about, columns = ([2], [first + 2]) if size == 3 else ([0, 1, 2], [first + k for k in (3, 4, 5)])
        start = close_velocity(scene) if any(is_rigid(grasp) for grasp in closed_grasps(scene)) else scene.v
        before = forward_kinematics(scene.model, ca.SX(np.array(scene.q)), ca.SX(np.array(start)))
        spins = np.zeros(3)
        spins[about] = np.array(start)[columns]
        began = inertia * (axes.T @ spins + wheels.speeds)
        turn = np.array(ca.DM(before.rotation[body.root_joint]))
        total_momentum = np.array(ca.DM(_angular(scene, body, before))).ravel() + turn @ axes @ began
        left = sparse(total_momentum) - _angular(scene, body, stage.kinematics)
        carried = ca.mtimes(stage.kinematics.rotation[body.root_joint].T, left)
        momenta = sparse(began) + ca.mtimes(sparse(np.linalg.pinv(axes)), carried - sparse(axes @ began))
        spin, torque = ca.SX(3, 1), ca.SX(3, 1)
        spin[about] = stage.v[columns]
        for k, axis in zip(about, ("tx", "ty", "tz") if size == 6 else ("tz",), strict=True):
            torque[k] = stage.u[stage.driven.names.index(f"{body.name}/base.{axis}")]
        speeds = momenta / inertia - ca.mtimes(sparse(axes.T), spin)
        driven_bases[body.name] = WheelDrivenBase(wheels, momenta, speeds, torque + cross(spin, carried))
    return driven_bases


def wheel_rows(stage: Stage, plan: PlanSection) -> Iterator[BoundedRow]:
    """Limits of the wheels' torques and speeds.

    Raises:
        ScenarioError: If momentum is relative to a start that is free.
    """
    for name, turned in wheel_driven_bases(stage).items():
        if name in plan.start:
            raise stage.scene.error(
                f"the momentum of {name}'s wheels counts from where it begins, and that is free; leave it "
                "out, or let nothing drive the base by `limits.base_torque: 0`",
                f"plan.start.{name}",
            )
        # refuse an object that several robots hold: the split of its momentum among their wheels is
        # undetermined
        holding = {grasp.tip.body.name for grasp in stage.scene.grasps}
        if name in holding and len(holding) > 1:
            other = min(holding - {name})
            raise stage.scene.error(
                f"{other!r} grasps the target too, so that the momentum of {name}'s wheels is not known; let "
                "nothing drive the base by `limits.base_torque: 0`",
                "plan.limits",
            )
        # directions about which the wheels give no torque (k, 3)
        across = np.zeros((0, 3)) if stage.scene.planar else np.asarray(null_space(turned.wheels.axes.T).T)
        for k, value in enumerate(ca.vertsplit(ca.mtimes(sparse(across), turned.commanded))):
            yield zero(f"torque {k} across {name}'s wheels", "N m", value)
        for what, unit, values, most in (
            ("torque", "N m", turned.motors, turned.wheels.torque_limit),
            ("speed", "rad/s", turned.speeds, turned.wheels.speed_limit),
        ):
            if most is not None:
                for k, value in enumerate(ca.vertsplit(values)):
                    label = f"{what} of {name}'s wheel {k}"
                    yield BoundedRow(label, unit, value, -most, most, size=most)


def commanded_base_wrench(stage: Stage) -> ca.SX:
    """Wrench commanded by controllers that follow a plan, along the axes of driven bases (n x 1) [N, N m]."""
    joints, driven_bases = len(stage.driven.joints), wheel_driven_bases(stage)
    wrenches = list[ca.SX]()
    for k, name in enumerate(stage.driven.names[joints:], start=joints):
        robot, _, axis = name.rpartition("/base.")
        wheel_base = driven_bases.get(robot)
        wrenches.append(stage.u[k] if wheel_base is None else wheel_base.commanded["xyz".index(axis[1])])
    return ca.vertcat(ca.SX(0, 1), *wrenches)


def _angular(scene: Scene, body: SceneBody, kinematics: Kinematics) -> ca.SX:
    """Angular momentum of a robot and the target it may grasp about their centre of mass (3x1) [N m s]."""
    catches = any(grasp.tip.body.name == body.name for grasp in scene.grasps) and scene.target is not None
    joints = [*body.subtree, *(scene.target.subtree if catches and scene.target else ())]
    model, inertias = scene.model, Inertias.from_model(scene.model)
    centre = centre_of_mass(model, kinematics, inertias, joints)
    return momentum(model, kinematics, inertias, joints, centre)[1]
