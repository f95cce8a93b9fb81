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

from spacerobot.common.arrays import Array
from spacerobot.scene import SceneGrasp
from tests.oracles.engine.actuation import Delivered, Push
from tests.oracles.engine.contacts import Pressure
from tests.oracles.engine.grasps import Constraint, Relative
from tests.oracles.engine.kinematics import Kinematics
from tests.oracles.engine.tip_control import Command

Wrench = tuple[SceneGrasp, Relative, Array, Array]
"""A grasp, its relative motion, and the force and torque on the target at the tip's point, (3,) each."""


@dataclass(frozen=True)
class Drive:
    """An actuator: its places in v, where it leaves the rest to the next one, and from asked to delivered."""

    columns: Sequence[int]
    passes_on: Sequence[int]
    deliver: Callable[[Array], Delivered]


@dataclass(frozen=True)
class Loads:
    """What acts on the plant and what it must obey.

    Attributes:
        torque: Known generalized forces of the actuators (nv,).
        resistance: Of the joints (nv,) [N m s/rad or N s/m].
        wrenches: Of compliant grasps.
        commands: Of the tips' channels.
        constraints: Of rigid grasps.
        drives: Of actuators, each after the one before.
        spread: Velocities of all joints from those of the free ones (nv, nv).
        pressures: Of contacts.
        outside: Wrenches from outside.
    """

    torque: Array
    resistance: Array
    wrenches: Sequence[Wrench]
    commands: Sequence[Command]
    constraints: Sequence[Constraint]
    drives: Sequence[Drive]
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
    """Solve the closed loop at one instant.

    Actuators of what implicit outputs act on are asked as if they delivered everything; the others deliver
    before these are solved for.

    Raises:
        numpy.linalg.LinAlgError: In a posture in which rigid grasps fix a freedom twice.
    """
    implicit = [command for command in loads.commands if np.any(command.gain)]
    explicit = [command for command in loads.commands if not np.any(command.gain)]
    first, then = _in_turn(loads.drives, implicit)
    delivered: dict[int, Delivered] = {}
    torque = loads.torque + _summed(explicit, [command.command for command in explicit], len(loads.torque))
    torque, loads = _delivered(torque, loads, first, delivered)
    outputs, reactions = _implicit(kinematics, loads, torque, implicit)
    torque = torque + _summed(implicit, outputs, len(torque))
    if then:
        torque, loads = _delivered(torque, loads, then, delivered)
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
    return Solution(np.array(acceleration), torque, wrenches, [delivered[k] for k in sorted(delivered)])


def _summed(commands: Sequence[Command], outputs: Sequence[Array], size: int) -> Array:
    """Torques (nv,) that outputs of channels come to."""
    found = np.zeros(size)
    for command, output in zip(commands, outputs, strict=True):
        found += command.jacobian.T @ output
    return found


def _in_turn(drives: Sequence[Drive], implicit: Sequence[Command]) -> tuple[list[int], list[int]]:
    """Numbers of the actuators of places on which no implicit output acts, and of the others."""
    acting = {int(column) for command in implicit for column in np.flatnonzero(command.jacobian.any(axis=0))}
    first, then = list[int](), list[int]()
    for k, drive in enumerate(drives):
        if acting.isdisjoint(drive.columns):
            first.append(k)
        else:
            then.append(k)
            acting |= set(drive.columns)
    return first, then


def _delivered(
    torque: Array, loads: Loads, chosen: Sequence[int], found: dict[int, Delivered]
) -> tuple[Array, Loads]:
    """Torque (nv,) that some actuators deliver, and the loads with their wrenches; notes what each does."""
    left, pushes = set[int](), list(loads.outside)
    for k in chosen:
        drive = loads.drives[k]
        found[k] = drive.deliver(torque)
        torque, left = found[k].torque, left.difference(drive.columns).union(drive.passes_on)
        pushes += [*found[k].inner, *found[k].outside]
    torque = np.array(torque)
    torque[sorted(left)] = 0.0
    return torque, replace(loads, outside=pushes)


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
    matrix[:nv] = np.hstack([kinematics.inertia, -jacobian.T, fixed.T])
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
