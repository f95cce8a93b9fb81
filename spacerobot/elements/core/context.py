"""Contexts in which elements build their laws."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol, TypeVar

import casadi as ca

from spacerobot.common.section import Section
from spacerobot.dynamics import Wrench
from spacerobot.dynamics.algebra import SymmetricFactors, cross
from spacerobot.elements.core.contribution import CommandedTorque
from spacerobot.elements.core.desired_motion import DesiredMotion
from spacerobot.elements.core.grasp_state import GraspState
from spacerobot.elements.core.section_context import SectionContext
from spacerobot.shapes import MovingShape, Proximity, Shape, approach_speed, proximity
from spacerobot.symbolic import InitialState, Plant

Result = TypeVar("Result")

Affine = tuple[ca.SX | None, ca.SX]
"""Offset (None if structurally zero) and scale (1x1 each) of a measured signal."""


def unbroken(place: str, names: Sequence[str], signal: ca.SX) -> ca.SX:
    """Signal of a loop that is not broken.

    Args:
        place, names: Place at which the loop may be broken, and names of the components.
        signal: Values of the signal (n x 1).
    """
    del place, names
    return signal


def unported(name: str, unit: str, text: str, command: ca.SX) -> ca.SX:
    """Command of an actuator's parts that is not held.

    Args:
        name, unit, text: Name of the actuator, SI unit and description of the command.
        command: Values of the command (n x 1).
    """
    del name, unit, text
    return command


def once_for_each(law: Callable[[ca.SX], Result]) -> Callable[[ca.SX], Result]:
    """Law that is evaluated once for each request, so that equal requests share their expression nodes.

    Args:
        law: Function of a request (n x 1).
    """
    results: dict[tuple[int, ...], tuple[ca.SX, Result]] = {}

    def evaluated(request: ca.SX) -> Result:
        key = tuple(element.element_hash() for element in ca.vertsplit(ca.densify(request)))
        if key not in results:
            results[key] = request, law(request)  # the request stays, so that its nodes keep their hashes
        return results[key][1]

    return evaluated


class Held(Protocol):
    """Reader of signals that are measured at instants."""

    def __call__(
        self, signal: str, value: ca.SX, world: ca.SX | None = None, point: ca.SX | None = None, /
    ) -> ca.SX | None:
        """Last measurement of a signal, as for :meth:`TipContext.read`; None if it is continuous."""


@dataclass(frozen=True)
class RobotContext:
    """View of a robot for its controllers.

    Attributes:
        context: Time, and the numbers of the element's section.
        plant, start: Mechanics at the present and at the initial state.
        name: Name of the robot.
        joints, columns: Ids of its free joints, and their indices in v; without the floating base and mimic
            joints.
        joint_names: Names of its free joints in the URDF.
        positions: Map from positions of its free joints (n x 1) to those of all its joints, by id.
        phase_time: Function that returns the time (1x1) [s] since the present phase began, or since the start
            if there are no phases.
        sensors: Map from a signal's name to its sensor's offset and scale.
        held: Function from a signal's name and value (n x 1) to its last measurement; None for continuous
            signals.
        base_frame: Frame of its root link in the model.
        arm: Indices in v of all its joints that no actuator owns, including mimic joints.
        tips: Tips of the robot.
        locked: Whether each of its free joints is known to be held (n x 1), structurally zero for joints that
            cannot be.
    """

    context: SectionContext
    plant: Plant
    start: InitialState
    name: str
    joints: tuple[int, ...]
    columns: tuple[int, ...]
    joint_names: tuple[str, ...]
    positions: Callable[[ca.SX], Mapping[int, ca.SX]]
    phase_time: Callable[[], ca.SX]
    sensors: Callable[[str], Affine]
    held: Held
    base_frame: int
    arm: tuple[int, ...]
    tips: tuple[TipContext, ...] = ()
    locked: ca.SX = field(default_factory=lambda: ca.SX(0, 1))

    def read(self, signal: str, value: ca.SX) -> ca.SX:
        """Reading of a signal's sensor.

        Args:
            signal: Name of the signal.
            value: True value (n x 1).

        Returns:
            casadi.SX: Last sample of a sampled sensor, otherwise the value with the sensor's offset and scale
                (n x 1).
        """
        return known(self, signal, value)

    @property
    def key(self) -> str:
        """Last part of the section's path, which identifies the element within its kind."""
        return self.context.path.rpartition(".")[2]

    @property
    def base_joint(self) -> int:
        """Id of the floating base's joint; 0 for a fixed base."""
        return joint_of(self.plant, self.base_frame)

    def torque(self, values: ca.SX, *, null_space: bool = False) -> CommandedTorque:
        """Commanded torques of the robot's free joints.

        Args:
            values: Torque or force of each free joint, in the robot's order (n x 1) [N m or N].
            null_space: Whether only the part that does not accelerate the robot's controlled tips acts.
        """
        torque = ca.SX(self.plant.v.size1(), 1)
        for i, column in enumerate(self.columns):
            torque[column] = values[i]
        return CommandedTorque(self.name, torque, null_space)


@dataclass(frozen=True)
class TipContext:
    """View of a tip for its controllers; everything in world axes.

    Attributes:
        context: Time and the numbers of the element's section.
        plant: Mechanics at the present state.
        label, path, key: Label of the tip (``rpr1/tip``), its dotted path, and the element's key in its
            section (``pid``).
        robot, columns: Name of the robot, and indices of its joints in v.
        frame, base_frame: Frames of the tip and of the robot's root link in the model.
        motion: Desired motion of the tip's reference.
        sensors: Map from a signal's name to its sensor's offset and scale.
        held: See :class:`RobotContext`; joint rates are those of ``columns``.
        siblings: Other sections of the tip, by key.
        held_inertia: Estimated inertial parameters of the held object (10x1), tip axes; zero while it holds
            nothing, None without an estimator.
        wrench: Function that returns the external force (3x1) [N] and couple about the tip's origin (3x1) [N
            m] on the tool side of the robot's force-torque sensors.
        controlled: Motions of the tip, ``translation`` and ``rotation``, that its controllers remove from the
            null space.
        peers: Function that returns the other tips of the robot.
    """

    context: SectionContext
    plant: Plant
    label: str
    path: str
    key: str
    robot: str
    columns: tuple[int, ...]
    frame: int
    base_frame: int
    motion: DesiredMotion
    sensors: Callable[[str], Affine]
    held: Held
    siblings: Mapping[str, Section]
    held_inertia: ca.SX | None = None
    wrench: Callable[[], tuple[ca.SX, ca.SX]] = field(default=lambda: (ca.SX(3, 1), ca.SX(3, 1)))
    controlled: frozenset[str] = frozenset()
    peers: Callable[[], tuple[TipContext, ...]] = tuple

    def measured_wrench(self) -> ca.SX:
        """Wrench (6x1) on the tip, about its origin, as its force-torque sensor gives it [N, N m]."""
        force, torque = self.wrench()
        return ca.vertcat(self.read("tip_force", force), self.read("tip_torque", torque))

    def read(
        self, signal: str, value: ca.SX, world: ca.SX | None = None, point: ca.SX | None = None
    ) -> ca.SX:
        """Reading of a signal's sensor.

        Args:
            signal: Name of the signal.
            value: True value (n x 1).
            world: True value of a signal in world axes (n x 1) that is returned instead, with the same error.
            point: Point on the target for ``target_velocity`` (3x1) [m]; the root link's origin if not given.

        Returns:
            casadi.SX: Last sample of a sampled sensor, otherwise the value with the sensor's offset and scale
                (n x 1).
        """
        return known(self, signal, value, world, point)

    @property
    def controlled_rows(self) -> list[int]:
        """Rows of its Jacobian that its controllers control."""
        rows = list(self.plant.translation_axes) * ("translation" in self.controlled)
        return rows + [axis + 3 for axis in self.plant.rotation_axes] * ("rotation" in self.controlled)

    @property
    def joint(self) -> int:
        """Id of the joint that carries the tip."""
        return joint_of(self.plant, self.frame)

    @property
    def base_joint(self) -> int:
        """Id of the floating base's joint; 0 for a fixed base."""
        return joint_of(self.plant, self.base_frame)

    @property
    def rotation(self) -> ca.SX:
        """Tip axes to world axes (3x3)."""
        return self.plant.placement(self.frame)[0]

    @property
    def position(self) -> ca.SX:
        """Position of the tip (3x1) [m]."""
        return self.plant.placement(self.frame)[1]

    @property
    def velocity(self) -> ca.SX:
        """Velocity of the tip (3x1) [m/s]."""
        return self.plant.velocity(self.frame)[0]

    @property
    def angular_velocity(self) -> ca.SX:
        """Angular velocity of the tip (3x1) [rad/s]."""
        return self.plant.velocity(self.frame)[1]

    @property
    def orientation_error(self) -> ca.SX:
        """Rotation vector (3x1) from the tip's orientation to its reference [rad]."""
        return self.plant.orientation_error(self.motion.rotation, self.rotation)

    @functools.cached_property
    def arm_jacobian(self) -> ca.SX:
        """Manipulator Jacobian (6 x nv), linear rows first: the arm's free joints alone (Eq. 13)."""
        jacobian, columns = self.plant.jacobian(self.frame), list(self.columns)
        part = ca.SX(*jacobian.shape)
        part[:, columns] = jacobian[:, columns]
        return self.plant.gathered(part.T).T

    @functools.cached_property
    def generalized_jacobian(self) -> ca.SX:
        """Generalized Jacobian (6 x nv), linear rows first: the arm's free joints, with the base's reaction.

        ``J_m - J_b H_b^-1 H_bm`` (Umetani and Yoshida 1989); the manipulator Jacobian if the base is fixed.
        """
        joint = self.plant.model.joints[self.base_joint]
        if not self.base_joint:
            return self.arm_jacobian
        base, columns = list(range(joint.idx_v, joint.idx_v + joint.nv)), list(self.columns)
        gathered = self.plant.gathered
        inertia = gathered(gathered(self.plant.mass_matrix).T)
        reaction = SymmetricFactors(inertia[base, base]).solve_negated(inertia[base, columns])
        jacobian = ca.SX(self.arm_jacobian)
        jacobian[:, columns] += ca.mtimes(self.plant.jacobian(self.frame)[:, base], reaction)
        return jacobian

    def torque(self, force: ca.SX | None = None, couple: ca.SX | None = None) -> CommandedTorque:
        """Commanded joint torques ``J^T u`` of a wrench on the tip, with the manipulator Jacobian.

        Args:
            force: Force on the tip at its origin, world axes (3x1) [N]; zero if None.
            couple: Couple on the tip, world axes (3x1) [N m]; zero if None.
        """
        none = ca.SX(3, 1)
        wrench = ca.vertcat(none if force is None else force, none if couple is None else couple)
        axes = [*self.plant.translation_axes, *(axis + 3 for axis in self.plant.rotation_axes)]
        return CommandedTorque(self.robot, ca.mtimes(self.arm_jacobian[axes, :].T, wrench[axes]))

    @property
    def bends(self) -> bool:
        """Whether flexible links, whose joints the arm does not drive, carry the tip."""
        model = self.plant.model
        carrying = set(model.supports[self.joint]) - {0, self.base_joint}
        return any(int(model.idx_vs[joint]) not in self.columns for joint in carrying)

    def reduced_loads(self, axes: list[int], *, rotation: bool) -> tuple[ca.SX, ca.SX]:
        """Reduced unit loads on the tip: exerted by the arm's joints, and as external wrenches.

        An arm that pushes with its tip also pushes on its own base: ``J^T u`` with the manipulator Jacobian
            is the wrench u on the tip and -u, at the same point, on the base, unless flexible links deflect.

        Args:
            axes: World axes of the n loads.
            rotation: Whether the loads are couples rather than forces.

        Returns:
            tuple: Reduced generalized forces of the joints, and those of external wrenches (nv x n each).
        """
        force, torque = unit_loads(axes, rotation=rotation)
        on_tip = Wrench(self.joint, force, torque, self.position)
        by_wrench = self.plant.reduced(wrenches=[on_tip])
        if self.bends:
            rows = [axis + 3 * rotation for axis in axes]
            return self.plant.reduced(self.arm_jacobian[rows, :].T), by_wrench
        back = Wrench(self.base_joint, -force, -torque, self.position)
        return self.plant.reduced(wrenches=[on_tip, back]), by_wrench

    def relative_drift(self, *, rotation: bool) -> ca.SX:
        """Rate (3x1), at zero joint acceleration, of the tip's velocity relative to the base.

        If flexible links carry the tip, only the motion of the arm's joints counts.
        """
        if self.bends:
            rows = [axis + 3 * rotation for axis in range(3)]
            return self.plant.rate(ca.mtimes(self.arm_jacobian[rows, :], self.plant.v))
        tip_drift = self.plant.drift(self.frame)
        if not self.base_joint:
            return tip_drift[rotation]
        base_drift = self.plant.drift(self.base_frame)
        if rotation:
            return tip_drift[1] - base_drift[1]
        lever = self.position - self.plant.placement(self.base_frame)[1]
        base_velocity, base_spin = self.plant.velocity(self.base_frame)
        # d/dt of v_tip - v_base - omega_base x lever
        return (
            tip_drift[0]
            - base_drift[0]
            - cross(base_drift[1], lever)
            - cross(base_spin, self.velocity - base_velocity)
        )


@dataclass(frozen=True)
class ActuatorContext:
    """View of a robot for its actuators; everything in world axes.

    Attributes:
        context: Time and the numbers of the actuator's section.
        plant, start: Mechanics at the present and at the initial state.
        robot, path: Name of the robot and its dotted path.
        columns: Indices in v of its free joints that no other actuator owns, by joint name.
        base_frame: Frame of the robot's root link in the model.
        base_columns: Indices in v of the floating base's linear and then angular velocity, in the root link's
            axes.
        wheels, stored: Angular momentum (3x1) of the robot's wheels about their axes, and stored momentum in
            addition to that of its links, world axes.
        break_point: Function from indices, names and values (n x 1) of signals to the values that act: the
            same, unless the loop is opened there for linearisation.
        command_port: Function from name, unit, description and allocated command of an actuator's parts (n x
            1) to the command that acts: the same, unless onboard software holds it.
    """

    context: SectionContext
    plant: Plant
    start: InitialState
    robot: str
    path: str
    columns: Mapping[str, int]
    base_frame: int
    base_columns: tuple[int, ...]
    wheels: ca.SX = field(default_factory=lambda: ca.SX(3, 1))
    stored: ca.SX = field(default_factory=lambda: ca.SX(3, 1))
    break_point: Callable[[str, Sequence[str], ca.SX], ca.SX] = unbroken
    command_port: Callable[[str, str, str, ca.SX], ca.SX] = unported

    @property
    def base_joint(self) -> int:
        """Id of the floating base's joint; 0 for a fixed base."""
        return joint_of(self.plant, self.base_frame)

    def joint_number(self, joint: str, key: str) -> ca.SX:
        """Number of a joint's own section, such as ``torque_limit`` (1x1), in the section's unit.

        Args:
            joint: Name of the joint in the URDF.
            key: Key of the number.
        """
        return self.context.at(f"{self.path}.joints.{joint}").number(key)

    def on_base(self, force: ca.SX | None = None, torque: ca.SX | None = None) -> Wrench:
        """Wrench on the base at the root link's origin, world axes.

        Args:
            force: Force (3x1) [N]; zero if None.
            torque: Torque (3x1) [N m]; zero if None.
        """
        none = ca.SX(3, 1)
        point = self.plant.placement(self.base_frame)[1]
        return Wrench(
            self.base_joint, none if force is None else force, none if torque is None else torque, point
        )


@dataclass(frozen=True)
class GraspContext:
    """View of a grasp: a tip and the mating frame that it holds; everything in world axes.

    Attributes:
        context: Time and the numbers of the grasp's section.
        plant, start: Mechanics at the present and at the initial state.
        name: Name of the grasp.
        tip_frame, mate_frame: Frames of tip and mating frame in the model.
        may_close, lets_go: Whether the present phase allows the grasp to close, and whether it commands
            release (1x1 each).
        hold: State of a grasp that opens and closes; None for a permanently closed one.
    """

    context: SectionContext
    plant: Plant
    start: InitialState
    name: str
    tip_frame: int
    mate_frame: int
    may_close: ca.SX = field(default_factory=lambda: ca.SX(1))
    lets_go: ca.SX = field(default_factory=lambda: ca.SX(0))
    hold: GraspState | None = None

    @property
    def tip_joint(self) -> int:
        """Id of the joint that carries the tip."""
        return joint_of(self.plant, self.tip_frame)

    @property
    def mate_joint(self) -> int:
        """Id of the joint that carries the mating frame."""
        return joint_of(self.plant, self.mate_frame)

    def opposite(self, force: ca.SX, torque: ca.SX) -> tuple[Wrench, Wrench]:
        """Pair of opposite wrenches at the tip's origin.

        Args:
            force, torque: Force [N] and torque [N m] on the target, world axes (3x1 each).

        Returns:
            tuple: Wrench on the target's joint as given, and the opposite one on the robot's joint.
        """
        point = self.plant.placement(self.tip_frame)[1]
        return (
            Wrench(self.mate_joint, force, torque, point),
            Wrench(self.tip_joint, -force, -torque, point),
        )


@dataclass(frozen=True, kw_only=True)
class ReferenceContext(SectionContext):
    """View of a tip and the target for the tip's references; everything in world axes.

    Attributes:
        plant: Mechanics at the present state.
        tip: Frame of the tip.
        links: Frames of the target's links, by name.
        target: Joints of the target, root first; empty if its base is fixed.
        reading_of: Function from a signal's name and value (3x1) to the sensor's reading; None without
            sensors.
        held: Function from a signal's name, its present reading (n x 1) and the origin of the measurement (n
            x 1, zero if None) to the value in use: the reading, or the reading at the sensor's last sample.
        estimates: Estimates of the robot's filters, by signal; see :class:`Contribution`.
    """

    plant: Plant
    tip: int
    links: Mapping[str, int]
    target: tuple[int, ...]
    reading_of: Callable[[str, ca.SX], ca.SX | None]
    held: Callable[[str, ca.SX, ca.SX | None], ca.SX]
    estimates: Mapping[str, Callable[[ca.SX], ca.SX]]


@dataclass(frozen=True)
class ContactSurface:
    """A shape of a body, and the frame and joint in the model that carry it."""

    shape: Shape
    frame: int
    joint: int


@dataclass(frozen=True)
class ContactContext:
    """View of a contact: shapes of two bodies that may touch; everything in world axes.

    Attributes:
        context: Time and the numbers of the contact's section.
        plant: Mechanics at the present state.
        name: Name of the contact.
        pairs: Pairs of each first shape with each second one.
    """

    context: SectionContext
    plant: Plant
    name: str
    pairs: tuple[tuple[ContactSurface, ContactSurface], ...]

    def proximity(self, first: ContactSurface, second: ContactSurface) -> Proximity:
        """Proximity of two shapes, with the contact's ``crown``.

        Args:
            first, second: Surfaces of the two bodies.
        """
        crown = self.context.number("crown")
        return proximity(first.shape, second.shape, crown)

    def approach_speed(self, first: ContactSurface, second: ContactSurface) -> ca.SX:
        """Upper bound of the rate of the gap between two shapes (1x1) [m/s], wherever they are nearest.

        Args:
            first, second: Surfaces of the two bodies.
        """
        moving = [
            MovingShape(
                surface.shape,
                self.velocity(surface, surface.shape.position),
                self.plant.velocity(surface.frame)[1],
            )
            for surface in (first, second)
        ]
        return approach_speed(moving, self.context.number("crown"))

    def velocity(self, surface: ContactSurface, point: ca.SX) -> ca.SX:
        """Velocity of a body's material point, world axes (3x1) [m/s].

        Args:
            surface: Surface of the body.
            point: Current position of the point in the world (3x1) [m].
        """
        linear, angular = self.plant.velocity(surface.frame)
        return linear + cross(angular, point - self.plant.placement(surface.frame)[1])

    def opposite(
        self, pair: tuple[ContactSurface, ContactSurface], force: ca.SX, point: ca.SX
    ) -> tuple[Wrench, Wrench]:
        """Pair of opposite forces at a point.

        Args:
            pair: The two surfaces.
            force: Force on the second one, world axes (3x1) [N].
            point: Point of application in the world (3x1) [m].

        Returns:
            tuple: Wrench on the second one's joint as given, and the opposite one on the first one's joint.
        """
        none = ca.SX(3, 1)
        return Wrench(pair[1].joint, force, none, point), Wrench(pair[0].joint, -force, none, point)


def known(
    context: RobotContext | TipContext,
    signal: str,
    value: ca.SX,
    world: ca.SX | None = None,
    point: ca.SX | None = None,
) -> ca.SX:
    """Reading (n x 1) of a signal's sensor; see :meth:`TipContext.read`."""
    last = context.held(signal, value, world, point)
    if last is not None:
        return last
    offset, scale = context.sensors(signal)
    reading = scale * value if offset is None else offset + scale * value
    return reading if world is None else world + reading - value


def joint_of(plant: Plant, frame: int) -> int:
    """Id of the joint that carries a frame; 0 for a fixed frame."""
    return int(plant.model.frames[frame].parentJoint)


def unit_load(axis: int, *, rotation: bool) -> tuple[ca.SX, ca.SX]:
    """Unit force along a world axis and no couple, or no force and a unit couple about it (3x1 each)."""
    return unit_loads([axis], rotation=rotation)


def unit_loads(axes: Sequence[int], *, rotation: bool) -> tuple[ca.SX, ca.SX]:
    """Unit loads of n axes as columns (3xn each)."""
    units, none = ca.SX.eye(3)[:, list(axes)], ca.SX(3, len(axes))
    return (none, units) if rotation else (units, none)
