"""Parts of a closed loop that its elements share while they are built."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import casadi as ca

from spacerobot.elements import (
    Actuator,
    ActuatorContext,
    Contribution,
    GraspContext,
    SectionContext,
    State,
    either,
    memory,
)
from spacerobot.elements.core.context import Affine, unbroken, unported
from spacerobot.elements.grasps.capture_release import grasp_lifecycle
from spacerobot.elements.sensors.measurement import Measurement
from spacerobot.scenario import Robot
from spacerobot.scene import Scene, SceneBody, SceneGrasp
from spacerobot.symbolic import InitialState, Plant


@dataclass(frozen=True)
class Sample:
    """Last sample of a signal, or present reading of its continuous sensor.

    Attributes:
        signal: Name of the signal, with a suffix for its axes unless these are the world's.
        dimension, label: See :class:`~spacerobot.elements.Output`.
        value: Vector (3x1) or number (1x1), or attitude of the root link of a body (3x3).
        body: Name of the body whose attitude it is.
    """

    signal: str
    dimension: str
    label: str
    value: ca.SX
    body: str = ""


@dataclass(frozen=True)
class LoopParts:
    """Shared parts of one closed loop: mechanics, phases, grasps, actuators and measurements.

    Attributes:
        scene: The scene.
        context: Time, and the scenario's numbers.
        plant, start: Mechanics at the current state, and at the initial one.
        phase_states: States that phases store, by a short name.
        measurements: Sampled measurements, by name.
        samples: Readings of sensors with errors for controllers and estimators, by signal and label.
        driven: Contributions of a robot's actuators, by its name; filled by :meth:`actuators`.
        pushed: Impulses of the actuators of bases that estimators count (2 or 3 linear, 1 or 3 angular
            components), by the base's joint.
        affine: Offset and scale of each sensor that is read, by path.
        break_point: As in :class:`~spacerobot.elements.ActuatorContext`; None unless the loop is linearised.
    """

    scene: Scene
    context: SectionContext
    plant: Plant
    start: InitialState
    phase_states: dict[str, State] = field(default_factory=dict)
    measurements: dict[str, Measurement] = field(default_factory=dict)
    samples: dict[tuple[str, str], Sample] = field(default_factory=dict)
    driven: dict[str, list[Contribution]] = field(default_factory=dict)
    pushed: dict[int, ca.SX] = field(default_factory=dict)
    affine: dict[str, Affine] = field(default_factory=dict)
    break_point: Callable[[str, Sequence[str], ca.SX], ca.SX] | None = None

    @functools.cached_property
    def grasps(self) -> list[Contribution]:
        """Contributions of the grasps, in the scene's order."""
        return [grasp_lifecycle(grasp.config, self._grasp(grasp)) for grasp in self.scene.grasps]

    def grasp_switch(self, name: str, kind: Literal["closed", "released"]) -> ca.SX:
        """Switch of a grasp (1x1): nonzero while it is closed, or once it was released."""
        constants, path = self.context.constants, f"grasps.{name}.{kind}"
        return constants.switch(path) if path in constants.switches else ca.SX(kind == "closed")

    def memory(self, name: str) -> State:
        """Scalar state that phases store under a name; created on first use."""
        if name not in self.phase_states:
            self.phase_states[name] = memory(f"phase.{name}", ca.SX.zeros(1))
        return self.phase_states[name]

    def phase_time(self) -> ca.SX:
        """Time since the present phase began (1x1) [s]; since the start if there are no phases."""
        time = self.context.time
        return time - self.memory("began_at").symbol if self.context.phases else time

    def actuators(self, body: SceneBody) -> list[Contribution]:
        """Contributions of a robot's actuators, in their order.

        Actuators that need the momentum of the robot's wheels are built after the wheels.
        """
        if body.name in self.driven:
            return self.driven[body.name]
        assert isinstance(body.config, Robot)
        elements = dict(body.config.driven_by())
        contributions = {
            key: one.build(self._actuator(body, key, one))
            for key, one in elements.items()
            if not one.sees_wheels
        }
        wheels = sum((momentum for part in contributions.values() for momentum in part.wheels), ca.SX(3, 1))
        stored = sum((one.angular for part in contributions.values() for one in part.stored), ca.SX(3, 1))
        for key, one in elements.items():
            if one.sees_wheels:
                context = replace(self._actuator(body, key, one), wheels=wheels, stored=stored)
                contributions[key] = one.build(context)
        self.driven[body.name] = [contributions[key] for key in elements]
        return self.driven[body.name]

    def _actuator(self, body: SceneBody, key: str, actuator: Actuator) -> ActuatorContext:
        model = self.plant.model
        columns = {body.joint_name(model, joint): int(model.idx_vs[joint]) for joint in body.free_joints}
        owned = actuator.owns(tuple(columns))
        others = {body.joint_name(model, joint) for joint in body.owned}.difference(owned)
        others |= {body.joint_name(model, joint) for joint in body.passive}
        first = int(model.idx_vs[body.root_joint])
        return ActuatorContext(
            self.context.at(f"{body.path}.{key}"),
            self.plant,
            self.start,
            robot=body.name,
            path=body.path,
            columns={name: column for name, column in columns.items() if name not in others},
            base_frame=body.root_frame,
            base_columns=tuple(range(first, first + int(model.nvs[body.root_joint])))
            if body.root_joint
            else (),
            break_point=self.break_point or unbroken,
            command_port=self.command_port,
        )

    def command_port(self, name: str, unit: str, text: str, command: ca.SX) -> ca.SX:
        """See :class:`~spacerobot.elements.core.context.ActuatorContext`."""
        return unported(name, unit, text, command)

    def port_states(self) -> Contribution:
        """States of commands that software on board holds, once all actuators are built."""
        return Contribution()

    def _grasp(self, grasp: SceneGrasp) -> GraspContext:
        return GraspContext(
            self.context.at(grasp.path),
            self.plant,
            self.start,
            grasp.name,
            grasp.tip.frame,
            grasp.frame,
            *self._permissions(grasp.name),
        )

    def _permissions(self, name: str) -> tuple[ca.SX, ca.SX]:
        """Switches of the phases (1x1 each): nonzero while a grasp may close, and while it is released."""
        sections, switches = self.scene.scenario.phases, self.context.phases
        closes = [phase.captures is None or name in phase.captures for phase in sections.values()]
        opens = [name in phase.releases for phase in sections.values()]
        closing = either(*(switch for switch, may in zip(switches.values(), closes, strict=True) if may))
        opening = [switch for switch, may in zip(switches.values(), opens, strict=True) if may]
        return ca.SX(1) if all(closes) else closing, either(*opening) if opening else ca.SX(0)
