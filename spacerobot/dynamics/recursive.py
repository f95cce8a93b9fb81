"""Inverse dynamics by the recursive Newton-Euler algorithm (Featherstone 2008, Table 5.1)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import casadi as ca

from spacerobot.dynamics.algebra import cross
from spacerobot.dynamics.articulated import Wrench, applied_loads, inertia_force
from spacerobot.dynamics.inertias import Inertias, sparse_rotor_inertia
from spacerobot.dynamics.kinematics import Kinematics

if TYPE_CHECKING:
    import pinocchio


def inverse_dynamics(
    model: pinocchio.Model,
    kinematics: Kinematics,
    inertias: Inertias,
    acceleration: ca.SX,
    wrenches: Iterable[Wrench] = (),
) -> ca.SX:
    """Generalised force of an acceleration: ``M a + h - sum J^T f``, with the model's gravity.

    Args:
        model, kinematics, inertias: The system and its motion.
        acceleration: v-dot in Pinocchio's velocity coordinates, nv; may be sparse.
        wrenches: Applied forces and couples.

    Returns:
        casadi.SX: Generalised force in velocity coordinates (N, N m), nv.
    """
    rotor = sparse_rotor_inertia(model)
    # outward: wrench that each body needs, I a + bias - f_ext, in its calculation axes;
    # inward: tau_i = S_i^T f_i + (rotor inertia) a_i, and the parent also carries f_i
    forces = [-load for load in applied_loads(model, kinematics, wrenches)]
    carried = [ca.SX(6, 1)] * model.njoints  # acceleration beyond that at zero joint acceleration
    for joint in kinematics.joints:
        motion = kinematics.local[joint.index]
        relative = ca.mtimes(ca.vertcat(motion.linear, motion.angular), joint.rates(acceleration))
        carried[joint.index] = motion.carried(carried[joint.parent]) + relative
        linear, angular = carried[joint.index][:3], carried[joint.index][3:]
        mass, moment, rotational = inertias.rotated(motion.body, joint.index)
        force = mass * linear + cross(angular, moment)
        torque = cross(moment, linear) + ca.mtimes(rotational, angular)
        bias = inertia_force(model, motion, (mass, moment, rotational))
        forces[joint.index] = forces[joint.index] + bias + ca.vertcat(force, torque)
    efforts: list[ca.SX] = []
    for joint in reversed(kinematics.joints):
        motion, load = kinematics.local[joint.index], forces[joint.index]
        reflected = joint.rates(rotor) * joint.rates(acceleration)
        efforts.append(ca.mtimes(ca.vertcat(motion.linear, motion.angular).T, load) + reflected)
        force = motion.outward(load[:3])
        torque = motion.outward(load[3:]) + cross(motion.arm, force)
        forces[joint.parent] = forces[joint.parent] + ca.vertcat(force, torque)
    return ca.vertcat(*reversed(efforts))
