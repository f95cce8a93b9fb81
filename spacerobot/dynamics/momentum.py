"""Momentum, energy and mass properties of a model or of a part of it, in world axes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import casadi as ca

from spacerobot.dynamics.algebra import ZERO3, cross
from spacerobot.dynamics.inertias import Inertias, sparse_rotor_inertia
from spacerobot.dynamics.kinematics import Kinematics
from spacerobot.dynamics.recorded import recorded

if TYPE_CHECKING:
    import pinocchio


def subtree(model: pinocchio.Model, joint_id: int) -> tuple[int, ...]:
    """Joint ids of a subtree.

    Args:
        model: Any model.
        joint_id: Root of the subtree.

    Returns:
        tuple: Ids, the root first, without the universe.
    """
    return tuple(int(index) for index in model.subtrees[joint_id] if index)


def momentum(
    model: pinocchio.Model,
    kinematics: Kinematics,
    inertias: Inertias,
    joints: Iterable[int] | None = None,
    about: ca.SX | None = None,
) -> tuple[ca.SX, ca.SX]:
    """Linear momentum and angular momentum about a point fixed in the world.

    Args:
        model, kinematics, inertias: The system and its motion.
        joints: Ids of the joints whose bodies are summed; ``None`` means all.
        about: World point, m, 3x1; ``None`` means the world's origin.

    Returns:
        tuple: Linear (N s) and angular (N m s) momentum, world axes, 3x1 each.
    """
    linear, angular = ZERO3, ZERO3
    for index in _chosen(model, joints):
        in_world = kinematics.local[index].in_world
        push, turn = map(in_world, _body_momentum(kinematics, inertias, index))
        lever = kinematics.origin[index] if about is None else kinematics.origin[index] - about
        linear = linear + push
        angular = angular + turn + cross(lever, push)
    return linear, angular


def kinetic_energy(
    model: pinocchio.Model,
    kinematics: Kinematics,
    inertias: Inertias,
    joints: Iterable[int] | None = None,
) -> ca.SX:
    """Kinetic energy of bodies and of the rotors that drive them.

    Args:
        model, kinematics, inertias: The system and its motion.
        joints: Ids of the joints whose bodies are summed; ``None`` means all.

    Returns:
        casadi.SX: J, 1x1.
    """
    rotor = sparse_rotor_inertia(model)
    doubled = ca.SX(1, 1)
    for index in _chosen(model, joints):
        push, turn = _body_momentum(kinematics, inertias, index)
        doubled = doubled + ca.mtimes(kinematics.local[index].velocity.T, push)
        doubled = doubled + ca.mtimes(kinematics.local[index].spin.T, turn)
        joint = kinematics.joints[index - 1]
        rates = joint.rates(kinematics.velocity)
        doubled = doubled + ca.mtimes(joint.rates(rotor).T, rates * rates)
    return 0.5 * doubled


def total_mass(model: pinocchio.Model, inertias: Inertias, joints: Iterable[int] | None = None) -> ca.SX:
    """Total mass of bodies.

    Args:
        model, inertias: The system and its mass properties.
        joints: Ids of the joints whose bodies are summed; ``None`` means all.

    Returns:
        casadi.SX: kg, 1x1.
    """
    mass = ca.SX(1, 1)
    for index in _chosen(model, joints):
        mass = mass + inertias.mass[index]
    return mass


def centre_of_mass(
    model: pinocchio.Model,
    kinematics: Kinematics,
    inertias: Inertias,
    joints: Iterable[int] | None = None,
) -> ca.SX:
    """Common centre of mass of bodies.

    Args:
        model, kinematics, inertias: The system, its posture and its mass properties.
        joints: Ids of the joints whose bodies are summed; ``None`` means all.

    Returns:
        casadi.SX: Position in the world, m, 3x1.
    """
    chosen = _chosen(model, joints)
    moment = ZERO3
    for index in chosen:
        first = ca.mtimes(kinematics.rotation[index], inertias.moment[index])
        moment = moment + inertias.mass[index] * kinematics.origin[index] + first
    return moment / total_mass(model, inertias, chosen)


def _chosen(model: pinocchio.Model, joints: Iterable[int] | None) -> tuple[int, ...]:
    return tuple(range(1, model.njoints)) if joints is None else tuple(joints)


def _body_momentum(kinematics: Kinematics, inertias: Inertias, index: int) -> tuple[ca.SX, ca.SX]:
    """Linear momentum, and angular momentum about the joint origin, of one body in its calculation axes."""
    motion = kinematics.local[index]
    mass, moment, rotational = inertias.rotated(motion.body, index)
    return _moved(mass, moment, rotational, motion.velocity, motion.spin)


@recorded((1, 1), (3, 1), (3, 3), (3, 1), (3, 1))
def _moved(
    mass: ca.SX, moment: ca.SX, rotational: ca.SX, velocity: ca.SX, spin: ca.SX
) -> tuple[ca.SX, ca.SX]:
    linear = mass * velocity + cross(spin, moment)
    return linear, cross(moment, velocity) + ca.mtimes(rotational, spin)
