"""Thrusters of a floating base: throttled or pulsed.

The wrench commanded of the base is allocated to them with minimum propellant
(:mod:`spacerobot.elements.actuators.allocation`). Pulsed thrusters are allocated once per period: the
fraction of thrust becomes an on-time from the start of the period. The end of that time is an event, so steps
end there and derivatives go through it.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import casadi as ca
import numpy as np
from pydantic import AfterValidator, Field, model_validator

from spacerobot.common.arrays import Array
from spacerobot.common.section import MAX_SAMPLES, Name, Section, Vector, quantity
from spacerobot.dynamics.algebra import cross
from spacerobot.elements.actuators.actuator import FIRING, Actuator
from spacerobot.elements.actuators.allocation import ThrusterLayout, allocate, largest_box, steps_needed
from spacerobot.elements.actuators.saturation import saturation_events
from spacerobot.elements.actuators.thruster_detection import MODES, ThrusterDetection, ThrusterTest
from spacerobot.elements.core.clock import Clock
from spacerobot.elements.core.context import ActuatorContext, once_for_each
from spacerobot.elements.core.contribution import (
    ActuatorDrive,
    Contribution,
    Output,
    PowerTerm,
    State,
    memory,
)
from spacerobot.elements.core.event import Event, either
from spacerobot.elements.core.failure import AllocatedFailure, failing
from spacerobot.elements.core.registry import register
from spacerobot.elements.core.robot_element import Part, RobotProperties

GRAVITY = 9.80665
"""Standard gravity [m/s^2], the factor between specific impulse [s] and exhaust velocity [m/s]."""
WHOLE = 1 - 1e-9
"""Fraction of thrust above which a pulse lasts the whole period."""
SHUT = 1e-9
"""Fraction of thrust below which a throttled thruster is shut."""


def _not_zero(value: Vector) -> Vector:
    if not any(value):
        raise ValueError("a direction is required, not all zeros")
    return value


class StuckValve(AllocatedFailure):
    """Stuck valve of a thruster; if the failure is known, other thrusters compensate its force."""

    opening: float = quantity(
        "1", "part of the thrust from then on; 0: shut, 1: open, between: it leaks", default=0.0, ge=0, le=1
    )


class Nozzle(Section):
    """Single thruster; missing values default to those of the whole set."""

    position: Vector = quantity("m", "point where its force acts, root link's axes")
    direction: Annotated[Vector, AfterValidator(_not_zero)] = quantity(
        "1", "of its force on the base, root link's axes, of any length; the plume goes the other way"
    )
    thrust: float | None = quantity("N", "its greatest force", default=None, gt=0)
    minimum_on_time: float | None = quantity("s", "shortest pulse", default=None, ge=0)
    resolution: float | None = quantity("s", "step of on-times", default=None, ge=0)
    specific_impulse: float | None = quantity("s", "specific impulse", default=None, gt=0)
    failure: StuckValve | None = Field(default=None, description="its valve sticks, `at` a time")


class Unload(Section):
    """Unloading of wheels: thrusters turn the base, and the wheels, which turn it back, lose momentum."""

    rate: float = quantity("1/s", "at which the wheels' momentum goes to its goal", gt=0)
    goal: Vector = quantity(
        "N m s", "momentum of the wheels together, root link's axes", default=(0.0, 0.0, 0.0)
    )


@register
class Thrusters(Actuator):
    """Thrusters on the base, throttled or pulsed; deliver the commanded wrench with minimum propellant."""

    base_wrench: ClassVar[frozenset[Part]] = frozenset({"force", "torque"})

    kind: Literal["thrusters"] = "thrusters"
    nozzles: dict[Name, Nozzle] = Field(
        min_length=1, description="each `position`, `direction`, and what differs from the set, by name"
    )
    mode: Literal["proportional", "pulsed"] = Field(
        default="proportional",
        description="proportional: throttled from nothing to full thrust; pulsed: full thrust, for a part of "
        "each period",
    )
    thrust: float = quantity("N", "maximum force of each", default=1.0, gt=0)
    period: float = quantity(
        "s", "time between two decisions in pulsed mode", default=0.5, gt=0, recurs=MAX_SAMPLES
    )
    minimum_on_time: float = quantity(
        "s", "shortest pulse; half of it and more is given as the whole", default=0.0, ge=0
    )
    resolution: float = quantity("s", "step of on-times; 0: any", default=0.0, ge=0)
    specific_impulse: float = quantity("s", "impulse by weight of propellant", default=220.0, gt=0)
    unload: Unload | None = Field(
        default=None,
        description="unload the robot's wheels instead of delivering the commanded torque, which is left to "
        "later actuators: the wheels",
    )
    detection: ThrusterDetection | None = Field(
        default=None,
        description="detect failed thrusters from the robot's momentum, and allocate without them",
    )
    steps: int | None = Field(
        default=None,
        ge=1,
        le=1000,
        description="maximum number of steps by which the thrusters are chosen [1]; as many as their layout "
        "needs where not given",
    )

    @model_validator(mode="after")
    def _check(self) -> Thrusters:
        if self.mode != "pulsed":
            return self
        for path, part in {
            "": self,
            **{f"nozzles.{name}.": nozzle for name, nozzle in self.nozzles.items()},
        }.items():
            for key in ("minimum_on_time", "resolution"):
                value = getattr(part, key)
                if value is not None and value > self.period:
                    raise ValueError(
                        f"{path}{key}: found {value:g} s, allowed: at most the `period` of "
                        f"{self.period:g} s, at whose beginning on-times are decided"
                    )
        return self

    def wrench_limits(self, *, planar: bool) -> Mapping[Part, Array]:
        """Largest box of wrenches, with sides in the ratio of the maximum on each axis alone."""
        if self.unloads:
            return {}
        pushes = list[Array]()
        for nozzle in self.nozzles.values():
            line = np.array(nozzle.direction) / np.linalg.norm(nozzle.direction)
            push = (self.thrust if nozzle.thrust is None else nozzle.thrust) * line
            pushes.append(np.concatenate([push, np.cross(nozzle.position, push)]))
        box = largest_box(np.array(pushes).T, [0, 1, 5] if planar else range(6))
        return {"force": box[:3], "torque": box[3:]}

    def joined_limits(self, limits: Array, after: Array) -> Array:
        """Sum of both limits for throttled thrusters.

        Own limits for pulsed ones, which leave no command over.
        """
        return limits + after if self.mode == "proportional" else limits

    def build(self, actuator: ActuatorContext) -> Contribution:
        """Contribution: external wrench, propellant, and events of pulses."""
        jets, columns = _Jets(self, actuator), actuator.base_columns
        if self.mode == "proportional":
            return Contribution(
                drives=(ActuatorDrive(columns, jets.left, jets.throttled, passes_on=columns),)
            )
        if self.unloads:
            return Contribution(
                drives=(ActuatorDrive(columns, jets.less_pulses, jets.pulsed, passes_on=columns),)
            )
        return Contribution(
            drives=(ActuatorDrive(columns, lambda command: ca.SX(*command.shape), jets.pulsed),)
        )

    @property
    def unloads(self) -> bool:
        """Whether it unloads wheels."""
        return self.unload is not None

    @property
    def sees_wheels(self) -> bool:
        """Whether it unloads wheels, or tests the robot's momentum including that of its wheels."""
        return self.unloads or self.detection is not None

    def faults(self, robot: RobotProperties) -> Iterable[tuple[str, str]]:
        """Nozzles that push a planar base out of its plane."""
        for name, nozzle in self.nozzles.items():
            if robot.base == "planar" and nozzle.direction[2]:
                yield (
                    f"nozzles.{name}.direction",
                    f"found {nozzle.direction[2]:g} along z; the base moves in its x-y plane alone",
                )

    def cautions(self, robot: RobotProperties) -> Iterable[str]:
        """Warnings about wrench components that no combination of nozzles delivers."""
        from scipy.optimize import nnls  # takes time to load, and a run without thrusters needs none of it

        rows = {"force along x": 0, "force along y": 1, "torque about z": 5}
        if robot.base != "planar":
            rows = {"force along z": 2, "torque about x": 3, "torque about y": 4} | rows
        lines = []
        for nozzle in self.nozzles.values():
            along = np.array(nozzle.direction) / np.linalg.norm(nozzle.direction)
            lines.append(np.r_[along, np.cross(nozzle.position, along)][sorted(rows.values())])
        matrix = np.array(lines).T
        for component, row in sorted(rows.items(), key=lambda item: item[1]):
            unit = (np.array(sorted(rows.values())) == row).astype(float)
            lacking = [sign for sign in (1, -1) if nnls(matrix, sign * unit)[1] > 1e-6]
            if lacking:
                way = (
                    " either way" if len(lacking) == 2 else f" in the {'+' if lacking[0] > 0 else '-'} sense"
                )
                yield f"no combination of its nozzles gives a {component} alone{way}"

    def assumptions(self) -> list[str]:
        """Assumption on the mass of propellant."""
        return ["the propellant that thrusters spend is counted, but the robot's mass stays as it is"]

    def words(self) -> str:
        """Number of thrusters, and their thrust."""
        return f"{len(self.nozzles)} thrusters, {self.mode}, of {self.thrust:g} N"


@dataclass(frozen=True)
class _Jets:
    """The thrusters of one base as expressions."""

    config: Thrusters
    actuator: ActuatorContext

    @property
    def name(self) -> str:
        """The set's."""
        return f"{self.actuator.robot}/{self.actuator.context.path.rpartition('.')[2]}"

    def number(self, name: str, key: str) -> ca.SX:
        """Number of one nozzle (1x1), from its own section or the set's; exact zeros are structural."""
        path, nozzle_value = self.actuator.context.path, getattr(self.config.nozzles[name], key)
        where = key if nozzle_value is None else f"nozzles.{name}.{key}"
        return self.actuator.context.parameters.sparse(f"{path}.{where}")

    def numbers(self, key: str) -> ca.SX:
        """A number of each nozzle (n x 1), once computed."""
        values = ca.vertcat(*(self.number(name, key) for name in self.config.nozzles))
        return self.actuator.context.once(f"all.{key}", values)

    def vectors(self, key: str) -> list[ca.SX]:
        """A vector of each nozzle (3x1 each), root link's axes, an expression of the parameters."""
        path = self.actuator.context.path
        parameters = self.actuator.context.parameters
        return [parameters.sparse_vector(f"{path}.nozzles.{name}.{key}") for name in self.config.nozzles]

    @functools.cached_property
    def pushes(self) -> list[ca.SX]:
        """Forces at full thrust (3x1 each), root link's axes, expressions of the parameters."""
        thrusts = [self.number(name, "thrust") for name in self.config.nozzles]
        lines = [ca.sparsify(line / ca.norm_2(ca.densify(line))) for line in self.vectors("direction")]
        return [thrust * line for thrust, line in zip(thrusts, lines, strict=True)]

    @functools.cached_property
    def full(self) -> ca.SX:
        """Force, then torque about the root link's origin, of each at full thrust (6 x n), its axes."""
        levers = self.vectors("position")
        wrenches = [
            ca.vertcat(push, cross(lever, push)) for lever, push in zip(levers, self.pushes, strict=True)
        ]
        return self.actuator.context.once("full", ca.sparsify(ca.horzcat(*wrenches)))

    @functools.cached_property
    def rows(self) -> list[int]:
        """Rows of a wrench (fx fy fz tx ty tz) that correspond to the base's columns."""
        return [0, 1, 5] if len(self.actuator.base_columns) == 3 else list(range(6))

    @functools.cached_property
    def layout(self) -> tuple[ThrusterLayout, ca.SX, int]:
        """Scaled layout, scales of its rows, and maximum number of allocation steps.

        The first two computed once.
        """
        context = self.actuator.context
        wrench_rows = context.constants.expanded(self.full)[self.rows, :]
        sizes = ca.sqrt(ca.densify(ca.sum2(wrench_rows * wrench_rows)))
        scales = ca.if_else(sizes > 0, 1 / sizes, 0)
        matrix = ca.sparsify(ca.mtimes(ca.diag(scales), wrench_rows))
        flows = context.constants.expanded(self.flows)
        layout = ThrusterLayout.of(matrix, flows)
        squares = [context.once(f"layout.square.{i}", square) for i, square in enumerate(layout.squares)]
        hoisted = ThrusterLayout(
            context.once("layout.matrix", matrix), context.once("layout.gains", layout.gains), tuple(squares)
        )
        numbers = context.parameters.nominal
        steps = self.config.steps or steps_needed(numbers(matrix), numbers(flows))
        return hoisted, context.once("layout.scales", scales), steps

    @functools.cached_property
    def flows(self) -> ca.SX:
        """Propellant that each spends at full thrust (n x 1) [kg/s]."""
        return self.numbers("thrust") / (GRAVITY * self.numbers("specific_impulse"))

    @functools.cached_property
    def throttles(self) -> Callable[[ca.SX], ca.SX]:
        """Function from the command to the commanded throttles (n x 1)."""
        text = "parts of full thrust commanded of the valves"

        @once_for_each
        def throttles(command: ca.SX) -> ca.SX:
            return self.actuator.command_port(self.name, "1", text, self.parts(command))

        return throttles

    def parts(self, command: ca.SX) -> ca.SX:
        """Fractions of full thrust (n x 1) that best match the command, with minimum propellant."""
        layout, scales, steps = self.layout
        out, stuck_parts = self.failed
        wrench = self.wanted(command)
        if out.nnz():
            ready, wrench = 1 - out, wrench - ca.mtimes(self.full[self.rows, :], stuck_parts)
            matrix, gains = (ca.mtimes(side, ca.diag(ready)) for side in (layout.matrix, layout.gains))
            squares = tuple(part * ready[i] for i, part in enumerate(layout.squares))
            layout = ThrusterLayout(matrix, gains, squares)
        return allocate(layout, scales * wrench, steps)

    @functools.cached_property
    def failed(self) -> tuple[ca.SX, ca.SX]:
        """Mask of the thrusters known to have failed, and the parts of thrust they give (n x 1 each)."""
        context, count = self.actuator.context, len(self.config.nozzles)
        out, stuck_parts = ca.SX(count, 1), ca.SX(count, 1)
        for i, (name, nozzle) in enumerate(self.config.nozzles.items()):
            if nozzle.failure is not None and nozzle.failure.known:
                valve = context.at(f"{context.path}.nozzles.{name}.failure")
                out[i] = valve.switch("failed")
                stuck_parts[i] = out[i] * valve.number("opening")
        if self.test is not None:
            for mode, part in MODES.items():
                for i, detected in enumerate(self.test.switches(mode)):
                    stuck_parts[i] += (1 - out[i]) * detected * part
                    out[i] = either(out[i], detected)
        return out, stuck_parts

    @functools.cached_property
    def test(self) -> ThrusterTest | None:
        """Test of whether they have failed."""
        if self.config.detection is None:
            return None
        names = [f"{self.name}.{name}" for name in self.config.nozzles]
        full = self.full[self.rows, :]
        return ThrusterTest(self.config.detection, self.actuator, names, full, self.rows)

    def wanted(self, command: ca.SX) -> ca.SX:
        """Wrench for the allocation: the command, or its force and the torque that unloads the wheels."""
        if not self.config.unloads:
            return command
        actuator = self.actuator
        section = actuator.context.at(f"{actuator.context.path}.unload")
        turns = [row - 3 for row in self.rows if row > 2]
        rotation = actuator.plant.placement(actuator.base_frame)[0]
        over = ca.mtimes(rotation.T, actuator.wheels) - section.vector("goal")
        return ca.vertcat(command[: len(self.rows) - len(turns)], -section.number("rate") * over[turns])

    def left(self, command: ca.SX) -> ca.SX:
        """Generalized forces that throttled thrusters leave to the next actuator."""
        return command - ca.mtimes(self.full[self.rows, :], self.expected(self.throttles(command)))

    def expected(self, parts: ca.SX) -> ca.SX:
        """Parts of their thrust that they give (n x 1), of those commanded, as far as is known."""
        out, stuck_parts = self.failed
        return (1 - out) * parts + stuck_parts if out.nnz() else parts

    def less_pulses(self, command: ca.SX) -> ca.SX:
        """Generalized forces that pulsed thrusters leave to the next actuator."""
        return command - ca.mtimes(self.full[self.rows, :], self.expected(ca.vertcat(*self.firing)))

    @functools.cached_property
    def firing(self) -> list[ca.SX]:
        """Switch of each (1x1): it is on."""
        return [self.actuator.context.switch(f"{FIRING}.{name}") for name in self.config.nozzles]

    def throttled(self, command: ca.SX) -> Contribution:
        """Throttled thrusters, with events where one shuts, opens or reaches full thrust."""
        parts, names = self.throttles(command), [f"{self.name}.{name}" for name in self.config.nozzles]
        acting = self._acting(parts)
        shut = saturation_events(self.actuator, names, SHUT - parts, side="_shut")
        full = saturation_events(self.actuator, names, parts - (1 - SHUT), side="_full")
        return dataclasses.replace(acting, events=(*acting.events, *shut, *full))

    def pulsed(self, command: ca.SX) -> Contribution:
        """Pulsed thrusters: full thrust for times decided at the start of each period."""
        context, names = self.actuator.context, list(self.config.nozzles)
        firing = self.firing
        period = context.steady("period")
        clock = Clock.of(f"{self.name}.decisions", context.time, period)
        off_at = memory(f"{self.name}.off_at", ca.SX(len(names), 1))
        part = self.parts(command)
        # realisable on-times (n x 1) [s] next to the commanded ones
        shortest, step = self.numbers("minimum_on_time"), self.numbers("resolution")
        times = []
        for i, time in enumerate(ca.vertsplit(part * period)):
            on_time = step[i] * ca.floor(time / step[i] + 0.5) if step[i].nnz() else time
            if shortest[i].nnz():
                on_time = ca.if_else(time < shortest[i] / 2, 0, ca.fmax(on_time, shortest[i]))
            times.append(on_time)
        on_times = ca.vertcat(*times)
        # a thruster on for the whole period is not switched off at its end; the next decision applies
        until = clock.instant + ca.if_else(part < WHOLE, on_times, 2 * period)
        sets = {switch.name(): True for switch in firing}
        steps = bool(self.numbers("resolution").nnz())
        updates, name = {off_at.name: until}, f"{self.name}.control"
        decision = clock.event(
            name, "control", self.name, updates, sets, routine=True, quantised=steps, onboard=True
        )
        events = [decision]
        for i, (name, switch) in enumerate(zip(names, firing, strict=True)):
            label = f"{self.name}.{name}"
            over = context.time - off_at.symbol[i]
            off = {switch.name(): False}
            events.append(Event(f"{label}.cut", "cut", label, over, switch, off, routine=True, onboard=True))
        acting = self._acting(ca.vertcat(*firing))
        return Contribution(
            states=(*acting.states, clock.count, off_at),
            outside=acting.outside,
            powers=acting.powers,
            outputs=acting.outputs,
            events=(*acting.events, *events),
        )

    def _acting(self, parts: ca.SX) -> Contribution:
        """Wrench, power, propellant and outputs of thrusters at commanded fractions of thrust (n x 1)."""
        actuator, expected = self.actuator, self.expected(parts)
        tests = Contribution() if self.test is None else self.test.contribution(expected)
        # fractions of thrust delivered by failed valves (n x 1), and when they apply
        context, thrust_parts, failures = actuator.context, ca.vertsplit(parts), list[Event]()
        for i, (name, nozzle) in enumerate(self.config.nozzles.items()):
            if nozzle.failure is None:
                continue
            valve = context.at(f"{context.path}.nozzles.{name}.failure")
            failed, event = failing(valve, f"{self.name}.{name}")
            failures.append(event)
            thrust_parts[i] = (1 - failed) * thrust_parts[i] + failed * valve.number("opening")
        parts = ca.vertcat(*thrust_parts)
        rotation, origin = actuator.plant.placement(actuator.base_frame)
        velocity, spin = actuator.plant.velocity(actuator.base_frame)
        wrench = ca.SX(6, 1)
        wrench[self.rows] = ca.mtimes(self.full[self.rows, :], parts)
        force, torque = (ca.sparsify(ca.mtimes(rotation, part)) for part in (wrench[:3], wrench[3:]))
        flow = ca.dot(self.flows, parts)
        spent = ca.SX.sym(f"{self.name}.propellant")
        power = ca.dot(force, velocity) + ca.dot(torque, spin)
        text = "propellant that thrusters have spent"
        outputs = [Output("propellant", spent, "kg", text, "body", actuator.robot)]
        levers = [actuator.context.once(f"lever.{i}", v) for i, v in enumerate(self.vectors("position"))]
        for i, name in enumerate(self.config.nozzles):
            label = f"{self.name}.{name}"
            push = ca.mtimes(rotation, self.full[:3, i]) * parts[i]
            at = origin + ca.mtimes(rotation, levers[i])
            outputs += [
                Output("thruster_force", push, "N", "forces of thrusters", "thruster", label),
                Output(
                    "thruster_position", at, "m", "where thrusters push", "thruster", label, plotted=False
                ),
            ]
        return Contribution(
            states=(State(f"{self.name}.propellant", spent, ca.SX.zeros(1), flow), *tests.states),
            outside=(actuator.on_base(force=force, torque=torque),),
            powers=(PowerTerm("thruster", power, "in"),),
            outputs=(*outputs, *tests.outputs),
            events=(*failures, *tests.events),
        )
