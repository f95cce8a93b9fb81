"""Joint-space inertia matrix by composite rigid bodies (Featherstone 2008, Table 6.2), world axes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca

from spacerobot.dynamics.algebra import cross, mirror
from spacerobot.dynamics.inertias import Inertias, shifted_inertia, sparse_rotor_inertia
from spacerobot.dynamics.kinematics import Kinematics

if TYPE_CHECKING:
    import pinocchio


def mass_matrix(
    model: pinocchio.Model,
    kinematics: Kinematics,
    inertias: Inertias,
    rotor_inertia: ca.SX | None = None,
) -> ca.SX:
    """Joint-space inertia matrix M, nv x nv, sparse and symmetric.

    Args:
        model, kinematics, inertias: The system and its posture.
        rotor_inertia: Inertia of the rotors reflected to the velocity coordinates, nv; ``None`` takes the
            model's ``armature``.
    """
    rotor = sparse_rotor_inertia(model) if rotor_inertia is None else rotor_inertia
    composite = [inertias.in_world(kinematics, index) for index in range(model.njoints)]
    matrix = ca.SX(model.nv, model.nv)
    for joint in reversed(kinematics.joints):
        mass, moment, rotational = composite[joint.index]
        arm = kinematics.origin[joint.index] - kinematics.origin[joint.parent]
        first = composite[joint.parent]
        second = shifted_inertia(mass, moment, rotational, arm)
        composite[joint.parent] = (first[0] + second[0], first[1] + second[1], mirror(first[2] + second[2]))
        # The subtree's inertia is complete here, since children come first. A unit velocity along column k
        # gives it the momentum (force, torque); M_jk is its component along an axis j from here to the root.
        for k in range(joint.nv):
            column = joint.idx_v + k
            along = kinematics.linear[joint.index][:, k]
            about = kinematics.angular[joint.index][:, k]
            force = mass * along + cross(about, moment)
            torque = cross(moment, along) + ca.mtimes(rotational, about)
            _fill_column(matrix, kinematics, joint.index, column, force, torque)
        for row in range(joint.idx_v, joint.idx_v + joint.nv):
            matrix[row, row] += rotor[row]
    return mirror(matrix.T)


def _fill_column(
    matrix: ca.SX, kinematics: Kinematics, index: int, column: int, force: ca.SX, torque: ca.SX
) -> None:
    """Project a wrench at joint ``index`` on that joint and all its ancestors, into the upper triangle."""
    while index:
        joint = kinematics.joints[index - 1]
        rows = slice(joint.idx_v, joint.idx_v + joint.nv)
        matrix[rows, column] = ca.mtimes(kinematics.linear[index].T, force) + ca.mtimes(
            kinematics.angular[index].T, torque
        )
        arm = kinematics.origin[index] - kinematics.origin[joint.parent]
        torque = torque + cross(arm, force)
        index = joint.parent
