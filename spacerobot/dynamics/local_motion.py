"""Motion of every joint in the axes in which it costs the fewest operations.

Each joint has *calculation axes*: its own body axes, or the calculation axes of its parent. Own axes make the
joint's motion subspace, the body's inertia and the children's offsets constant, but cost a rotation of
articulated inertia, load and acceleration at the joint. The parent's axes cost only a rotation of the body's
inertia. So joints use the parent's axes if axes are parallel or the joint is a leaf, and own axes if the axis
of a child has another direction. A planar arm is calculated in world axes altogether. Body axes would make
its forward dynamics alone a tenth cheaper, but tip motion, load and Jacobian are also needed in world axes.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from spacerobot.dynamics.algebra import IDENTITY3, ZERO3, ZERO33, cross, mirror, velocity_gradient
from spacerobot.dynamics.joints import JointKind, JointModel, joint_rotation, joint_translation
from spacerobot.dynamics.recorded import recorded

_TURNING = (JointKind.REVOLUTE, JointKind.UNBOUNDED, JointKind.PLANAR)
_CARRIED = (JointKind.PLANAR, JointKind.FREE_FLYER)


@dataclass(frozen=True)
class LocalMotion:
    """Motion of one joint frame, in its calculation axes unless stated otherwise.

    Attributes:
        axes: C, calculation axes to world axes, 3x3.
        to_parent: E, calculation axes to those of the parent, 3x3; ``None`` if they are the same.
        body: B, body axes to calculation axes, 3x3; ``C B`` is the joint frame's rotation.
        arm: Joint origin relative to the parent's, in the *parent's* calculation axes, m, 3x1.
        linear, angular: Motion subspace, 3xnv_i each.
        velocity, spin: Linear velocity of the frame's origin and angular velocity, m/s and rad/s, 3x1.
        velocity_bias, spin_bias: Classical acceleration of the origin (m/s^2) and angular acceleration
            (rad/s^2) at zero joint acceleration, 3x1.
        products: ``spin spin^T``, rad^2/s^2, 3x3.
        gradient: Velocity gradient ``G``: a point at r from the origin has the additional bias ``G r``,
            1/s^2, 3x3.
    """

    axes: ca.SX
    to_parent: ca.SX | None
    body: ca.SX
    arm: ca.SX
    linear: ca.SX
    angular: ca.SX
    velocity: ca.SX
    spin: ca.SX
    velocity_bias: ca.SX
    spin_bias: ca.SX
    products: ca.SX
    gradient: ca.SX

    def in_world(self, vector: ca.SX) -> ca.SX:
        """Vectors (3xn) in world axes."""
        return vector if self.axes is IDENTITY3 else ca.mtimes(self.axes, vector)

    def inward(self, vector: ca.SX) -> ca.SX:
        """Vectors (3xn) from the parent's calculation axes to these axes."""
        return vector if self.to_parent is None else ca.mtimes(self.to_parent.T, vector)

    def outward(self, vector: ca.SX) -> ca.SX:
        """Vectors (3xn) from these calculation axes to the parent's."""
        return vector if self.to_parent is None else ca.mtimes(self.to_parent, vector)

    def carried(self, acceleration: ca.SX) -> ca.SX:
        """Acceleration (6x1, linear rows first) of a point fixed to the parent, where the joint's frame is.

        Terms of the velocities are left out.

        Args:
            acceleration: Acceleration of the parent's frame (6x1), in its calculation axes, as the result.
        """
        linear, angular = acceleration[:3], acceleration[3:]
        return ca.vertcat(self.inward(linear + cross(angular, self.arm)), self.inward(angular))


UNIVERSE = LocalMotion(
    axes=IDENTITY3,
    to_parent=None,
    body=IDENTITY3,
    arm=ZERO3,
    linear=ca.SX(3, 0),
    angular=ca.SX(3, 0),
    velocity=ZERO3,
    spin=ZERO3,
    velocity_bias=ZERO3,
    spin_bias=ZERO3,
    products=ZERO33,
    gradient=ZERO33,
)
"""Motion of the universe: at rest, in world axes."""


def local_motions(joints: tuple[JointModel, ...], q: ca.SX, v: ca.SX) -> tuple[LocalMotion, ...]:
    """Motion of the universe (index 0) and of every joint at (q, v)."""
    # joints with own axes: those with a child about another coordinate axis, and free bodies
    children: dict[int, list[JointModel]] = {}
    for joint in joints:
        children.setdefault(joint.parent, []).append(joint)
    chosen = set()
    for joint in joints:
        if joint.kind is JointKind.FREE_FLYER or (
            joint.kind is JointKind.PLANAR and joint.index not in children
        ):
            chosen.add(joint.index)
        elif joint.kind in _TURNING:
            direction = joint.angular[:, -1].sparsity()
            axes = _axes_beyond(joint.index, IDENTITY3, children)
            if any(axis.nnz() == 1 and axis.sparsity() != direction for axis in axes):
                chosen.add(joint.index)
    bends = frozenset(chosen)
    motions = [UNIVERSE]
    for joint in joints:
        motions.append(_step(joint, motions[joint.parent], q, v, joint.index in bends))
    return tuple(motions)


def _step(joint: JointModel, parent: LocalMotion, q: ca.SX, v: ca.SX, bends: bool) -> LocalMotion:
    """Motion of a joint from its parent's."""
    coordinates, rates = joint.coordinates(q), joint.rates(v)
    resting = ca.mtimes(parent.body, joint.rotation)
    turned = ca.mtimes(resting, joint_rotation(joint, coordinates))
    arm = ca.mtimes(parent.body, joint.offset) + ca.mtimes(resting, joint_translation(joint, coordinates))
    adopt = bends and (joint.kind is JointKind.FREE_FLYER or ca.mtimes(resting, joint.angular).nnz() == 1)
    to_parent = turned if adopt else None
    body = IDENTITY3 if adopt else turned
    # The joint's motion does not change its revolute or prismatic axis; axes before the motion cost less.
    basis = IDENTITY3 if adopt else (turned if joint.kind in _CARRIED else resting)
    linear, angular = ca.mtimes(basis, joint.linear), ca.mtimes(basis, joint.angular)
    velocity, spin, velocity_bias, spin_bias, products, gradient = _motion(
        IDENTITY3 if to_parent is None else to_parent,
        parent.velocity,
        parent.spin,
        parent.velocity_bias,
        parent.spin_bias,
        parent.gradient,
        arm,
        ca.mtimes(linear, rates),
        ca.mtimes(angular, rates),
        carried=joint.kind in _CARRIED,
    )
    return LocalMotion(
        axes=parent.axes if to_parent is None else ca.mtimes(parent.axes, to_parent),
        to_parent=to_parent,
        body=body,
        arm=arm,
        linear=linear,
        angular=angular,
        velocity=velocity,
        spin=spin,
        velocity_bias=velocity_bias,
        spin_bias=spin_bias,
        products=products,
        gradient=gradient,
    )


@recorded((3, 3), (3, 1), (3, 1), (3, 1), (3, 1), (3, 3), (3, 1), (3, 1), (3, 1))
def _motion(to_parent: ca.SX, *joint_motion: ca.SX, carried: bool) -> tuple[ca.SX, ...]:
    """Velocity, spin, both biases, products and gradient of a joint frame, from its parent's motion.

    With the parent's spin w, gradient G and bias a, b, and the joint's own velocity s and spin t, the biases
    are ``a + G arm + (w + w') x s`` (linear) and ``b + w x t`` (angular). The columns of ``linear`` rotate
    with w' = w + t if ``carried`` (planar and free-flyer joints), else with w' = w.
    """
    velocity, spin, velocity_bias, spin_bias, gradient, arm, sliding, turning = joint_motion
    inward = to_parent.T
    carrier = ca.mtimes(inward, spin)
    total_spin = carrier + turning
    bias = ca.mtimes(inward, spin_bias) + cross(carrier, turning)
    products = mirror(ca.mtimes(total_spin, total_spin.T))
    swing = carrier + (total_spin if carried else carrier)  # Coriolis
    return (
        ca.mtimes(inward, velocity + cross(spin, arm)) + sliding,
        total_spin,
        ca.mtimes(inward, velocity_bias + ca.mtimes(gradient, arm)) + cross(swing, sliding),
        bias,
        products,
        velocity_gradient(products, bias),
    )


def _axes_beyond(index: int, rotation: ca.SX, children: dict[int, list[JointModel]]) -> list[ca.SX]:
    """Axes of the next rotating joints, across prismatic ones, in the axes of joint ``index``."""
    axes: list[ca.SX] = []
    for child in children.get(index, ()):
        placed = ca.mtimes(rotation, child.rotation)
        if child.kind is JointKind.PRISMATIC:
            axes += _axes_beyond(child.index, placed, children)
        elif child.kind in _TURNING:
            axes.append(ca.mtimes(placed, child.angular[:, -1]))
    return axes
