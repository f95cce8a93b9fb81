"""The plant: symbolic kinematics, inertias and resistance of the whole scene."""

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
from spacerobot.symbolic.initial_state import InitialState
from spacerobot.symbolic.parameters import Constants


@dataclass(frozen=True)
class Plant:
    """Everything mechanical at one (q, v), world axes.

    Attributes:
        model: The scene's ``pinocchio.Model``.
        planar: Whether nothing can leave the x-y plane.
        q, v: Symbols of configuration (nq x 1) and velocity (nv x 1).
        stiffness: Of the springs in flexible links (nv x 1), structurally zero where there is none.
        damping: Viscous resistance R_j of each velocity component (nv x 1), structurally zero where there is
            none.
        ties: Loads, reduced, along which v' is the acceleration of a joint that mimics another one, relative
            to what it mimics (nv x n); they keep it at zero.
        spread: Velocities of all joints from those of the free ones (nv x nv), constant.
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
        """World axes along which things move: x and y in a planar scene."""
        return (0, 1) if self.planar else (0, 1, 2)

    @property
    def rotation_axes(self) -> tuple[int, ...]:
        """World axes about which things turn: z in a planar scene."""
        return (2,) if self.planar else (0, 1, 2)

    def placement(self, frame: int) -> tuple[ca.SX, ca.SX]:
        """Rotation (3x3) and origin (3x1) [m] of a frame."""
        return frame_placement(self.model, self.kinematics, frame)

    def velocity(self, frame: int) -> tuple[ca.SX, ca.SX]:
        """Linear and angular velocity of a frame's origin (3x1 each) [m/s, rad/s]."""
        return frame_velocity(self.model, self.kinematics, frame)

    def jacobian(self, frame: int) -> ca.SX:
        """Jacobian of a frame (6 x nv), linear rows first."""
        return frame_jacobian(self.model, self.kinematics, frame)

    def drift(self, frame: int) -> tuple[ca.SX, ca.SX]:
        """Linear and angular acceleration of a frame at zero joint acceleration (3x1 each)."""
        return frame_drift(self.model, self.kinematics, frame)

    def reduced(self, torque: ca.SX | None = None, wrenches: Sequence[Wrench] = ()) -> ca.SX:
        """Generalized forces and wrenches, reduced (nv x n); see :mod:`spacerobot.dynamics.articulated`."""
        return self.articulated.reduced(torque, wrenches)

    def reduced_moving(self, torque: ca.SX, wrenches: Sequence[Wrench] = ()) -> ca.SX:
        """The same together with joint resistance, gravity and inertia forces (nv x 1)."""
        return self.articulated.reduced(torque - self.passive_forces, wrenches, moving=True)

    @property
    def deflection(self) -> ca.SX:
        """Positions of the joints with springs, at the places of their velocities (nv x 1)."""
        positions = ca.SX(self.v.size1(), 1)
        for joint in self.model.joints[1:] if self.stiffness.nnz() else ():
            if self.stiffness[joint.idx_v].nnz():
                positions[joint.idx_v] = self.q[joint.idx_q]
        return positions

    @property
    def passive_forces(self) -> ca.SX:
        """Generalized forces that joints' resistance and springs take (nv x 1)."""
        resistance = self.damping * self.v
        return resistance + self.stiffness * self.deflection if self.stiffness.nnz() else resistance

    def resistance(self, acceleration: ca.SX) -> ca.SX:
        """Loads that an acceleration from rest (nv x 1) takes, reduced (nv x 1)."""
        return self.articulated.resistance(acceleration)

    def inertia_force(self, joints: Iterable[int]) -> tuple[ca.SX, ca.SX]:
        """Force and torque that bodies take to move as they do at zero joint acceleration, gravity removed.

        Args:
            joints: A subtree of joints, its root first; the torque is about the root's origin.
        """
        return self.articulated.inertia_force(joints)

    @property
    def mass_matrix(self) -> ca.SX:
        """Joint-space inertia (nv x nv)."""
        return mass_matrix(self.model, self.kinematics, self.inertias)

    @property
    def bias(self) -> ca.SX:
        """Generalized forces of gravity, centrifugal and Coriolis accelerations (nv x 1)."""
        return inverse_dynamics(self.model, self.kinematics, self.inertias, ca.SX(self.v.size1(), 1))

    def rate(self, expression: ca.SX) -> ca.SX:
        """Rate of an expression of the posture alone."""
        return ca.jtimes(expression, self.q, configuration_derivative(self.model, self.q, self.v))

    def at_start(self, expression: ca.SX, start: InitialState, constants: Constants) -> ca.SX:
        """An expression of (q, v, c) where everything begins, as one of the parameters."""
        function = ca.Function("first", [self.q, self.v, constants.symbols], [expression])
        return function(start.q, start.v, constants.expressions)

    def gathered(self, effort: ca.SX) -> ca.SX:
        """Generalized forces (nv x n), those on joints that mimic moved to the joints that they follow."""
        return ca.mtimes(self.spread.T, effort) if self.ties.size2() else effort

    def orientation_error(self, wanted: ca.SX, found: ca.SX) -> ca.SX:
        """Rotation vector (3x1), world axes, that turns ``found`` into ``wanted`` [rad]."""
        relative = ca.mtimes(wanted, found.T)
        if self.planar:
            angle = ca.SX(3, 1)
            angle[2] = ca.atan2(relative[1, 0], relative[0, 0])
            return angle
        return rotation_log(relative)
