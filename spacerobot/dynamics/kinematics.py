"""Forward kinematics of any supported model, in world axes throughout.

World axes are chosen on purpose: Jacobian columns, tip forces and momenta need no further rotation, and
in a planar mechanism every quantity keeps its zeros.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import pinocchio

from spacerobot.dynamics.algebra import IDENTITY3, ZERO3, ZERO33, cross, velocity_gradient
from spacerobot.dynamics.joints import (
    Joint,
    JointKind,
    exact_directions,
    joint_rotation,
    joint_translation,
    read_joints,
    sparse,
)


@dataclass(frozen=True)
class Kinematics:
    """Motion of every joint frame at one (q, v), world axes.

    All tuples are indexed by joint, 0 being the universe.

    Attributes
    ----------
    joints
        The joints, in order, without the universe.
    velocity
        v, Pinocchio's coordinates, nv.
    rotation
        R_i, joint axes to world axes, 3x3.
    origin
        Joint origin, m, 3x1.
    offset
        Joint origin relative to the parent's joint origin, m, 3x1.
    linear, angular
        Motion subspace, 3xnv_i each: columns of the joint's own velocity, linear at the joint origin.
    linear_velocity, angular_velocity
        Of the joint frame at its origin, m/s and rad/s, 3x1.
    linear_bias, angular_bias
        Classical acceleration of the origin and angular acceleration at zero joint acceleration
        (Pinocchio's v-dot = 0), m/s^2 and rad/s^2, 3x1.
    gradient
        ``skew(angular_bias) + skew(angular_velocity)^2``, 1/s^2, 3x3: a point fixed to the body at ``r``
        from the origin has the bias ``linear_bias + gradient r``.
    """

    joints: tuple[Joint, ...]
    velocity: ca.SX
    rotation: tuple[ca.SX, ...]
    origin: tuple[ca.SX, ...]
    offset: tuple[ca.SX, ...]
    linear: tuple[ca.SX, ...]
    angular: tuple[ca.SX, ...]
    linear_velocity: tuple[ca.SX, ...]
    angular_velocity: tuple[ca.SX, ...]
    linear_bias: tuple[ca.SX, ...]
    angular_bias: tuple[ca.SX, ...]
    gradient: tuple[ca.SX, ...]

    def support(self, index: int) -> tuple[Joint, ...]:
        """Joints between the universe and joint ``index``, both ends included, from the root."""
        chain: list[Joint] = []
        while index:
            chain.append(self.joints[index - 1])
            index = chain[-1].parent
        return tuple(reversed(chain))


def forward_kinematics(model: pinocchio.Model, q: ca.SX, v: ca.SX | None = None) -> Kinematics:
    """Positions, velocities and velocity-product accelerations of all joint frames.

    Parameters
    ----------
    model
        Any model of supported joints.
    q
        Configuration, Pinocchio's coordinates, nq.
    v
        Velocity, Pinocchio's coordinates, nv; ``None`` means at rest (then all velocities are structurally
        zero).

    Raises
    ------
    DescriptionError
        If a joint is of a type the algorithms do not cover.
    """
    joints = read_joints(model)
    velocity = ca.SX(model.nv, 1) if v is None else v
    rotation, origin, offset = [IDENTITY3], [ZERO3], [ZERO3]
    linear, angular = [ca.SX(3, 0)], [ca.SX(3, 0)]
    speed, spin, speed_bias, spin_bias = [ZERO3], [ZERO3], [ZERO3], [ZERO3]
    gradient = [ZERO33]
    for joint in joints:
        parent = joint.parent
        coordinates, rates = joint.coordinates(q), joint.rates(velocity)
        resting = ca.mtimes(rotation[parent], joint.rotation)
        turned = ca.mtimes(resting, joint_rotation(joint, coordinates))
        arm = ca.mtimes(rotation[parent], joint.offset) + ca.mtimes(
            resting, joint_translation(joint, coordinates)
        )
        # A revolute or prismatic axis is the same before and after the joint moves; before is cheaper.
        fixed = joint.kind not in (JointKind.PLANAR, JointKind.FREE_FLYER)
        axes = resting if fixed else turned
        along, about = ca.mtimes(axes, joint.linear), ca.mtimes(axes, joint.angular)
        sliding, turning = ca.mtimes(along, rates), ca.mtimes(about, rates)

        rotation.append(turned)
        offset.append(arm)
        origin.append(origin[parent] + arm)
        linear.append(along)
        angular.append(about)
        spin.append(spin[parent] + turning)
        speed.append(speed[parent] + cross(spin[parent], arm) + sliding)
        spin_bias.append(spin_bias[parent] + cross(spin[parent], turning))
        # Coriolis: the columns of `along` turn with the parent (prismatic) or with the joint itself.
        carrier = spin[parent] if fixed else spin[-1]
        speed_bias.append(
            speed_bias[parent] + ca.mtimes(gradient[parent], arm) + cross(spin[parent] + carrier, sliding)
        )
        gradient.append(velocity_gradient(spin[-1], spin_bias[-1]))
    return Kinematics(
        joints=joints,
        velocity=velocity,
        rotation=tuple(rotation),
        origin=tuple(origin),
        offset=tuple(offset),
        linear=tuple(linear),
        angular=tuple(angular),
        linear_velocity=tuple(speed),
        angular_velocity=tuple(spin),
        linear_bias=tuple(speed_bias),
        angular_bias=tuple(spin_bias),
        gradient=tuple(gradient),
    )


def frame_placement(model: pinocchio.Model, kinematics: Kinematics, frame_id: int) -> tuple[ca.SX, ca.SX]:
    """Rotation (3x3, frame to world) and origin (m, 3x1) of a frame."""
    joint, arm = _lever(model, kinematics, frame_id)
    local = exact_directions(model.frames[frame_id].placement.rotation)
    return ca.mtimes(kinematics.rotation[joint], local), kinematics.origin[joint] + arm


def frame_velocity(model: pinocchio.Model, kinematics: Kinematics, frame_id: int) -> tuple[ca.SX, ca.SX]:
    """Linear (m/s) and angular (rad/s) velocity of a frame's origin, world axes, 3x1 each."""
    joint, arm = _lever(model, kinematics, frame_id)
    spin = kinematics.angular_velocity[joint]
    return kinematics.linear_velocity[joint] + cross(spin, arm), spin


def frame_drift(model: pinocchio.Model, kinematics: Kinematics, frame_id: int) -> tuple[ca.SX, ca.SX]:
    """Classical acceleration of a frame's origin at zero joint acceleration, world axes.

    Returns
    -------
    tuple
        Linear (m/s^2) and angular (rad/s^2), 3x1 each: ``Jdot v`` for the Jacobian of
        :func:`frame_jacobian`.
    """
    joint, arm = _lever(model, kinematics, frame_id)
    linear = kinematics.linear_bias[joint] + ca.mtimes(kinematics.gradient[joint], arm)
    return linear, kinematics.angular_bias[joint]


def frame_jacobian(model: pinocchio.Model, kinematics: Kinematics, frame_id: int) -> ca.SX:
    """Jacobian of a frame, linear rows first, Pinocchio's ``LOCAL_WORLD_ALIGNED``, 6xnv, sparse."""
    joint, arm = _lever(model, kinematics, frame_id)
    return point_jacobian(kinematics, joint, kinematics.origin[joint] + arm)


def point_jacobian(kinematics: Kinematics, joint_id: int, point: ca.SX) -> ca.SX:
    """Jacobian of the material point of a joint's body that is at ``point`` (m, world, 3x1).

    Returns
    -------
    casadi.SX
        6xnv, sparse: linear rows (m/s), then angular (rad/s), world axes.
    """
    blocks = {joint.index: ca.SX(6, joint.nv) for joint in kinematics.joints}
    for joint in kinematics.support(joint_id):
        about = kinematics.angular[joint.index]
        lever = point - kinematics.origin[joint.index]
        turning = ca.horzcat(*(cross(about[:, k], lever) for k in range(joint.nv)))
        blocks[joint.index] = ca.vertcat(kinematics.linear[joint.index] + turning, about)
    return ca.horzcat(*blocks.values())


def _lever(model: pinocchio.Model, kinematics: Kinematics, frame_id: int) -> tuple[int, ca.SX]:
    """Joint that carries a frame, and the frame's origin relative to the joint's, world axes."""
    frame = model.frames[frame_id]
    joint = int(frame.parentJoint)
    return joint, ca.mtimes(kinematics.rotation[joint], sparse(frame.placement.translation))
