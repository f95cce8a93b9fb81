"""Contributions of elements to the closed loop."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

import casadi as ca

from spacerobot.dynamics import Wrench
from spacerobot.elements.core.event import Event, both

Item = TypeVar("Item", "State", "CommandedTorque", "PowerTerm", "Output", Wrench)


@dataclass(frozen=True)
class State:
    """State with its initial value and derivative.

    Attributes:
        name: Path of the state, ``rpr1/tip/pid.integral``.
        symbol: Symbols of the state (n x 1).
        initial: Initial value (n x 1), an expression of (t, q, v, c); other states in it count as zero.
        derivative: Time derivative, an expression of (t, x, c) (n x 1).
        remembers: Whether only events change it; initial values of other states may then depend on it.
    """

    name: str
    symbol: ca.SX
    initial: ca.SX
    derivative: ca.SX
    remembers: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """A name for each component."""
        return tuple(f"{self.name}[{i}]" for i in range(self.symbol.size1()))


def memory(name: str, initial: ca.SX) -> State:
    """State that keeps its value until an event changes it.

    Args:
        name: Name of the state and of its symbol.
        initial: Initial value (n x 1).
    """
    size = initial.size1()
    return State(name, ca.SX.sym(name, size), ca.densify(initial), ca.SX.zeros(size), remembers=True)


@dataclass(frozen=True)
class CommandedTorque:
    """Generalized forces commanded of a robot's actuators.

    Attributes:
        robot: Name of the robot.
        value: Generalized forces (nv x 1).
        null_space: Whether they are projected, so that they do not accelerate the robot's controlled tips.
    """

    robot: str
    value: ca.SX
    null_space: bool = False


@dataclass(frozen=True)
class ActuatorDrive:
    """Response of an actuator to commanded generalized forces.

    Attributes:
        columns: Indices in v on which it acts: joints or a base. Loads delivered to a base come from outside
            the scene; a wheel delivers none, its wrench is in ``answer``.
        deliver: Function from commands at these indices to delivered loads (n x 1 each) [N m or N].
        answer: Function from the command to its further contributions: states, wrenches, stored momentum,
            powers, outputs.
        passes_on: Indices at which the result of ``deliver`` is not delivered but passed to the next
            actuator; the remainder of the last actuator acts nowhere.
    """

    columns: tuple[int, ...]
    deliver: Callable[[ca.SX], ca.SX]
    answer: Callable[[ca.SX], Contribution] | None = None
    passes_on: tuple[int, ...] = ()


@dataclass(frozen=True)
class StoredMomentum:
    """Momentum and kinetic energy of an element in addition to those of the links, such as a wheel's.

    Attributes:
        body: Name of the body that carries it, ``rpr1``.
        angular: Angular momentum (3x1), world axes [N m s].
        energy: Kinetic energy (1x1) [J].
    """

    body: str
    angular: ca.SX
    energy: ca.SX


@dataclass(frozen=True)
class MotorSide:
    """Motion of a joint's motor as seen by an encoder on it, divided by the gear ratio.

    Attributes:
        column: Index of the joint in v.
        ahead: Motor position minus joint position (1x1) [rad or m].
        rate: Rate of the motor (1x1) [rad/s or m/s].
    """

    column: int
    ahead: ca.SX
    rate: ca.SX


@dataclass(frozen=True)
class ControlChannel:
    """Control law that may depend on its own acceleration: ``u = command - derivative_gain (C v' + drift)``.

    Attributes:
        robot: Name of the robot whose actuators exert u.
        actuation: Map from u to generalized forces (nv x n): transposed rows of the manipulator Jacobian.
        drive: ``actuation``, reduced (nv x n).
        sense: Reduced loads along which v' is C v' (nv x n).
        command: u without the part that depends on v' (n x 1).
        derivative_gain: K_d (n x 1); None if u does not depend on v'.
        moves_tip: Whether it moves a tip, whose motion the robot's null space must not change.
    """

    robot: str
    actuation: ca.SX
    drive: ca.SX
    sense: ca.SX
    command: ca.SX
    derivative_gain: ca.SX | None
    moves_tip: bool = True

    @property
    def size(self) -> int:
        """Number of components of u."""
        return self.command.size1()


@dataclass(frozen=True)
class SampledLaw:
    """Channels with a derivative, evaluated at sample instants and held between them.

    At an instant their outputs are solved for like those of a continuous law, with all other torques as
    commanded at that instant.

    Attributes:
        event: Name of the event that evaluates them.
        channels: Channels of the continuous law.
        output: Symbols (n x 1) of their outputs, stacked, in the event's updates.
        held: Generalized forces (nv x 1) that their controller holds and that the new ones replace.
        group: Label of laws that are evaluated at the same instants.
        first: Index of the first of its outputs among those of all channels.
    """

    event: str
    channels: tuple[ControlChannel, ...]
    output: ca.SX
    held: ca.SX
    group: str = ""
    first: int = 0

    def of(self, outputs: Any) -> Any:
        """Outputs of this law among those of all channels (n x 1)."""
        return outputs[self.first : self.first + self.output.size1()]

    def others(self, drives: Iterable[ActuatorDrive]) -> list[ActuatorDrive]:
        """Actuators that act elsewhere.

        The channels' own commands count as delivered, as in continuous time.
        """
        rows = {row for channel in self.channels for row in channel.actuation.sparsity().row()}
        return [drive for drive in drives if rows.isdisjoint(drive.columns)]


def jointly(laws: Sequence[SampledLaw]) -> tuple[SampledLaw, ...]:
    """Sampled laws in which those of one group are solved together, each for its own outputs.

    Solved one after the other, each would treat the others' last outputs as constant. That is a block
    iteration with one step per period, which hardly contracts if two laws act on the same light joints
    (factor 0.9 per period for position and orientation of one tip).
    """
    groups = []
    for law in laws:
        peers = [other for other in laws if other.group == law.group]
        before = peers[: [peer.event for peer in peers].index(law.event)]
        groups.append(
            dataclasses.replace(
                law,
                channels=tuple(channel for peer in peers for channel in peer.channels),
                held=sum((peer.held for peer in peers[1:]), peers[0].held),
                first=sum(peer.output.size1() for peer in before),
            )
        )
    return tuple(groups)


@dataclass(frozen=True)
class PowerTerm:
    """Power in the energy balance.

    Attributes:
        name: Label in the energy ledger; powers with the same label are added up.
        value: Power (1x1) [W].
        sign: ``in`` for power put into the system, ``out`` for power taken from it.
    """

    name: str
    value: ca.SX
    sign: Literal["in", "out"] = "out"


@dataclass(frozen=True)
class Output:
    """Observable of an element.

    Attributes:
        name: Variable of the result. Outputs with the same name are stacked over their labels; those with the
            same name and label are added.
        value: Vector in world axes (3x1), or number (1x1).
        unit: SI unit, ``1`` for a pure number.
        text: Description for axes, tables and the documentation.
        dimension, label: Dimension (``tip``, ``body``, ``grasp`` or ``contact``) and label along it;
            ``joint`` for one number per joint (n x 1); empty for the whole scene. Any other word is a
            dimension of its own, with labels in the order of the outputs.
        plotted: Whether pages plot it over time.
    """

    name: str
    value: ca.SX
    unit: str
    text: str
    dimension: str | None = None
    label: str = ""
    plotted: bool = True


@dataclass(frozen=True)
class AccelerationConstraint:
    """Constraint on accelerations, ``G v' + drift = 0``, with the wrenches that enforce it.

    Attributes:
        directions: Unit force and torque on the tip (pairs of 3x1), opposite on the target at the same point.
            They have full rank: two or three, and one or three more for a weld.
        sense: The same loads, reduced, along which v' is the relative acceleration without drift (nv x n).
        drift: Remaining acceleration and stabilisation (n x 1).
        slip: Relative velocity (n x 1).
        answer: Function from the reaction's force and torque on the target (3x1 each) to powers and outputs.
        active: Switch (1x1) that is 1 while the constraint holds; None if it always does.
        struck: Function from an impulse's force and torque on the target (3x1 each) [N s, N m s] to new
            values of states by name; None if no state stores it.
        compliance: C (n x 1), if the reactions w also accelerate something outside v: ``G v' + drift + C w =
            0``, with its inverse inertia C. None otherwise.
        imposed: Relative velocity (n x 1) that it enforces: ``G v = imposed`` without slip; None for zero.
        known: For a held joint, switch (1x1) that is 1 while controllers know about it; else None.
    """

    directions: tuple[tuple[ca.SX, ca.SX], ...]
    sense: ca.SX
    drift: ca.SX
    slip: ca.SX
    answer: Callable[[ca.SX, ca.SX], Contribution]
    active: ca.SX | None = None
    struck: Callable[[ca.SX, ca.SX], Mapping[str, ca.SX]] | None = None
    compliance: ca.SX | None = None
    imposed: ca.SX | None = None
    known: ca.SX | None = None

    @property
    def size(self) -> int:
        """Number of rows."""
        return len(self.directions)

    def on_target(self, along: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Force and torque on the target (3x1 each) for loads along the directions on the tip (n x 1)."""
        force, torque = ca.SX(3, 1), ca.SX(3, 1)
        for k, (line, axis) in enumerate(self.directions):
            force, torque = force - line * along[k], torque - axis * along[k]
        return force, torque


@dataclass(frozen=True)
class Innovation:
    """Innovations of a filter by the samples of one signal, for tests of whether its sensor has failed.

    Attributes:
        filter, signal: Label of the filter, ``servicer/attitude``, and name of the signal.
        square: Last normalised innovation squared (1x1).
        size: Number of components.
        used: Time of the last sample that was used (1x1) [s], below zero for none.
        period, delay: Between instants at which the filter takes samples, and the first of them (1x1) [s].
        period_s: Period of the samples [s], by the scenario's numbers.
    """

    filter: str
    signal: str
    square: ca.SX
    size: int
    used: ca.SX
    period: ca.SX
    delay: ca.SX
    period_s: float


@dataclass(frozen=True)
class Contribution:
    """Contribution of one element to the closed loop; the loop concatenates.

    Attributes:
        states: States of the element.
        torques: Torques commanded to actuators.
        wrenches: Internal wrenches on bodies, in opposite pairs or against stored momentum: they conserve
            total momentum.
        outside: Wrenches from outside the scene; momentum is then not conserved.
        channels: Control laws that may depend on the acceleration.
        sampled: Such laws that are evaluated at sample instants.
        drives: Drives of actuators, in the order in which they act.
        stored: Momenta and kinetic energies in addition to those of the links.
        wheels: Angular momenta (3x1) of sets of wheels about their axes, world axes, for unloading.
        motors: Motors of joints with a transmission, for encoders on the motors.
        constraints: Acceleration constraints of rigid connections.
        energy: Energy stored in springs (1x1) [J]; None if zero.
        powers, outputs: Terms of the energy ledger, and observables.
        events: Events at which the element's law changes.
        estimates: Signals that the robot's controllers read from it instead of a sensor, each with a function
            from the true value to the estimate. For ``target_position`` and ``target_velocity`` the argument
            is the true position of a point of the target (3x1), world axes.
        innovations: Innovations of a filter, for each signal that it uses.
        fine: Switches (1x1), each with the longest step [s] while it is 1 (infinite for that of the rollout),
            and the number of such steps over which steps grow at first and shrink at last.
    """

    states: tuple[State, ...] = ()
    torques: tuple[CommandedTorque, ...] = ()
    wrenches: tuple[Wrench, ...] = ()
    outside: tuple[Wrench, ...] = ()
    channels: tuple[ControlChannel, ...] = ()
    sampled: tuple[SampledLaw, ...] = ()
    drives: tuple[ActuatorDrive, ...] = ()
    stored: tuple[StoredMomentum, ...] = ()
    wheels: tuple[ca.SX, ...] = ()
    motors: tuple[MotorSide, ...] = ()
    constraints: tuple[AccelerationConstraint, ...] = ()
    energy: ca.SX | None = None
    powers: tuple[PowerTerm, ...] = ()
    outputs: tuple[Output, ...] = ()
    events: tuple[Event, ...] = ()
    estimates: tuple[tuple[str, Callable[[ca.SX], ca.SX]], ...] = ()
    innovations: tuple[Innovation, ...] = ()
    fine: tuple[tuple[ca.SX, float, float], ...] = ()


def concatenate(parts: Iterable[Contribution]) -> Contribution:
    """Join contributions into one, in their order."""
    contributions = list(parts)
    energies = [part.energy for part in contributions if part.energy is not None]
    lists = {
        field.name: tuple(item for part in contributions for item in getattr(part, field.name))
        for field in dataclasses.fields(Contribution)
        if field.name != "energy"
    }
    return Contribution(**lists, energy=sum(energies[1:], energies[0]) if energies else None)


def gated(contribution: Contribution, switch: ca.SX, outputs: Collection[str] = ()) -> Contribution:
    """Contribution that acts while a switch is 1; otherwise its states are constant and it stores no energy.

    ``outputs`` are the names of outputs that are zero while the switch is 0.
    """

    def commanded(channel: ControlChannel) -> ControlChannel:
        gain = None if channel.derivative_gain is None else channel.derivative_gain * switch
        return dataclasses.replace(channel, command=channel.command * switch, derivative_gain=gain)

    def scaled(item: Item, **values: Any) -> Item:
        return dataclasses.replace(item, **{name: value * switch for name, value in values.items()})

    return dataclasses.replace(
        contribution,
        states=tuple(scaled(state, derivative=state.derivative) for state in contribution.states),
        torques=tuple(scaled(torque, value=torque.value) for torque in contribution.torques),
        wrenches=tuple(
            scaled(wrench, force=wrench.force, torque=wrench.torque) for wrench in contribution.wrenches
        ),
        outside=tuple(
            scaled(wrench, force=wrench.force, torque=wrench.torque) for wrench in contribution.outside
        ),
        channels=tuple(commanded(channel) for channel in contribution.channels),
        constraints=tuple(
            dataclasses.replace(constraint, active=switch) for constraint in contribution.constraints
        ),
        energy=None if contribution.energy is None else contribution.energy * switch,
        powers=tuple(scaled(power, value=power.value) for power in contribution.powers),
        outputs=tuple(
            scaled(output, value=output.value) if output.name in outputs else output
            for output in contribution.outputs
        ),
        events=tuple(
            dataclasses.replace(event, armed=both(event.armed, switch)) for event in contribution.events
        ),
    )
