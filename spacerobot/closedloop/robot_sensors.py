"""Signals of a robot from its sensors and estimators, for controllers."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from spacerobot.closedloop.loop_parts import LoopParts, Sample
from spacerobot.elements.core.context import Affine
from spacerobot.elements.sensors.measurement import Measurement, Observation, changing, filled
from spacerobot.elements.sensors.sensor import ideal, measured
from spacerobot.scenario import Robot
from spacerobot.scenario.sensors import Sensors
from spacerobot.scene import SceneBody


@dataclass(frozen=True)
class RobotSensors:
    """Sensors of one robot in a closed loop; ideal where the scenario gives none.

    Attributes:
        parts: Shared parts of the closed loop.
        body: The robot.
    """

    parts: LoopParts
    body: SceneBody

    @functools.cached_property
    def sections(self) -> Sensors | None:
        """Sections of the sensors; None where every signal is ideal."""
        return self.body.config.sensors if isinstance(self.body.config, Robot) else None

    def is_exact(self, signal: str) -> bool:
        """Whether a sensor always shows the true signal: ideal, not varied, not overridden by a phase."""
        if self.sections is None:
            return True
        path, sensor = f"{self.body.path}.sensors.{signal}", self.sections[signal]
        parameters, phases = self.parts.context.parameters, self.parts.context.phases
        overridden = (
            f"phases.{phase}.{path}.{key}" in parameters
            for phase in phases
            for key in type(sensor).model_fields
        )
        return sensor.is_ideal and not parameters.varies(path) and not any(overridden)

    def affine(self, signal: str) -> Affine:
        """Offset and scale of a sensor, with one pair of constants however often it is read."""
        if self.sections is None:
            return ideal(signal)
        path = f"{self.body.path}.sensors.{signal}"
        if path not in self.parts.affine:
            self.parts.affine[path] = self.sections[signal].affine(self.parts.context.at(path))
        return self.parts.affine[path]

    def measure(self, signal: str, name: str, observed: Observation) -> Measurement | None:
        """Sampled measurement of a signal under a name; None if its sensor is continuous or ideal."""
        if self.sections is None:
            return None
        context = self.parts.context.at(f"{self.body.path}.sensors.{signal}")
        return self.sections[signal].measurement(name, context, observed)

    def reading(self, frame: int, signal: str, value: ca.SX) -> ca.SX | None:
        """Reading now of a sensor that a frame carries, of a vector in world axes (3x1); None if ideal."""
        if self.sections is None:
            return None
        context = self.parts.context.at(f"{self.body.path}.sensors.{signal}")
        axes = self.parts.plant.placement(frame)[0]
        if not signal.startswith("joint_"):
            value = self.sections[signal].aligned(context, value, axes)
        return measured(self.affine(signal), value)

    def at_motors(self, columns: Sequence[int], signal: str, value: ca.SX) -> ca.SX:
        """Positions or rates of joints (n x 1) on the motor side of their transmissions."""
        motors = {motor.column: motor for part in self.parts.actuators(self.body) for motor in part.motors}
        result = ca.SX(value)
        for i, motor in ((i, motors[column]) for i, column in enumerate(columns) if column in motors):
            result[i] = result[i] + motor.ahead if signal == "joint_position" else motor.rate
        return result


@dataclass(frozen=True)
class HeldReader:
    """Reader of signals that are sampled or estimated; all readers of one signal share its samples.

    Attributes:
        sensors: The robot's sensors.
        owner: Name under which signals of a tip or of the target are sampled: label of the tip, or name of
            the robot.
        frame: Frame in the model that carries the sensors.
        columns: Indices in v of the joints whose positions and rates are read.
        estimates: Functions from true to estimated values, by signal.
    """

    sensors: RobotSensors
    owner: str
    frame: int
    columns: Sequence[int]
    estimates: Mapping[str, Callable[[ca.SX], ca.SX]]

    def __call__(
        self, signal: str, value: ca.SX, world: ca.SX | None = None, point: ca.SX | None = None, /
    ) -> ca.SX | None:
        """Estimate or last sample of a signal; None where a continuous sensor measures at the joint."""
        parts, sections = self.sensors.parts, self.sensors.sections
        at_motors = sections is not None and sections[signal].reads_motors
        if at_motors:
            value = self.sensors.at_motors(self.columns, signal, value)
        of_tip = signal.startswith(("tip_", "target_"))
        name = f"{self.owner if of_tip else self.sensors.body.name}.{signal}"
        reading = self.sensors.reading(self.frame, signal, value)
        origin = None
        if world is not None and reading is not None:
            reading, origin = world + reading - value, world - value
        distance = None
        if signal.startswith("target_") and parts.scene.target is not None:
            places = (parts.plant.placement(each)[1] for each in (parts.scene.target.root_frame, self.frame))
            distance = ca.norm_2(ca.densify(next(places) - next(places)))
        result = None
        if signal in self.estimates:
            result = self._estimate(signal, value, world, point)
        elif reading is not None:
            result = self._sample(signal, f"{name}.{value.size1()}", reading, distance, origin)
            if not self.sensors.is_exact(signal):
                self._show(signal, reading if result is None else result)
        if at_motors and result is None:
            result = reading
        if parts.break_point is None:
            return result
        intact = value if reading is None else reading
        intact = intact if result is None else result
        entries = changing(intact)
        names = [f"{name}[{i}]" for i in range(entries.size1())]
        return filled(intact, parts.break_point("measurement", names, entries))

    def _estimate(self, signal: str, value: ca.SX, world: ca.SX | None, point: ca.SX | None) -> ca.SX:
        """Estimate of a signal; the target's velocity is that of ``point``, by default of its root link."""
        plant = self.sensors.parts.plant
        if signal == "target_velocity":
            target = self.sensors.parts.scene.target
            assert target is not None, "scenes without a target are refused"
            true = value
            if point is None:
                point, true = plant.placement(target.root_frame)[1], plant.velocity(target.root_frame)[0]
            return self.estimates[signal](point) + value - true
        # estimates of positions are positions in the world, signals are relative to the frame
        origin = plant.placement(self.frame)[1] if signal == "target_position" else ca.SX(0)
        estimate = self.estimates[signal](value + origin) - origin
        return estimate if world is None else world + estimate - value

    def _sample(
        self, signal: str, name: str, reading: ca.SX, distance: ca.SX | None, origin: ca.SX | None
    ) -> ca.SX | None:
        """Last sample of a reading from an origin; None where the sensor is continuous."""
        measurements = self.sensors.parts.measurements
        if name not in measurements:
            origin = None if origin is None else changing(reading, origin)
            observed = Observation(changing(reading), distance, origin=origin)
            sampled = self.sensors.measure(signal, name, observed)
            if sampled is not None:
                measurements[name] = sampled
        if name not in measurements:
            return None
        return filled(reading, measurements[name].known)

    def _show(self, signal: str, sample: ca.SX) -> None:
        """Register a last sample or present reading (n x 1) for the outputs."""
        body, model = self.sensors.body, self.sensors.parts.plant.model
        samples = [Sample(signal, "tip" if "/" in self.owner else "body", self.owner, sample)]
        if signal.startswith("joint_"):
            joints = {int(model.idx_vs[joint]): joint for joint in (*body.arm_joints, *body.driven_joints)}
            names = (body.joint_name(model, joints[column]) for column in self.columns)
            samples = [
                Sample(signal, "driven_joint", f"{body.name}/{name}", value)
                for name, value in zip(names, ca.vertsplit(sample), strict=True)
            ]
        elif not signal.startswith(("tip_", "target_")):
            samples = [Sample(signal, "body", body.name, sample)]
        self.sensors.parts.samples.update({(one.signal, one.label): one for one in samples})
