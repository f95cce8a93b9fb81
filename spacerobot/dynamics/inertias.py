"""Inertial parameters of every body, numeric or symbolic, about its joint's origin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from spacerobot.dynamics.algebra import IDENTITY3, ZERO3, ZERO33, mirror, rotate_symmetric
from spacerobot.dynamics.joints import sparse
from spacerobot.dynamics.kinematics import Kinematics
from spacerobot.dynamics.recorded import recorded

if TYPE_CHECKING:
    import pinocchio


@dataclass(frozen=True)
class Inertias:
    """Mass, first and second moments of each joint's body.

    All tuples are indexed by joint; entry 0 belongs to the universe and is not used. Structural zeros matter:
    a planar arm should hold mass, the moment's x and y, and the rotational inertia's zz alone.

    Attributes:
        mass: kg, 1x1.
        moment: Mass times centre of mass, from the joint origin, in the joint's (moving) axes, kg m, 3x1.
        rotational: Rotational inertia about the *joint origin* in the joint's axes, kg m^2, 3x3 symmetric.
    """

    mass: tuple[ca.SX, ...]
    moment: tuple[ca.SX, ...]
    rotational: tuple[ca.SX, ...]

    @classmethod
    def from_model(cls, model: pinocchio.Model) -> Inertias:
        """Numeric inertias of a model; entries below 1e-15 of the largest become structural zeros."""
        mass, moment, rotational = [ca.SX(1, 1)], [ZERO3], [ZERO33]
        for index in range(1, model.njoints):
            inertia = model.inertias[index]
            spatial = np.asarray(inertia.matrix())
            mass.append(sparse([inertia.mass]))
            moment.append(sparse(inertia.mass * np.asarray(inertia.lever)))
            rotational.append(mirror(sparse(spatial[3:, 3:])))
        return cls(tuple(mass), tuple(moment), tuple(rotational))

    def replaced(self, joint: int, parameters: ca.SX) -> Inertias:
        """Copy with other mass properties of one body.

        Args:
            joint: Id of the joint that carries the body.
            parameters: Its inertial parameters in Pinocchio's order (10x1).
        """
        mass, moment, (xx, xy, yy, xz, yz, zz) = parameters[0], parameters[1:4], ca.vertsplit(parameters[4:])
        about = ca.vertcat(ca.horzcat(xx, xy, xz), ca.horzcat(xy, yy, yz), ca.horzcat(xz, yz, zz))
        parts = zip((self.mass, self.moment, self.rotational), (mass, moment, about), strict=True)
        return Inertias(*((*values[:joint], new, *values[joint + 1 :]) for values, new in parts))

    def in_world(self, kinematics: Kinematics, joint_id: int) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Mass properties of a joint's body about the joint origin, world axes.

        Args:
            kinematics: Posture of the model.
            joint_id: Joint that carries the body.

        Returns:
            tuple: Mass (kg, 1x1), first moment (kg m, 3x1) and rotational inertia (kg m^2, 3x3).
        """
        return self.rotated(kinematics.rotation[joint_id], joint_id)

    def rotated(self, rotation: ca.SX, joint_id: int) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Mass (1x1), first moment (3x1) and rotational inertia (3x3) about the joint origin.

        Args:
            rotation: Rotation from body axes to the requested axes, 3x3.
            joint_id: Joint that carries the body.
        """
        return (
            self.mass[joint_id],
            ca.mtimes(rotation, self.moment[joint_id]),
            rotate_symmetric(rotation, self.rotational[joint_id]),
        )


def sparse_rotor_inertia(model: pinocchio.Model) -> ca.SX:
    """Inertia of the rotors reflected to the velocity coordinates, nv, sparse: the model's ``armature``."""
    return ca.SX(ca.sparsify(ca.DM(model.armature)))


@recorded((1, 1), (3, 1), (3, 3), (3, 1))
def shifted_inertia(mass: ca.SX, moment: ca.SX, rotational: ca.SX, arm: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Rigid-body inertia about a new origin; ``arm`` (m, 3x1) points from the new origin to the old one.

    Parallel-axis theorem with h = m c: ``h' = h + m arm``, ``I' = I + 2 (g.arm) 1 - g arm^T - arm g^T``,
    ``g = h + m arm / 2``.
    """
    half = moment + 0.5 * mass * arm
    product = ca.mtimes(half, arm.T)
    spread = 2 * ca.trace(product) * IDENTITY3 - product - product.T
    return mass, moment + mass * arm, mirror(rotational + spread)
