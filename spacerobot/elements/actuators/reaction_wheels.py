"""Reaction wheels of a base; see :mod:`spacerobot.elements.actuators.wheel_set`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Literal

import casadi as ca
import numpy as np
from pydantic import Field, model_validator

from spacerobot.common.arrays import Array
from spacerobot.common.section import Section, Vector, quantity
from spacerobot.dynamics.algebra import cross
from spacerobot.elements.actuators.actuator import MomentumStorage
from spacerobot.elements.actuators.wheel_set import (
    WheelMotors,
    WheelSet,
    are_independent,
    base_rotation_axes,
    names_of,
    pseudo_inverse,
)
from spacerobot.elements.core.context import ActuatorContext, once_for_each, unit_load
from spacerobot.elements.core.contribution import (
    AccelerationConstraint,
    ActuatorDrive,
    Contribution,
    PowerTerm,
    State,
    StoredMomentum,
    concatenate,
    memory,
)
from spacerobot.elements.core.registry import register
from spacerobot.elements.core.robot_element import Part, RobotProperties
from spacerobot.elements.references.reference import DEGREE

ACROSS = 1e-6
"""Maximum cosine between a wheel's axis and a root-link axis about which it exerts no torque."""


class Pyramid(Section):
    """Wheels evenly around the root link's z axis."""

    wheels: int = Field(default=4, ge=3, le=16, description="how many; the first above the x axis")
    tilt_deg: float = quantity(
        "deg",
        "of the axes out of the x-y plane; at 35.26 all directions are alike",
        default=35.26,
        gt=0,
        lt=90,
    )

    def directions(self) -> Iterator[tuple[float, float]]:
        """Cosine and sine of each wheel's azimuth about z, exact along an axis."""
        for i in range(self.wheels):
            angle = 2 * np.pi * i / self.wheels
            yield (float(np.round(np.cos(angle), 15)), float(np.round(np.sin(angle), 15)))


@register
class ReactionWheels(WheelSet):
    """A set of equal reaction wheels on the base that deliver the commanded torque until they saturate."""

    kind: Literal["reaction_wheels"] = "reaction_wheels"
    axes: tuple[Vector, ...] = quantity(
        "1", "direction of each wheel's axis, root link's axes, of any length", default=(), max_length=64
    )
    pyramid: Pyramid | None = Field(default=None, description="in place of `axes`: wheels evenly around z")
    inertia: float = quantity("kg m^2", "of each about its axis, in addition to the root link's", gt=0)
    viscous: float = quantity("N m s/rad", "friction by speed", default=0.0, ge=0)
    speeds: tuple[float, ...] = quantity(
        "rad/s", "speed of each at the start, relative to the base; at rest if not given", default=()
    )

    @model_validator(mode="after")
    def _check(self) -> ReactionWheels:
        if bool(self.axes) == (self.pyramid is not None):
            raise ValueError("give either `axes` or `pyramid`" + ", not both" * bool(self.axes))
        for i, axis in enumerate(self.axes):
            if not any(axis):
                raise ValueError(f"axes.{i}: found the zero vector, allowed: any direction")
        if self.axes and not are_independent(self.axes):
            raise ValueError(
                "axes: found directions that depend on each other, so that torque cannot be shared out; "
                "leave one out, or make two sets"
            )
        if self.speeds and len(self.speeds) != self.count:
            raise ValueError(f"speeds: found {len(self.speeds)}, allowed: {self.count}, one for each wheel")
        fast = [speed for speed in self.speeds if self.speed_limit and abs(speed) > self.speed_limit]
        if fast:
            raise ValueError(f"speeds: found {fast[0]:g}, allowed: up to speed_limit, {self.speed_limit:g}")
        return self

    @property
    def count(self) -> int:
        """Number of wheels."""
        return self.pyramid.wheels if self.pyramid else len(self.axes)

    def momentum_storage(self) -> MomentumStorage:
        """Momentum storage of all wheels."""
        if self.pyramid is None:
            vectors = np.array(self.axes, dtype=float).T
            axes = vectors / np.linalg.norm(vectors, axis=0)
        else:
            tilt = np.radians(self.pyramid.tilt_deg)
            across, up = np.cos(tilt), np.sin(tilt)
            axes = np.array([(across * x, across * y, up) for x, y in self.pyramid.directions()]).T
        speeds = np.array(self.speeds or np.zeros(self.count))
        return MomentumStorage(axes, self.inertia, speeds, self.torque_limit, self.speed_limit)

    def wrench_limits(self, *, planar: bool) -> Mapping[Part, Array]:
        """Torque that the motors give by the pseudo-inverse of their axes, whatever other axes take."""
        axes = self.momentum_storage().axes
        if not planar and np.linalg.matrix_rank(axes) < 3:
            return {"torque": np.zeros(3)}
        shared = np.abs(np.linalg.pinv(axes)).sum(axis=1).max()
        limit = np.inf if self.torque_limit is None else self.torque_limit / shared
        return {"torque": np.where(np.abs(axes).max(axis=1) > ACROSS, limit, 0.0)}

    def build(self, actuator: ActuatorContext) -> Contribution:
        """Contribution: the wheels' angular momenta as states.

        Motors act on wheels and base with opposite torques.
        """
        context, name = actuator.context, f"{actuator.robot}/{actuator.context.path.rpartition('.')[2]}"
        columns, about = base_rotation_axes(actuator)
        axes, inverse = self._geometry(actuator, about)
        spin = ca.SX(3, 1)
        spin[about] = actuator.plant.v[list(columns)]
        inertia, carried = context.number("inertia"), ca.mtimes(axes.T, spin)
        momentum_symbol = momentum = ca.SX.sym(f"{name}.momentum", self.count)
        speed, rotation = momentum / inertia - carried, actuator.plant.placement(actuator.base_frame)[0]
        stops = self._stopped(actuator, axes[about, :], speed, inertia)
        if self.seized:
            speed = speed * (1 - self._seized(actuator))
            momentum = inertia * (speed + carried)
        friction = self.coulomb_friction(actuator, speed)
        viscous = context.once("viscous", context.parameters.sparse(f"{context.path}.viscous"))
        friction = friction + viscous * speed
        lost = (PowerTerm("wheel_friction", ca.dot(friction, speed)),) if friction.nnz() else ()
        total_momentum = ca.mtimes(axes, momentum)
        began = ca.vertcat(
            *(context.parameters(f"{context.path}.speeds.{i}") for i in range(len(self.speeds)))
        )
        first = inertia * (carried + (context.once("speeds", began) if self.speeds else 0))

        @once_for_each
        def motors(command: ca.SX) -> WheelMotors:
            return self.motors(
                actuator, -ca.mtimes(inverse[:, about], command), axes[about, :], speed, friction
            )

        def answer(command: ca.SX) -> Contribution:
            """Contribution except the command that remains for the next actuator."""
            motor_torques = motors(command)
            torque = ca.mtimes(rotation, -ca.mtimes(axes, motor_torques.net) - cross(spin, total_momentum))
            tests = self.detected(actuator, motor_torques, speed, axes, inertia)
            return Contribution(
                states=(State(f"{name}.momentum", momentum_symbol, first, motor_torques.net), *tests.states),
                wrenches=(actuator.on_base(torque=torque),),
                powers=(
                    PowerTerm("actuator", ca.dot(motor_torques.net + motor_torques.friction, speed), "in"),
                    *lost,
                ),
                outputs=(
                    *self.observed(actuator, motor_torques, speed, ca.mtimes(rotation, total_momentum)),
                    *tests.outputs,
                ),
                events=(*motor_torques.events, *tests.events),
            )

        def left(command: ca.SX) -> ca.SX:
            return command + ca.mtimes(axes[about, :], motors(command).command)

        stored = StoredMomentum(
            actuator.robot, ca.mtimes(rotation, total_momentum), ca.dot(momentum, momentum) / (2 * inertia)
        )
        drive = ActuatorDrive(columns, left, answer, passes_on=columns)
        return replace(
            stops, drives=(drive,), stored=(stored,), wheels=(ca.mtimes(rotation, total_momentum),)
        )

    def seizing(self, actuator: ActuatorContext, wheel: int) -> tuple[dict[str, bool], dict[str, ca.SX]]:
        """State updates that mark the wheel as stopped."""
        return {}, {f"{names_of(actuator, self.count)[wheel]}.stopped": ca.SX(1)}

    def _seized(self, actuator: ActuatorContext) -> ca.SX:
        """Switches of wheels that have seized (n x 1)."""
        context, switches = actuator.context, ca.SX(self.count, 1)
        for wheel, i in self.seized.items():
            switches[wheel] = context.at(f"{context.path}.failures.{i}").switch("failed")
        return switches

    def _stopped(self, actuator: ActuatorContext, axes: ca.SX, speed: ca.SX, inertia: ca.SX) -> Contribution:
        """Constraints by which seized wheels (axes k x n, speeds n x 1) rotate with the base.

        With the torque w on the base, ``a . omega' = -w / J``. In the impulse that stops the wheel, ``a .
        omega+ + w / J = h- / J``: the base receives the momentum that the wheel loses. Later impacts, such as
        a capture, see a wheel at rest relative to the base, with momentum ``J a . omega``: the base with the
        wheel's inertia added about the axis.
        """
        plant, constraints_of_wheels = actuator.plant, Contribution()
        columns, switches = list(base_rotation_axes(actuator)[0]), self._seized(actuator)
        for wheel in self.seized:
            stopped = memory(f"{names_of(actuator, self.count)[wheel]}.stopped", ca.SX.zeros(1))
            unit = ca.SX(plant.v.size1(), 1)
            unit[columns] = axes[:, wheel]
            constraint = AccelerationConstraint(
                (unit_load(2, rotation=True),),
                plant.reduced(unit),
                ca.SX(1, 1),
                -speed[wheel] * (1 - stopped.symbol),
                lambda *_: Contribution(),
                switches[wheel],
                compliance=1 / inertia,
            )
            constraints_of_wheels = concatenate(
                [constraints_of_wheels, Contribution(states=(stopped,), constraints=(constraint,))]
            )
        return constraints_of_wheels

    def _geometry(self, actuator: ActuatorContext, about: list[int]) -> tuple[ca.SX, ca.SX]:
        """Axes (3 x n) and their pseudo-inverse (n x 3), of those parts that can turn the base."""
        context = actuator.context
        if self.pyramid is not None:
            tilt = context.parameters(f"{context.path}.pyramid.tilt_deg") * DEGREE
            across, up = ca.cos(tilt), ca.sin(tilt)
            axes, inverse = ca.SX(3, self.count), ca.SX(self.count, 3)
            for i, around in enumerate(self.pyramid.directions()):
                for row, part in enumerate(around):
                    if part:
                        axes[row, i] = across * part
                        inverse[i, row] = 2 * part / (self.count * across)
                axes[2, i], inverse[i, 2] = up, 1 / (self.count * up)
        else:
            vectors = [
                context.parameters.sparse_vector(f"{context.path}.axes.{i}") for i in range(self.count)
            ]
            axes = ca.horzcat(*(vector / ca.norm_2(vector) for vector in vectors))
            inverse = ca.SX(self.count, 3)
            inverse[:, about] = pseudo_inverse(axes[about, :])
        return context.once("axes", axes), context.once("shares", inverse)

    def faults(self, robot: RobotProperties) -> Iterable[tuple[str, str]]:
        """Axes across which a planar base cannot turn."""
        yield from self.wrong_wheels(self.count)
        if robot.base != "planar":
            return
        tilted = [i for i, axis in enumerate(self.axes) if axis[0] or axis[1]]
        if self.pyramid is not None:
            yield "pyramid", "a planar base turns about z alone; give `axes: [[0, 0, 1]]`"
        elif tilted:
            yield f"axes.{tilted[0]}", "a planar base turns about z alone, so its wheels' axes are [0, 0, 1]"

    def assumptions(self) -> list[str]:
        """Mass properties of the wheels that the root link includes."""
        return ["mass of the wheels, and their inertia across their axes, are part of the root link's"]

    def words(self) -> str:
        """The wheels and their limits."""
        shape = f" in a pyramid tilted by {self.pyramid.tilt_deg:g} deg" if self.pyramid else ""
        wheels = f"{self.count} reaction wheel{'s' * (self.count > 1)}{shape}"
        return f"{wheels}, {self.inertia:g} kg m^2, {self.within()}"
