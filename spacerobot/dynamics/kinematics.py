"""Forward kinematics of any supported model, in world axes.

The recursion runs in each joint's calculation axes (:mod:`~spacerobot.dynamics.local_motion`). A quantity
that is not used in world axes is never rotated there, because a CasADi function holds only what its outputs
depend on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi as ca

from spacerobot.dynamics.algebra import ZERO3, cross
from spacerobot.dynamics.joints import JointModel, exact_directions, read_joints, sparse
from spacerobot.dynamics.local_motion import LocalMotion, local_motions

if TYPE_CHECKING:
    import pinocchio


@dataclass(frozen=True)
class Kinematics:
    """Motion of every joint frame at one (q, v), world axes.

    All tuples are indexed by joint, 0 being the universe.

    Attributes:
        joints: Joints in order, without the universe.
        velocity: v, Pinocchio's coordinates, nv.
        local: Motion of each joint in its calculation axes, which the algorithms use.
        rotation: R_i, joint axes to world axes, 3x3.
        origin: Joint origin, m, 3x1.
        linear, angular: Motion subspace, 3xnv_i each: columns of the joint's own velocity, linear at the
            joint origin.
        linear_velocity, angular_velocity: Velocities of the joint frame at its origin, m/s and rad/s, 3x1.
    """

    joints: tuple[JointModel, ...]
    velocity: ca.SX
    local: tuple[LocalMotion, ...]
    rotation: tuple[ca.SX, ...]
    origin: tuple[ca.SX, ...]
    linear: tuple[ca.SX, ...]
    angular: tuple[ca.SX, ...]
    linear_velocity: tuple[ca.SX, ...]
    angular_velocity: tuple[ca.SX, ...]

    def support(self, index: int) -> tuple[JointModel, ...]:
        """Joints from the root to joint ``index``, joint ``index`` included, the universe not."""
        chain: list[JointModel] = []
        while index:
            chain.append(self.joints[index - 1])
            index = chain[-1].parent
        return tuple(reversed(chain))


def forward_kinematics(model: pinocchio.Model, q: ca.SX, v: ca.SX | None = None) -> Kinematics:
    """Positions, velocities and velocity-product accelerations of all joint frames.

    Args:
        model: Any model of supported joints.
        q: Configuration, Pinocchio's coordinates, nq.
        v: Velocity, Pinocchio's coordinates, nv; ``None`` means at rest, so that all velocities are
            structurally zero.

    Raises:
        DescriptionError: If a joint is of a type the algorithms do not cover.
    """
    joints = read_joints(model)
    velocity = ca.SX(model.nv, 1) if v is None else v
    local = local_motions(joints, q, velocity)
    origin = [ZERO3]
    for joint in joints:
        arm = local[joint.parent].in_world(local[joint.index].arm)
        origin.append(origin[joint.parent] + arm)
    return Kinematics(
        joints=joints,
        velocity=velocity,
        local=local,
        rotation=tuple(motion.in_world(motion.body) for motion in local),
        origin=tuple(origin),
        linear=tuple(motion.in_world(motion.linear) for motion in local),
        angular=tuple(motion.in_world(motion.angular) for motion in local),
        linear_velocity=tuple(motion.in_world(motion.velocity) for motion in local),
        angular_velocity=tuple(motion.in_world(motion.spin) for motion in local),
    )


def frame_placement(model: pinocchio.Model, kinematics: Kinematics, frame_id: int) -> tuple[ca.SX, ca.SX]:
    """Pose of a frame in the world.

    Args:
        model: Model that holds the frame.
        kinematics: Its posture.
        frame_id: Pinocchio's id of the frame.

    Returns:
        tuple: Rotation from frame to world axes (3x3), and origin (m, 3x1).
    """
    joint, arm = _lever(model, kinematics, frame_id)
    local = exact_directions(model.frames[frame_id].placement.rotation)
    return ca.mtimes(kinematics.rotation[joint], local), kinematics.origin[joint] + arm


def frame_velocity(model: pinocchio.Model, kinematics: Kinematics, frame_id: int) -> tuple[ca.SX, ca.SX]:
    """Velocity of a frame's origin and angular velocity of the frame.

    Args:
        model: Model that holds the frame.
        kinematics: Its posture and velocities.
        frame_id: Pinocchio's id of the frame.

    Returns:
        tuple: Linear (m/s) and angular (rad/s) velocity, world axes, 3x1 each.
    """
    joint, arm = _lever(model, kinematics, frame_id)
    spin = kinematics.angular_velocity[joint]
    return kinematics.linear_velocity[joint] + cross(spin, arm), spin


def frame_drift(model: pinocchio.Model, kinematics: Kinematics, frame_id: int) -> tuple[ca.SX, ca.SX]:
    """Classical acceleration of a frame's origin at zero joint acceleration.

    Args:
        model: Model that holds the frame.
        kinematics: Its posture and velocities.
        frame_id: Pinocchio's id of the frame.

    Returns:
        tuple: Linear (m/s^2) and angular (rad/s^2), world axes, 3x1 each: ``Jdot v`` for the Jacobian of
            :func:`frame_jacobian`.
    """
    frame = model.frames[frame_id]
    motion = kinematics.local[int(frame.parentJoint)]
    arm = ca.mtimes(motion.body, sparse(frame.placement.translation))
    linear = motion.velocity_bias + ca.mtimes(motion.gradient, arm)
    return motion.in_world(linear), motion.in_world(motion.spin_bias)


def frame_jacobian(model: pinocchio.Model, kinematics: Kinematics, frame_id: int) -> ca.SX:
    """Jacobian of a frame in Pinocchio's ``LOCAL_WORLD_ALIGNED`` convention.

    Args:
        model: Model that holds the frame.
        kinematics: Its posture.
        frame_id: Pinocchio's id of the frame.

    Returns:
        casadi.SX: 6xnv, sparse: linear rows (m/s), then angular rows (rad/s) per velocity coordinate, world
            axes.
    """
    joint, arm = _lever(model, kinematics, frame_id)
    return point_jacobian(kinematics, joint, kinematics.origin[joint] + arm)


def point_jacobian(kinematics: Kinematics, joint_id: int, point: ca.SX) -> ca.SX:
    """Jacobian of a material point of a joint's body.

    Args:
        kinematics: Posture of the model.
        joint_id: Joint that carries the body.
        point: Current position of the point in the world, m, 3x1.

    Returns:
        casadi.SX: 6xnv, sparse: linear rows (m/s), then angular rows (rad/s) per velocity coordinate, world
            axes.
    """
    blocks = {joint.index: ca.SX(6, joint.nv) for joint in kinematics.joints}
    for joint in kinematics.support(joint_id):
        about = kinematics.angular[joint.index]
        lever = point - kinematics.origin[joint.index]
        turning = ca.horzcat(*(cross(about[:, k], lever) for k in range(joint.nv)))
        blocks[joint.index] = ca.vertcat(kinematics.linear[joint.index] + turning, about)
    return ca.horzcat(*blocks.values())


def _lever(model: pinocchio.Model, kinematics: Kinematics, frame_id: int) -> tuple[int, ca.SX]:
    """Joint that carries a frame, and vector from the joint's origin to the frame's, world axes."""
    frame = model.frames[frame_id]
    joint = int(frame.parentJoint)
    return joint, ca.mtimes(kinematics.rotation[joint], sparse(frame.placement.translation))
