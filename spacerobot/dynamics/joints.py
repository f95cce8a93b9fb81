"""Properties of Pinocchio joints that the algorithms use, read once from the model.

The configuration and velocity conventions are Pinocchio's: a planar joint is ``(x, y, cos, sin)``, a
free-flyer ``(x, y, z, qx, qy, qz, qw)``, and the velocity of both is expressed in the moving frame.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from spacerobot.common.arrays import Array
from spacerobot.common.errors import DescriptionError
from spacerobot.dynamics.algebra import IDENTITY3, ZERO3
from spacerobot.dynamics.rotations import rotation_from_quaternion, turn

if TYPE_CHECKING:
    import pinocchio

NOISE = 1e-15
"""Distance from 0, 1 or -1 within which entries of rotations and directions are set to exactly that value.

``rpy="0 0 1.5707963267948966"`` leaves cosines of 6e-17. Such entries would turn structural zeros into
arithmetic for the whole subtree; setting them to zero changes a rotation by less than its own rounding error.
"""


class JointKind(Enum):
    """Families of supported joints; members differ in axis and placement."""

    REVOLUTE = "revolute"
    UNBOUNDED = "unbounded revolute"
    PRISMATIC = "prismatic"
    PLANAR = "planar"
    FREE_FLYER = "free-flyer"


_KINDS = {
    **dict.fromkeys(("RX", "RY", "RZ", "RevoluteUnaligned"), JointKind.REVOLUTE),
    **dict.fromkeys(("RUBX", "RUBY", "RUBZ", "RevoluteUnboundedUnaligned"), JointKind.UNBOUNDED),
    **dict.fromkeys(("PX", "PY", "PZ", "PrismaticUnaligned"), JointKind.PRISMATIC),
    "Planar": JointKind.PLANAR,
    "FreeFlyer": JointKind.FREE_FLYER,
}


@dataclass(frozen=True)
class JointModel:
    """Joint of a model, with exact zeros and ones in its rotation and motion subspace.

    Attributes:
        index, parent: Joint indices; 0 is the universe.
        kind: Family.
        idx_q, nq, idx_v, nv: Place and size in the configuration and in the velocity.
        rotation, offset: Placement in the parent's joint frame: 3x3 and 3x1 (m), constant and sparse.
        linear, angular: Motion subspace in the joint's own (moving) axes, 3xnv each, constant and sparse.
    """

    index: int
    parent: int
    kind: JointKind
    idx_q: int
    nq: int
    idx_v: int
    nv: int
    rotation: ca.SX
    offset: ca.SX
    linear: ca.SX
    angular: ca.SX

    def coordinates(self, q: ca.SX) -> ca.SX:
        """Coordinates of this joint in the configuration ``q`` (nq), dense."""
        return q[self.idx_q : self.idx_q + self.nq]

    def rates(self, v: ca.SX) -> ca.SX:
        """Rows of this joint in vectors in velocity coordinates (nv x n)."""
        return v[self.idx_v : self.idx_v + self.nv, :]


def read_joints(model: pinocchio.Model) -> tuple[JointModel, ...]:
    """Joints of a model in Pinocchio's order, without the universe.

    Raises:
        DescriptionError: If a joint is of a type the algorithms do not cover; it names the joint.
    """
    import pinocchio  # laws import this package; a scenario that is only validated has no model

    neutral = pinocchio.neutral(model)
    return tuple(_read(model, index, neutral) for index in range(1, model.njoints))


def _read(model: pinocchio.Model, index: int, neutral: Array) -> JointModel:
    source: Any = model.joints[index]
    name = source.shortname().removeprefix("JointModel")
    if name not in _KINDS:
        raise DescriptionError(
            f"joint type {name} is not supported; allowed: {', '.join(_KINDS)}",
            where=f"joint {model.names[index]!r}",
        )
    data = source.createData()
    source.calc(data, neutral)
    subspace = np.asarray(data.S, dtype=float).reshape(6, source.nv)
    placement = model.jointPlacements[index]
    return JointModel(
        index=index,
        parent=int(model.parents[index]),
        kind=_KINDS[name],
        idx_q=source.idx_q,
        nq=source.nq,
        idx_v=source.idx_v,
        nv=source.nv,
        rotation=exact_directions(placement.rotation),
        offset=sparse(placement.translation),
        linear=exact_directions(subspace[:3]),
        angular=exact_directions(subspace[3:]),
    )


def exact_directions(matrix: npt.ArrayLike) -> ca.SX:
    """Sparse copy of unit directions with rounding noise about 0, 1 and -1 removed (see :data:`NOISE`)."""
    values = np.array(matrix, dtype=float)
    nearest = np.rint(values)
    return _constant(np.where(np.abs(values - nearest) < NOISE, nearest, values))


def sparse(array: npt.ArrayLike) -> ca.SX:
    """Sparse copy of an array; entries below :data:`NOISE` of the largest one become structural zeros."""
    values = np.array(array, dtype=float)
    largest = np.max(np.abs(values), initial=0.0)
    return _constant(np.where(np.abs(values) <= NOISE * largest, 0.0, values))


def _constant(values: Array) -> ca.SX:
    return _known_constant(values.tobytes(), values.shape)


@functools.lru_cache(maxsize=10_000)
def _known_constant(entries: bytes, shape: tuple[int, ...]) -> ca.SX:
    """Sparse constant, cached: a closed loop needs the constants of each joint and frame several times."""
    return ca.SX(ca.sparsify(ca.DM(np.frombuffer(entries).reshape(shape))))


def joint_rotation(joint: JointModel, coordinates: ca.SX) -> ca.SX:
    """Rotation from the joint frame after the joint's motion to that before it, 3x3."""
    match joint.kind:
        case JointKind.REVOLUTE:
            return turn(joint.angular, ca.cos(coordinates), ca.sin(coordinates))
        case JointKind.UNBOUNDED:
            return turn(joint.angular, coordinates[0], coordinates[1])
        case JointKind.PLANAR:
            return turn(joint.angular[:, 2], coordinates[2], coordinates[3])
        case JointKind.FREE_FLYER:
            return rotation_from_quaternion(coordinates[3:7])
        case _:
            return IDENTITY3


def joint_translation(joint: JointModel, coordinates: ca.SX) -> ca.SX:
    """Origin of the joint frame after the joint's motion, in the frame before it, m, 3x1."""
    match joint.kind:
        case JointKind.PRISMATIC:
            return joint.linear * coordinates
        case JointKind.PLANAR:
            return ca.vertcat(coordinates[0], coordinates[1], ca.SX(1, 1))
        case JointKind.FREE_FLYER:
            return coordinates[:3]
        case _:
            return ZERO3
