"""Plant: symbolic kinematics, inertias, joint damping and stiffness of the scene."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from spacerobot.dynamics import (
    ArticulatedBody,
    Inertias,
    Kinematics,
    Wrench,
    configuration_derivative,
    frame_drift,
    frame_jacobian,
    frame_placement,
    frame_velocity,
    inverse_dynamics,
    mass_matrix,
)
from spacerobot.dynamics.rotations import rotation_log
from spacerobot.symbolic.parameters import Constants


@dataclass(frozen=True)
class InitialState:
    """Initial state as expressions of the parameters.

    Attributes:
        model: The scene's ``pinocchio.Model``.
        q, v: Configuration (nq x 1) and velocity (nv x 1), Pinocchio's coordinates.
        kinematics: Kinematics of the initial configuration at rest.
    """

    model: Any
    q: ca.SX
    v: ca.SX
    kinematics: Kinematics

    def placement(self, frame: int) -> tuple[ca.SX, ca.SX]:
        """Rotation (3x3) and origin (3x1) [m] of a frame at the start, world axes."""
        return frame_placement(self.model, self.kinematics, frame)


@dataclass(frozen=True)
class Plant:
    """Rigid-body quantities at one configuration and velocity (q, v), world axes.

    *Reduced* loads are those of :mod:`spacerobot.dynamics.articulated`.

    Attributes:
        model: The scene's ``pinocchio.Model``.
        planar: Whether all motion is in the x-y plane.
        q, v: Symbols of configuration (nq x 1) and velocity (nv x 1).
        kinematics: Poses, velocities and accelerations of the joints.
        inertias: Inertias of the bodies.
        articulated: Articulated-body factorisation.
        stiffness: Stiffness of flexible links' springs (nv x 1) [N m/rad]; structural zeros elsewhere.
        damping: Viscous damping of each velocity component (nv x 1) [N m s/rad or N s/m]; structural zeros
            where there is none.
        ties: Reduced constraint loads of the n mimic joints (nv x n). They keep the acceleration of each
            mimic joint, relative to that which follows from the joint that it mimics, at zero.
        spread: Constant matrix (nv x nv) from the velocities of independent joints to those of all joints.
    """

    model: Any
    planar: bool
    q: ca.SX
    v: ca.SX
    kinematics: Kinematics
    inertias: Inertias
    articulated: ArticulatedBody
    stiffness: ca.SX
    damping: ca.SX
    ties: ca.SX
    spread: ca.SX

    @property
    def translation_axes(self) -> tuple[int, ...]:
        """World axes of translation: x and y in a planar scene, else all three."""
        return (0, 1) if self.planar else (0, 1, 2)

    @property
    def rotation_axes(self) -> tuple[int, ...]:
        """World axes of rotation: z in a planar scene, else all three."""
        return (2,) if self.planar else (0, 1, 2)

    def placement(self, frame: int) -> tuple[ca.SX, ca.SX]:
        """Rotation (3x3) and origin (3x1) [m] of a frame, world axes."""
        return frame_placement(self.model, self.kinematics, frame)

    def velocity(self, frame: int) -> tuple[ca.SX, ca.SX]:
        """Linear (origin) and angular velocity of a frame, world axes (3x1 each) [m/s, rad/s]."""
        return frame_velocity(self.model, self.kinematics, frame)

    def jacobian(self, frame: int) -> ca.SX:
        """Jacobian of a frame (6 x nv), world axes, linear rows first."""
        return frame_jacobian(self.model, self.kinematics, frame)

    def drift(self, frame: int) -> tuple[ca.SX, ca.SX]:
        """Linear and angular acceleration of a frame at zero joint acceleration (3x1) [m/s^2, rad/s^2]."""
        return frame_drift(self.model, self.kinematics, frame)

    def reduced(self, torque: ca.SX | None = None, wrenches: Sequence[Wrench] = ()) -> ca.SX:
        """Reduced loads (nv x n) of generalised forces and wrenches."""
        return self.articulated.reduced(torque, wrenches)

    def reduced_moving(self, torque: ca.SX, wrenches: Sequence[Wrench] = ()) -> ca.SX:
        """Reduced loads (nv x 1) including joint damping, springs, gravity and velocity-dependent forces."""
        return self.articulated.reduced(torque - self.passive_forces, wrenches, moving=True)

    @property
    def deflection(self) -> ca.SX:
        """Positions of the joints with springs (nv x 1), at the indices of their velocities."""
        positions = ca.SX(self.v.size1(), 1)
        for joint in self.model.joints[1:] if self.stiffness.nnz() else ():
            if self.stiffness[joint.idx_v].nnz():
                positions[joint.idx_v] = self.q[joint.idx_q]
        return positions

    @property
    def passive_forces(self) -> ca.SX:
        """Generalised forces that the motion needs against joint damping and springs (nv x 1)."""
        resistance = self.damping * self.v
        return resistance + self.stiffness * self.deflection if self.stiffness.nnz() else resistance

    def resistance(self, acceleration: ca.SX) -> ca.SX:
        """Reduced loads (nv x 1) that an acceleration (nv x 1) from rest requires."""
        return self.articulated.resistance(acceleration)

    def inertia_force(self, joints: Iterable[int]) -> tuple[ca.SX, ca.SX]:
        """Force and torque (3x1 each) [N, N m] that a subtree requires at zero joint acceleration.

        Gravity is not included. Axes are the world's, and the torque is about the root joint's origin.

        Args:
            joints: Indices of the subtree's joints, the root first.
        """
        return self.articulated.inertia_force(joints)

    @property
    def mass_matrix(self) -> ca.SX:
        """Joint-space inertia matrix H (nv x nv)."""
        return mass_matrix(self.model, self.kinematics, self.inertias)

    @property
    def bias(self) -> ca.SX:
        """Generalised forces of gravity, centrifugal and Coriolis accelerations (nv x 1)."""
        return inverse_dynamics(self.model, self.kinematics, self.inertias, ca.SX(self.v.size1(), 1))

    def rate(self, expression: ca.SX) -> ca.SX:
        """Time derivative of an expression of the configuration alone."""
        return ca.jtimes(expression, self.q, configuration_derivative(self.model, self.q, self.v))

    def at_start(self, expression: ca.SX, start: InitialState, constants: Constants) -> ca.SX:
        """Value of an expression of (q, v, c) in the initial state, as an expression of the parameters."""
        function = ca.Function("first", [self.q, self.v, constants.symbols], [expression])
        return function(start.q, start.v, constants.expressions)

    def gathered(self, effort: ca.SX) -> ca.SX:
        """Generalised forces (nv x n) with those of mimic joints moved to the joints that they follow."""
        return ca.mtimes(self.spread.T, effort) if self.ties.size2() else effort

    def orientation_error(self, desired: ca.SX, actual: ca.SX) -> ca.SX:
        """Rotation vector (3x1) [rad], world axes, from an actual to a desired orientation (3x3 each)."""
        relative = ca.mtimes(desired, actual.T)
        if self.planar:
            angle = ca.SX(3, 1)
            angle[2] = ca.atan2(relative[1, 0], relative[0, 0])
            return angle
        return rotation_log(relative)
