r"""Reaction wheels: response of a set to the torque commanded at its robot's base.

With the axes $a_i$ of the wheels as columns of $A$, root link's axes, the motors deliver $-A^+ T$ for a
torque $T$ on the base, which are the smallest torques that do, each up to its limit. A wheel with the speed
$s$ relative to the base has the angular momentum $h$ about its axis:

$$ \dot h = u - f(s), \qquad h = J\,(s + a \cdot \omega) $$

with the motor's torque $u$ and the friction $f$. The base receives $-A \dot h - \omega \times A h$. At its
speed limit a motor balances friction and nothing else, so that $h$ stays constant, until the command reduces
the speed. The others of a redundant set take over its share: the pseudo-inverse is then that of their axes.

Which wheels of a redundant set are held is a linear complementarity problem. The motors' torques $u$
minimise

$$ |u|^2 + |A u + T|^2 / \varepsilon \quad \text{subject to} \quad
   (u_i - f_i) \operatorname{sign}(s_i) \le 0 \ \text{ for each wheel at its limit} $$

with $\varepsilon$ = ``SINGULAR``. A held wheel has $u_i = f_i$. It is released when $u_i$, computed with it
free and the others unchanged, reduces its speed; this has the sign of its multiplier. The problem is
strictly convex, so one set of held wheels solves it, and torques are continuous when a wheel is released.
Exchanging one wheel at a time, the first one that contradicts its switch, ends at that set (Murty's
least-index method). These exchanges are the events below, in their order, at one instant. A hysteresis
keeps rounding from repeating them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from spacerobot.common.arrays import Array
from spacerobot.common.section import quantity
from spacerobot.dynamics.algebra import SymmetricFactors
from spacerobot.elements.actuators.actuator import Actuator
from spacerobot.elements.actuators.momentum_residual import Momenta, sample_noise, sampled_residual
from spacerobot.elements.actuators.saturation import saturation_events
from spacerobot.elements.core.clock import Clock
from spacerobot.elements.core.context import ActuatorContext
from spacerobot.elements.core.contribution import Contribution, Output
from spacerobot.elements.core.event import Event, either, negated
from spacerobot.elements.core.failure import (
    AllocatedFailure,
    ResidualTest,
    detected_failures,
    detection,
    failing,
)
from spacerobot.elements.core.robot_element import Part

SLACK = 1e-3
"""Margin below its speed limit, relative to it, at which a held wheel is free again as its base rotates."""


SINGULAR = 1e-8
"""Regularisation of the pseudo-inverse along directions in which the free wheels give no torque."""

PULL = 1e-6
"""Fraction of the set's torques by which the torque of a wheel at its speed limit must reduce its speed to
release it. Well above the rounding error, 1e-16 / SINGULAR where the free wheels lack a direction; used only
for redundant wheels."""


class WheelFailure(AllocatedFailure):
    """Failure of a wheel."""

    wheel: int = Field(ge=0, description="number of the wheel, from 0")
    mode: Literal["seized", "off"] = Field(
        default="seized",
        description="seized: it stops at once and turns with the base; off: its motor gives no torque, and "
        "it coasts against its friction",
    )


class WheelDetection(ResidualTest):
    """Detection of failed wheels, which the allocation then leaves out."""

    speed_noise: float = quantity(
        "rad/s", "standard deviation of a sample of a wheel's speed", default=0.0, ge=0
    )
    allowance: float = quantity(
        "N m", "residual that errors of the model may cause, on top of noise", default=0.0, ge=0
    )

    @model_validator(mode="after")
    def _check(self) -> WheelDetection:
        if not (self.spin_noise or self.speed_noise or self.allowance):
            raise ValueError("allowance: found 0, allowed: above 0 where samples have no noise")
        return self


class WheelSet(Actuator):
    """A set of equal wheels that take over the torque commanded at their robot's base."""

    base_wrench: ClassVar[frozenset[Part]] = frozenset({"torque"})
    has_wheels: ClassVar[bool] = True

    torque_limit: float | None = quantity("N m", "maximum torque of each motor", default=None, gt=0)
    speed_limit: float | None = quantity(
        "rad/s", "maximum speed relative to the base, 628 rad/s for 6000 rpm", default=None, gt=0
    )
    coulomb: float = quantity("N m", "friction that does not depend on speed", default=0.0, ge=0)
    coulomb_speed: float = quantity(
        "rad/s", "speed at which that friction has reached 1/sqrt(2) of its value", default=1.0, gt=0
    )

    failures: tuple[WheelFailure, ...] = Field(
        default=(), max_length=64, description="wheels that fail, each with `wheel`, `at` and `mode`"
    )
    detection: WheelDetection | None = Field(
        default=None, description="detect failed wheels from their momentum, and allocate without them"
    )

    @property
    def seized(self) -> Mapping[int, int]:
        """Seized wheels, with the index of the failure."""
        return {failure.wheel: i for i, failure in enumerate(self.failures) if failure.mode == "seized"}

    def seizing(self, actuator: ActuatorContext, wheel: int) -> tuple[dict[str, bool], dict[str, ca.SX]]:
        """Switches that the event sets at which a wheel seizes, and states that it updates."""
        raise NotImplementedError

    def failed(self, actuator: ActuatorContext, count: int) -> tuple[ca.SX, tuple[Event, ...]]:
        """Remaining fraction of each motor's torque (n x 1), and the failure events."""
        works, events, names = ca.SX.ones(count), list[Event](), names_of(actuator, count)
        for i, failure in enumerate(self.failures):
            context = actuator.context.at(f"{actuator.context.path}.failures.{i}")
            stops = failure.mode == "seized"
            sets, updates = self.seizing(actuator, failure.wheel) if stops else ({}, {})
            failed, event = failing(context, names[failure.wheel], sets=sets, updates=updates, impact=stops)
            works[failure.wheel] *= 1 - failed
            events.append(event)
        return works, tuple(events)

    def left_out(self, actuator: ActuatorContext, count: int) -> ca.SX:
        """Mask of wheels left out of the allocation (n x 1): those known or detected to have failed."""
        excluded, context = ca.SX(count, 1), actuator.context
        for i, failure in enumerate(self.failures):
            if failure.known:
                failed = context.at(f"{context.path}.failures.{i}").switch("failed")
                excluded[failure.wheel] = either(excluded[failure.wheel], failed)
        if self.detection is not None:
            for i in range(count):
                excluded[i] = either(excluded[i], context.switch(f"detected.{i}"))
        return excluded

    def detected(
        self, actuator: ActuatorContext, motors: WheelMotors, speed: ca.SX, axes: ca.SX, inertia: ca.SX
    ) -> Contribution:
        """Detection events from the residuals of the wheels' momenta ``J (s + a . omega)``.

        The rates of the momenta are the commanded torques minus friction at these speeds (n x 1), with axes
        (3 x n) and inertias (n x 1 or 1x1).
        """
        section, count, names = self.detection, speed.size1(), names_of(actuator, speed.size1())
        if section is None:
            return Contribution()
        columns, about = base_rotation_axes(actuator)
        context = actuator.context.at(f"{actuator.context.path}.detection")
        spin = ca.SX(3, 1)
        spin[about] = actuator.plant.v[list(columns)]

        def momenta(clock: Clock) -> Momenta:
            kinds = ["speed_noise"] * count + ["spin_noise"] * len(about)
            deviations = [ca.SX(1, 1) if context.is_zero(key) else context.number(key) for key in kinds]
            errors, numbers = sample_noise(context, name, section.period, clock, deviations)
            spin_error = ca.SX(3, 1)
            spin_error[about] = errors[count:]
            measured_momenta = inertia * (speed + errors[:count] + ca.mtimes(axes.T, spin + spin_error))
            return ca.densify(measured_momenta), ca.densify(-motors.friction), numbers

        name = f"{actuator.robot}/{actuator.context.path.rpartition('.')[2]}.detection"
        residual = sampled_residual(section, context, name, ca.densify(motors.command), momenta)
        switches = [actuator.context.switch(f"detected.{i}") for i in range(count)]
        events, outputs = list[Event](), list[Output]()
        for i, (who, switch) in enumerate(zip(names, switches, strict=True)):
            events.append(detection(f"{who}.detected", who, residual.excess[i], switch))
            text = "torque that wheels miss"
            outputs.append(Output("wheel_residual", residual.values[i], "N m", text, "wheel", who))
        total = detected_failures(ca.sum1(ca.vertcat(*switches)), actuator.robot)
        return Contribution(
            states=residual.states, events=(*residual.events, *events), outputs=(*outputs, total)
        )

    def wrong_wheels(self, count: int) -> Iterable[tuple[str, str]]:
        """Errors: failures of wheels that do not exist or have already seized; see ``faults``."""
        for i, failure in enumerate(self.failures):
            if failure.wheel >= count:
                yield f"failures.{i}.wheel", f"found {failure.wheel}, allowed: 0 to {count - 1}"
            elif failure.mode == "seized" and self.seized[failure.wheel] != i:
                yield f"failures.{i}.wheel", f"found {failure.wheel}, which seizes twice"

    def within(self) -> str:
        """The limits in words."""
        limits = [] if self.torque_limit is None else [f"{self.torque_limit:g} N m"]
        if self.speed_limit is not None:
            limits.append(f"{self.speed_limit:g} rad/s ({self.speed_limit * 30 / np.pi:.0f} rpm)")
        return f"each up to {' and '.join(limits)}" if limits else "torque and speed not limited"

    def coulomb_friction(self, actuator: ActuatorContext, speed: ca.SX) -> ca.SX:
        """Coulomb friction torque against the motion at these speeds (n x 1) [N m], smooth through zero."""
        path = f"{actuator.context.path}.coulomb"
        coulomb = actuator.context.once("coulomb", actuator.context.parameters.sparse(path))
        if not coulomb.nnz():
            return ca.SX(speed.size1(), 1)
        return coulomb * speed / ca.sqrt(speed**2 + actuator.context.number("coulomb_speed") ** 2)

    def motors(
        self, actuator: ActuatorContext, wheel_command: ca.SX, axes: ca.SX, speed: ca.SX, friction: ca.SX
    ) -> WheelMotors:
        """Motor torques for the torques commanded of free wheels, at these speeds (n x 1 each).

        Axes (k x n) have only the rows that can rotate the base.
        """
        command, count, switches = wheel_command, speed.size1(), list[ca.SX]()
        pull, out = ca.SX(0), self.left_out(actuator, count)
        if self.speed_limit is not None:
            switches = [actuator.context.switch(f"held.{i}") for i in range(count)]
        if (switches or out.nnz()) and (
            sum(axes[i, :].nnz() > 0 for i in range(axes.size1())) < axes.size2()
        ):
            # The motor of a wheel held at its speed limit balances friction; the other wheels take over the
            # rest of its command. An excluded wheel's motor gives no torque.
            friction_command = friction * (1 - out)
            held_switch_wheels = ca.vertcat(*(either(out[i], *switches[i : i + 1]) for i in range(count)))
            command = friction_command + _taken_over(
                wheel_command - friction_command, axes, held_switch_wheels
            )
            if switches:
                pull = PULL * ca.sum1(ca.fabs(wheel_command - friction))
        command = command * (1 - out)
        events = list[Event]()
        if self.torque_limit is not None:
            limit = actuator.context.number("torque_limit")
            beyond, names = ca.fabs(command) / limit - 1, names_of(actuator, count)
            events += saturation_events(
                actuator, names, beyond, free=[negated(held_switch_wheels) for held_switch_wheels in switches]
            )
            command = ca.fmin(ca.fmax(command, -limit), limit)
        name = names_of(actuator, count)[0].rpartition(".")[0]
        command = actuator.command_port(name, "N m", "torques commanded of the wheels' motors", command)
        command = actuator.break_point("wheel", names_of(actuator, count), command)
        works, failures = self.failed(actuator, count)
        motor_torque = works * command if self.failures else command
        events += failures
        if self.speed_limit is None:
            return WheelMotors(command, motor_torque - friction, friction, tuple(events))
        speed_limit, free = actuator.context.number("speed_limit"), list[ca.SX]()
        for i, (name, held_switch_wheels) in enumerate(zip(names_of(actuator, count), switches, strict=True)):
            over = ca.fabs(speed[i]) / speed_limit - 1
            faster = (motor_torque[i] - friction[i]) * speed[i] / speed_limit
            back = ca.fmax(-faster - pull, -SLACK - over)
            switch_name = held_switch_wheels.name()
            events += [
                Event(
                    f"{name}.saturated",
                    "saturated",
                    name,
                    ca.fmin(over, faster),
                    negated(held_switch_wheels),
                    {switch_name: True},
                ),
                Event(f"{name}.freed", "freed", name, back, held_switch_wheels, {switch_name: False}),
            ]
            free.append(1 - held_switch_wheels)
        ready = ca.vertcat(*free)
        command = (command - friction) * ready + friction
        return WheelMotors(command, (motor_torque - friction) * ready, friction, tuple(events))

    def observed(
        self, actuator: ActuatorContext, motors: WheelMotors, speed: ca.SX, momentum: ca.SX
    ) -> tuple[Output, ...]:
        """Speed, torque and margin of each wheel (n x 1 each), and the momentum of all (3x1), world axes."""
        names, outputs = names_of(actuator, speed.size1()), list[Output]()
        values = {
            "wheel_speed": (speed, "rad/s", "speed of wheels relative to their bases"),
            "wheel_torque": (motors.net + motors.friction, "N m", "torque of wheels' motors"),
        }
        if self.speed_limit is not None:
            margin = 1 - ca.fabs(speed) / actuator.context.number("speed_limit")
            values["wheel_margin"] = (margin, "1", "part of wheels' speed limits that is left")
        for name, (value, unit, text) in values.items():
            outputs += [Output(name, value[i], unit, text, "wheel", names[i]) for i in range(len(names))]
        text = "angular momentum of wheels about their axes, by the bodies that carry them"
        return (*outputs, Output("wheel_momentum", momentum, "N m s", text, "body", actuator.robot))


@dataclass(frozen=True)
class WheelMotors:
    """Torques of the motors of n wheels at one instant.

    Attributes:
        command: Torques of the motors if none has failed: friction where a wheel is held at its speed limit
            (n x 1) [N m].
        net: Torques on the wheels, friction included (n x 1) [N m].
        friction: Against the wheels' motion (n x 1) [N m].
        events: Events at which wheels reach their speed limit, and leave it.
    """

    command: ca.SX
    net: ca.SX
    friction: ca.SX
    events: tuple[Event, ...]


def names_of(actuator: ActuatorContext, count: int) -> list[str]:
    """Names of the wheels of a set."""
    return [f"{actuator.robot}/{actuator.context.path.rpartition('.')[2]}.{i}" for i in range(count)]


def base_rotation_axes(actuator: ActuatorContext) -> tuple[tuple[int, ...], list[int]]:
    """Indices in v of the base's angular velocity, and which of the root link's axes they are about."""
    columns = actuator.base_columns
    return (columns[2:], [2]) if len(columns) == 3 else (columns[3:], [0, 1, 2])


def pseudo_inverse(axes: ca.SX) -> ca.SX:
    """Pseudo-inverse (n x k) of independent rows, or else columns, of n wheels' axes (k x n).

    Rows that are structurally zero have no part in it.
    """
    rows = [i for i in range(axes.size1()) if axes[i, :].nnz()]
    independent = axes[rows, :]
    inverse = ca.SX(axes.size2(), axes.size1())
    if len(rows) <= axes.size2():
        inverse[:, rows] = SymmetricFactors(ca.mtimes(independent, independent.T)).solve(independent).T
    else:
        inverse[:, rows] = SymmetricFactors(ca.mtimes(independent.T, independent)).solve(independent.T)
    return inverse


def _taken_over(command: ca.SX, axes: ca.SX, held: ca.SX) -> ca.SX:
    """Torque of each wheel (n x 1) if it is free and the other wheels at their limit are left out.

    The free wheels add ``a_i . y`` with ``A W A^T y = m`` to replace the torque m of the held wheels; the sum
    is the pseudo-inverse of the free axes. For a held wheel, the result is its torque if it were free as
    well.
    """
    rows = [i for i in range(axes.size1()) if axes[i, :].nnz()]
    independent, free = axes[rows, :], 1 - held
    matrix = SINGULAR * ca.SX.eye(len(rows)) + ca.mtimes(independent, free * independent.T)
    solution = SymmetricFactors(matrix).solve(ca.horzcat(ca.mtimes(independent, held * command), independent))
    more, sizes = ca.mtimes(independent.T, solution[:, 0]), ca.sum1(independent * solution[:, 1:]).T
    return (command + more) / (1 + held * sizes)


def are_independent(axes: Sequence[ArrayLike]) -> bool:
    """Whether :func:`pseudo_inverse` of the axes of n wheels (n, 3) is an exact pseudo-inverse."""
    matrix: Array = np.array(axes, dtype=float)
    matrix = matrix[:, matrix.any(axis=0)]
    return bool(np.linalg.matrix_rank(matrix, tol=1e-6) == min(matrix.shape))
