"""Frames in motion, by Pinocchio's own algorithms; everything in world axes.

What is no law of an element is not written again: mechanics by Pinocchio are those of the engine that ships.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import pinocchio as pin

from spacerobot.common.arrays import Array
from spacerobot.pinocchio_engine.mechanical_state import MechanicalState


class Kinematics(MechanicalState):
    """Frames of a model at one configuration and velocity, computed when first asked for.

    Attributes:
        felt: Wrench on each tip about its origin (6,), by the tip's label, once the engine knows it.
    """

    felt: Mapping[str, Array] = MappingProxyType({})

    def local_wrench(self, joint: int, force: Array, torque: Array, point: Array) -> Any:
        """Wrench on a joint's body, from a force and a torque at a point, in the joint's own axes."""
        at_origin = pin.Force(force, torque + cross(point, force))
        return self.data.oMi[joint].actInv(at_origin)


def cross(a: Array, b: Array) -> Array:
    """Vector product (3,); several times faster than numpy's for single vectors."""
    product: Array = pin.skew(a) @ b
    return product


def rotation_vector(wanted: Array, found: Array) -> Array:
    """Rotation vector (3,), world axes, that turns ``found`` into ``wanted`` [rad]."""
    vector: Array = pin.log3(wanted @ found.T)
    return vector
