"""Plant and contacts as elements see them, with every mechanical quantity an input from Pinocchio.

Elements request placements, velocities, Jacobians and drifts of a plant. In this engine each of them is a
matrix of symbols. Entries that are constant in every state (zeros of a planar scene) stay constant, as in the
closed loop, since the number of states in memories depends on them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from spacerobot.closedloop.loop_builder import LoopBuilder
from spacerobot.closedloop.plant import joint_resistance
from spacerobot.common.arrays import Array
from spacerobot.dynamics import Inertias, Kinematics, Wrench, configuration_derivative, forward_kinematics
from spacerobot.dynamics.algebra import IDENTITY3, cross_columns
from spacerobot.dynamics.articulated import load_cases
from spacerobot.dynamics.joints import sparse
from spacerobot.dynamics.kinematics import (
    frame_drift,
    frame_jacobian,
    frame_placement,
    frame_velocity,
    point_jacobian,
)
from spacerobot.dynamics.local_motion import UNIVERSE, LocalMotion
from spacerobot.elements.core.context import ContactContext, ContactSurface
from spacerobot.pinocchio_engine.mechanical_state import MechanicalState
from spacerobot.scene import Scene
from spacerobot.scene.scene import SceneContact
from spacerobot.shapes import Proximity
from spacerobot.symbolic import Constants, InitialState, Parameters, Plant

Reader = Callable[[MechanicalState], Array]
"""Function from a mechanical state to the values of a matrix."""


@dataclass
class MechanicalInputs:
    """Symbols of mechanical quantities in the order of their requests, and a reader of each."""

    matrices: dict[tuple[Any, ...], ca.SX] = field(default_factory=dict)
    _symbols: list[ca.SX] = field(default_factory=list)
    _readers: list[Reader] = field(default_factory=list)
    _read: int = 0  # entries of what is read
    _used: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))

    def matrix(self, key: tuple[Any, ...], pattern: ca.SX, read: Reader) -> ca.SX:
        """Matrix of inputs where ``pattern`` is not constant; the same key gives the same symbols."""
        if key not in self.matrices:
            entries = zip(pattern.sparsity().row(), pattern.sparsity().get_col(), strict=True)
            places = [place for place in entries if not pattern[place].is_constant()]
            symbol, matrix = ca.SX.sym("_".join(map(str, key)), len(places)), ca.SX(pattern)
            for number, place in enumerate(places):
                matrix[place] = symbol[number]
            self._symbols.append(symbol)
            used = [self._read + i * pattern.size2() + j for i, j in places]
            self._used = np.concatenate([self._used, np.array(used, dtype=np.int64)])
            self._readers.append(read)
            self._read += pattern.numel()
            self.matrices[key] = matrix
        return self.matrices[key]

    @property
    def symbols(self) -> ca.SX:
        """All inputs requested so far (n x 1)."""
        return ca.vertcat(ca.SX(0, 1), *self._symbols)

    def values(self, state: MechanicalState) -> Array:
        """Values of the inputs at a state (n,)."""
        parts = [read(state).ravel() for read in self._readers]
        return np.concatenate([np.empty(0), *parts])[self._used]


@dataclass(frozen=True)
class InputPlant(Plant):
    """Plant whose mechanics are inputs; loads are generalized forces, not reduced.

    Attributes:
        inputs: Inputs requested so far.
        pattern: Kinematics as expressions; only their constant entries are used.
    """

    inputs: MechanicalInputs
    pattern: Kinematics

    @classmethod
    def of(cls, scene: Scene, parameters: Parameters, constants: Constants) -> InputPlant:
        """Plant of a scene."""
        model, inputs = scene.model, MechanicalInputs()
        q, v = ca.SX.sym("q", model.nq), ca.SX.sym("v", model.nv)
        pattern = forward_kinematics(model, q, v)
        relative = sparse(np.eye(model.nv) - scene.spread)
        ties = [relative[model.idx_vs[tie.joint], :].T for tie in scene.ties]
        none: Any = None  # nothing here goes by articulated bodies
        # motion of the joint frames as inputs, in world axes throughout
        local = [UNIVERSE, *(_joint_motion(pattern, inputs, joint) for joint in range(1, model.njoints))]
        kinematics = Kinematics(
            pattern.joints,
            v,
            tuple(local),
            tuple(motion.body for motion in local),
            tuple(_joint_origin(pattern, inputs, joint) for joint in range(model.njoints)),
            tuple(motion.linear for motion in local),
            tuple(motion.angular for motion in local),
            tuple(motion.velocity for motion in local),
            tuple(motion.spin for motion in local),
        )
        return cls(
            model,
            scene.planar,
            q,
            v,
            kinematics,
            Inertias.from_model(model),
            none,
            *joint_resistance(scene, parameters, constants),
            ca.horzcat(ca.SX(model.nv, 0), *ties),
            sparse(scene.spread),
            inputs,
            pattern,
        )

    def placement(self, frame: int) -> tuple[ca.SX, ca.SX]:
        """Rotation (3x3) and origin (3x1) [m] of a frame."""
        rotation, origin = frame_placement(self.model, self.pattern, frame)
        return (
            self.inputs.matrix(("rotation", frame), rotation, lambda s: s.frame(frame).rotation),
            self.inputs.matrix(("origin", frame), origin, lambda s: s.frame(frame).position),
        )

    def velocity(self, frame: int) -> tuple[ca.SX, ca.SX]:
        """Linear and angular velocity of a frame's origin (3x1 each) [m/s, rad/s]."""
        pattern = ca.vertcat(*frame_velocity(self.model, self.pattern, frame))
        twist = self.inputs.matrix(("velocity", frame), pattern, lambda s: s.frame(frame).velocity)
        return twist[:3], twist[3:]

    def jacobian(self, frame: int) -> ca.SX:
        """Jacobian of a frame (6 x nv), linear rows first."""
        pattern = frame_jacobian(self.model, self.pattern, frame)
        return self.inputs.matrix(("jacobian", frame), pattern, lambda s: s.frame(frame).jacobian)

    def drift(self, frame: int) -> tuple[ca.SX, ca.SX]:
        """Linear and angular acceleration of a frame at zero joint acceleration (3x1 each)."""
        pattern = ca.vertcat(*frame_drift(self.model, self.pattern, frame))
        acceleration = self.inputs.matrix(("drift", frame), pattern, lambda s: s.frame(frame).drift)
        return acceleration[:3], acceleration[3:]

    def reduced(self, torque: ca.SX | None = None, wrenches: Sequence[Wrench] = ()) -> ca.SX:
        """Generalized forces of torques and wrenches (nv x n): ``torque + sum J^T f``."""
        total = ca.SX(self.v.size1(), load_cases(torque, wrenches)) if torque is None else torque
        for wrench in wrenches:
            if wrench.joint_id:
                jacobian = _joint_jacobian(self.pattern, self.inputs, wrench.joint_id)
                lever = wrench.point - self.kinematics.origin[wrench.joint_id]
                load = ca.vertcat(wrench.force, wrench.torque + cross_columns(lever, wrench.force))
                total = total + ca.mtimes(jacobian.T, load)
        return total

    def resistance(self, acceleration: ca.SX) -> ca.SX:
        """Generalized forces (nv x 1) that cause an acceleration from rest (nv x 1)."""
        return ca.mtimes(self.mass_matrix, acceleration)

    def inertia_force(self, joints: Iterable[int]) -> tuple[ca.SX, ca.SX]:
        """Force and torque (3x1 each) that move a subtree as at zero joint acceleration, gravity removed."""
        root = next(iter(joints))
        force = self.inputs.matrix(
            ("inertia_force", root), ca.SX.sym("pattern", 6), lambda s: s.inertia_force(root)
        )
        return force[:3], force[3:]

    @property
    def mass_matrix(self) -> ca.SX:
        """Joint-space inertia (nv x nv)."""
        size = self.v.size1()
        return self.inputs.matrix(("inertia",), ca.SX.sym("pattern", size, size), lambda s: s.inertia)

    @property
    def bias(self) -> ca.SX:
        """Generalized forces of gravity, centrifugal and Coriolis accelerations (nv x 1)."""
        return self.inputs.matrix(("bias",), ca.SX.sym("pattern", self.v.size1()), lambda s: s.bias)

    def rate(self, expression: ca.SX) -> ca.SX:
        """Rate of an expression of the configuration and of frames' Jacobians."""
        rates = [(self.q, configuration_derivative(self.model, self.q, self.v))]
        for kind, frame in [key for key in self.inputs.matrices if key[0] == "jacobian"]:
            jacobian, rate = self.inputs.matrices[kind, frame], self._jacobian_rate(frame)
            entries = zip(jacobian.sparsity().row(), jacobian.sparsity().get_col(), strict=True)
            rates += [(jacobian[p], rate[p]) for p in entries if not jacobian[p].is_constant()]
        return ca.jtimes(
            expression, ca.vertcat(*(symbol for symbol, _ in rates)), ca.vertcat(*(rate for _, rate in rates))
        )

    def _jacobian_rate(self, frame: int) -> ca.SX:
        pattern = frame_jacobian(self.model, self.pattern, frame)
        return self.inputs.matrix(("jacobian_rate", frame), pattern, lambda s: s.frame(frame).jacobian_rate)

    def at_start(self, expression: ca.SX, start: InitialState, constants: Constants) -> ca.SX:
        """Value of an expression of (q, v, c) and inputs at the initial state, from the parameters."""
        q, v = (ca.DM(part).full().ravel() for part in (start.q, start.v))
        arguments = [self.q, self.v, self.inputs.symbols, constants.symbols]
        value = ca.Function("first", arguments, [expression])
        return value(q, v, self.inputs.values(MechanicalState(self.model, q, v)), constants.expressions)


def _joint_jacobian(pattern: Kinematics, inputs: MechanicalInputs, joint: int) -> ca.SX:
    structure = point_jacobian(pattern, joint, pattern.origin[joint])
    return inputs.matrix(("joint_jacobian", joint), structure, lambda s: s.joint_jacobian(joint))


def _joint_origin(pattern: Kinematics, inputs: MechanicalInputs, joint: int) -> ca.SX:
    key = ("joint_origin", joint)
    return inputs.matrix(key, pattern.origin[joint], lambda s: s.data.oMi[joint].translation)


def _joint_motion(pattern: Kinematics, inputs: MechanicalInputs, joint: int) -> LocalMotion:
    """Motion of a joint frame; quantities that this engine does not use are NaN."""
    joint_model, unused = pattern.joints[joint - 1], ca.SX.nan(3, 3)
    columns = list(range(joint_model.idx_v, joint_model.idx_v + joint_model.nv))
    jacobian = _joint_jacobian(pattern, inputs, joint)
    velocities = ca.vertcat(pattern.linear_velocity[joint], pattern.angular_velocity[joint])
    moving = inputs.matrix(("joint_velocity", joint), velocities, lambda s: s.joint_velocity(joint))
    return LocalMotion(
        axes=IDENTITY3,
        to_parent=None,
        body=inputs.matrix(
            ("joint_rotation", joint), pattern.rotation[joint], lambda s: s.data.oMi[joint].rotation
        ),
        arm=_joint_origin(pattern, inputs, joint) - _joint_origin(pattern, inputs, joint_model.parent),
        linear=jacobian[:3, columns],
        angular=jacobian[3:, columns],
        velocity=moving[:3],
        spin=moving[3:],
        velocity_bias=unused[:, 0],
        spin_bias=unused[:, 0],
        products=unused,
        gradient=unused,
    )


@dataclass(frozen=True)
class InputContact(ContactContext):
    """Shapes of two bodies that may touch, with their distance as an input."""

    scene_contact: SceneContact

    def proximity(self, first: ContactSurface, second: ContactSurface) -> Proximity:
        """Distance and witness points of two shapes."""
        assert isinstance(self.plant, InputPlant)
        number = next(k for k, pair in enumerate(self.pairs) if pair[0] is first and pair[1] is second)
        pair, crown = self.scene_contact.pairs[number], self.scene_contact.config.crown
        closest = self.plant.inputs.matrix(
            ("near", self.name, number), ca.SX.sym("pattern", 7), lambda s: s.proximity(pair, crown)
        )
        return Proximity(closest[0], closest[1:4], closest[4:])


@dataclass(frozen=True)
class InputBuilder(LoopBuilder):
    """Builder of a scene's elements, with mechanics and contacts as inputs."""

    def contact(self, contact: SceneContact) -> ContactContext:
        """Context of a contact, whose distances are inputs."""
        contact_input = super().contact(contact)
        return InputContact(
            contact_input.context, contact_input.plant, contact_input.name, contact_input.pairs, contact
        )


def numeric_start(scene: Scene) -> InitialState:
    """Initial state as constant expressions."""
    q, v = ca.SX(ca.DM(scene.q)), ca.SX(ca.DM(scene.v))
    return InitialState(scene.model, q, v, forward_kinematics(scene.model, q))
