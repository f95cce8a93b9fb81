"""Forward dynamics of the closed loop: one dense linear system for everything that is implicit.

    [ M       -J^T   G^T ] [v']   [tau - h ]
    [ K_d C    1     0   ] [u ] = [command ]
    [ G        0     0   ] [w ]   [b       ]

M is the joint space inertia, h the bias forces with springs and resistance, u the channels' outputs and w the
wrenches of the rigid grasps on the target and, last, the torques that hold joints to those they mimic. The
acceleration itself is then the articulated-body algorithm's, under the torques and wrenches found.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from spacerobot.arrays import Array
from spacerobot.pinocchio_engine.actuation import Delivered, Push
from spacerobot.pinocchio_engine.contacts import Pressure
from spacerobot.pinocchio_engine.grasps import Constraint, Relative
from spacerobot.pinocchio_engine.kinematics import Kinematics, joint_space_inertia
from spacerobot.pinocchio_engine.tip_control import Command
from spacerobot.scene import SceneGrasp

Wrench = tuple[SceneGrasp, Relative, Array, Array]
"""A grasp, its relative motion, and the force and torque on the target at the tip's point, (3,) each."""


@dataclass(frozen=True)
class Loads:
    """What acts on the plant and what it must obey.

    Attributes
    ----------
    torque
        Known generalized forces of the actuators (nv,).
    resistance
        Of the joints (nv,) [N m s/rad or N s/m].
    wrenches
        Of compliant grasps.
    commands
        Of the tips' channels.
    constraints
        Of rigid grasps.
    deliveries
        From the generalized forces (nv,) that actuators are asked for to what they deliver, each after the
        one before.
    spread
        Velocities of all joints from those of the free ones (nv, nv).
    pressures
        Of contacts.
    outside
        Wrenches from outside.
    """

    torque: Array
    resistance: Array
    wrenches: Sequence[Wrench]
    commands: Sequence[Command]
    constraints: Sequence[Constraint]
    deliveries: Sequence[Callable[[Array], Delivered]]
    spread: Array
    pressures: Sequence[Pressure] = ()
    outside: Sequence[Push] = ()

    @property
    def ties(self) -> Array:
        """Velocity of each joint that mimics another one, relative to what it mimics (n, nv)."""
        ties: Array = (np.eye(len(self.spread)) - self.spread)[np.diag(self.spread) == 0]
        return ties


@dataclass(frozen=True)
class Solution:
    """Acceleration (nv,), actuator torques (nv,), wrenches of rigid grasps, and what each actuator does."""

    acceleration: Array
    torque: Array
    wrenches: list[Wrench]
    delivered: list[Delivered]


def solve(kinematics: Kinematics, loads: Loads) -> Solution:
    """Solve the closed loop at one instant; actuators are asked as if they delivered everything.

    Raises
    ------
    numpy.linalg.LinAlgError
        In a posture in which rigid grasps fix a freedom twice.
    """
    outputs, reactions = _implicit(kinematics, loads, loads.torque, loads.commands)
    torque = loads.torque + sum(
        (command.jacobian.T @ u for command, u in zip(loads.commands, outputs, strict=True)),
        np.zeros(kinematics.model.nv),
    )
    delivered: list[Delivered] = []
    for deliver in loads.deliveries:
        delivered.append(deliver(torque))
        torque = delivered[-1].torque
    if delivered:
        pushes = [push for one in delivered for push in (*one.inner, *one.outside)]
        loads = replace(loads, outside=[*loads.outside, *pushes])
        _, reactions = _implicit(kinematics, loads, torque, [])
    wrenches = []
    *reactions, ties = reactions
    for constraint, reaction in zip(loads.constraints, reactions, strict=True):
        wrench = np.zeros(6)
        wrench[constraint.rows] = reaction
        wrenches.append((constraint.grasp, constraint.relative, wrench[:3], wrench[3:]))
    model = kinematics.model
    acceleration = pin.aba(
        model,
        model.createData(),
        kinematics.q,
        kinematics.v,
        torque - loads.resistance * kinematics.v - loads.ties.T @ ties,
        _external(kinematics, [*loads.wrenches, *wrenches], loads),
    )
    return Solution(np.array(acceleration), torque, wrenches, delivered)


def _implicit(
    kinematics: Kinematics, loads: Loads, torque: Array, commands: Sequence[Command]
) -> tuple[list[Array], list[Array]]:
    """Outputs of the channels; wrenches of the rigid grasps and, last, torques of joints that mimic."""
    model, nv = kinematics.model, kinematics.model.nv
    bias = pin.rnea(
        model,
        model.createData(),
        kinematics.q,
        kinematics.v,
        np.zeros(nv),
        _external(kinematics, loads.wrenches, loads),
    )
    jacobian = np.vstack([np.empty((0, nv)), *(c.jacobian for c in commands)])
    fixed = np.vstack([np.empty((0, nv)), *(c.jacobian for c in loads.constraints), loads.ties])
    nu, size = len(jacobian), nv + len(jacobian) + len(fixed)
    matrix = np.eye(size)
    matrix[:nv] = np.hstack([joint_space_inertia(kinematics), -jacobian.T, fixed.T])
    matrix[nv : nv + nu, :nv] = np.vstack([np.empty((0, nv)), *(c.gain * c.feedback for c in commands)])
    matrix[nv + nu :, :nv], matrix[nv + nu :, nv + nu :] = fixed, 0.0
    right = np.concatenate(
        [
            torque - loads.resistance * kinematics.v - bias,
            *(c.command for c in commands),
            *(constraint.right for constraint in loads.constraints),
            np.zeros(len(loads.ties)),
        ]
    )
    unknown = np.linalg.solve(matrix, right)[nv:]
    sizes = [len(c.command) for c in commands] + [len(c.rows) for c in loads.constraints]
    parts = np.split(unknown, np.cumsum(sizes))
    return parts[: len(commands)], parts[len(commands) :]


def _external(kinematics: Kinematics, wrenches: Sequence[Wrench], loads: Loads) -> pin.StdVec_Force:
    """Forces on each joint's body in its own axes: on the target or second as given, else opposite."""
    total = [pin.Force.Zero() for _ in range(kinematics.model.njoints)]
    for grasp, relative, force, torque in wrenches:
        at = relative.point
        total[grasp.joint] += kinematics.local_wrench(grasp.joint, force, torque, at)
        total[grasp.tip.joint] += kinematics.local_wrench(grasp.tip.joint, -force, -torque, at)
    for wrench in loads.outside:
        own = kinematics.local_wrench(wrench.joint, wrench.force, wrench.torque, wrench.point)
        total[wrench.joint] += own
    for pressure in loads.pressures:
        (first, second), at = pressure.touch.pair, pressure.touch.point
        total[second.joint] += kinematics.local_wrench(second.joint, pressure.force, np.zeros(3), at)
        total[first.joint] += kinematics.local_wrench(first.joint, -pressure.force, np.zeros(3), at)
    external = pin.StdVec_Force()
    external.extend(total)
    return external
