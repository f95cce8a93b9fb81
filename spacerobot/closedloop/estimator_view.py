"""View of a robot in the closed loop for its estimators."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from spacerobot.closedloop.loop_parts import Sample
from spacerobot.closedloop.robot_sensors import HeldReader, RobotSensors
from spacerobot.elements import Contribution, EstimatorContext, SectionContext, either
from spacerobot.elements.core.contribution import Innovation
from spacerobot.elements.estimators.estimator import TargetModel
from spacerobot.elements.sensors.measurement import Measurement, Observation, attitude_of
from spacerobot.elements.sensors.sensor import measured
from spacerobot.elements.sensors.signals import BODY_AXES
from spacerobot.scenario import Robot
from spacerobot.scenario.sensors import Sensors
from spacerobot.scene import SceneBody
from spacerobot.scene.target_model import target_model
from spacerobot.symbolic import Plant


@dataclass(frozen=True)
class EstimatorView(EstimatorContext):
    """Implementation of :class:`~spacerobot.elements.EstimatorContext` over the parts of a closed loop.

    Attributes:
        robot_sensors: Sensors of the robot.
        key: Key of the estimator in the robot's section.
        earlier: Contributions of the estimators listed before this one.
    """

    robot_sensors: RobotSensors
    key: str
    earlier: Contribution

    @functools.cached_property
    def _body(self) -> SceneBody:
        return self.robot_sensors.body

    @functools.cached_property
    def _sections(self) -> Sensors:
        return self.robot_sensors.sections or Sensors()

    @functools.cached_property
    def _reader(self) -> HeldReader:
        """Reader of the controllers' signals, with the estimates of estimators before this one."""
        columns = tuple(int(self.plant.model.idx_vs[joint]) for joint in self.joints)
        estimates = dict(self.earlier.estimates)
        return HeldReader(self.robot_sensors, self.robot, self.base_frame, columns, estimates)

    @property
    def context(self) -> SectionContext:
        """Time and the numbers of the estimator's section."""
        return self.robot_sensors.parts.context.at(f"{self._body.path}.estimators.{self.key}")

    @property
    def plant(self) -> Plant:
        """Mechanics at the current state."""
        return self.robot_sensors.parts.plant

    @property
    def label(self) -> str:
        """Name of the estimator, unique in the closed loop."""
        return f"{self.robot}/{self.key}"

    @property
    def robot(self) -> str:
        """Name of the robot."""
        return self._body.name

    @property
    def base_frame(self) -> int:
        """Frame of the robot's root link in the model."""
        return self._body.root_frame

    @property
    def joints(self) -> tuple[int, ...]:
        """Ids of the robot's driven joints."""
        return self._body.driven_joints

    @property
    def tips(self) -> Mapping[str, int]:
        """Frames of the robot's tips in the model, by name."""
        tips = self.robot_sensors.parts.scene.tips
        return {tip.label.rpartition("/")[2]: tip.frame for tip in tips if tip.body is self._body}

    @functools.cached_property
    def target(self) -> TargetModel | None:
        """Rigid-body model of the target; None without a floating target."""
        return target_model(self.robot_sensors.parts.scene)

    @property
    def attitude(self) -> ca.SX:
        """Attitude of the base at the start (3x3)."""
        return self.robot_sensors.parts.start.placement(self.base_frame)[0]

    def errors(self, signal: str) -> SectionContext:
        """Context of the section ``errors`` of a signal's sensor."""
        return self.robot_sensors.parts.context.at(f"{self._body.path}.sensors.{signal}.errors")

    def sample(
        self,
        signal: str,
        value: ca.SX,
        axes: tuple[int, ...],
        carrier: ca.SX | None = None,
        away: tuple[ca.SX, ca.SX] | None = None,
    ) -> Measurement:
        """Samples of one signal, with the errors of its sensor."""
        context = self.robot_sensors.parts.context.at(f"{self._body.path}.sensors.{signal}")
        sensor, attitude = self._sections[signal], None
        true, origin = value, None if away is None else away[0][list(axes)]
        value = sensor.aligned(context, value, carrier)
        if value.size2() == 3:
            value, attitude = ca.SX(3, 1), value
            origin = context.once("start", self.attitude) if carrier is None else carrier
        reading = measured(sensor.affine(context), value)
        if away is not None and attitude is None:
            reading = reading + away[0]
        full_reading, reading = reading, ca.densify(reading[list(axes)])
        observed = Observation(reading, away[1] if away else None, attitude, origin, stamped=True)
        name = f"{self.label}.{signal}"
        measurement = sensor.measurement(name, context, observed)
        assert measurement is not None, "scenes are refused whose filters lack a measurement"
        self.robot_sensors.parts.measurements[name] = measurement
        last = measurement.known[:-1]
        if attitude is None:
            last, full_reading[list(axes)] = full_reading, last
        self._show(signal, last, true, of_body=carrier is not None and carrier.is_eye())
        return measurement

    def _show(self, signal: str, last: ca.SX, true: ca.SX, *, of_body: bool) -> None:
        """Register a sample for the outputs, unless controllers sample the signal themselves.

        Args:
            signal: Name of the signal.
            last: Vector (3x1), or attitude as numbers (4x1 or 2x1).
            true: Present value of the signal, a vector (3x1) or an attitude (3x3).
            of_body: Whether the vector is in the axes of the link that carries the sensor.
        """
        assert isinstance(self._body.config, Robot)
        body, dimension, label = self._body, "body", self.robot
        if signal.startswith("target_"):
            frames, target = (
                self._body.config.estimators[self.key].frames(),
                self.robot_sensors.parts.scene.target,
            )
            assert frames is not None, "an estimator that sees the target names a tip"
            assert target is not None, "scenes without a target are refused"
            body, dimension, label = target, "tip", f"{self.robot}/{frames[0]}"
        if true.size2() == 3:
            # the measured frame is fixed in the root link, whose attitude follows
            root = self.plant.placement(body.root_frame)[0]
            last = ca.mtimes(attitude_of(last), ca.mtimes(true.T, root))
        sample = Sample(f"{signal}{BODY_AXES * of_body}", dimension, label, last, body.name)
        self.robot_sensors.parts.samples.setdefault((sample.signal, label), sample)

    def positions(self, driven: ca.SX) -> Mapping[int, ca.SX]:
        """Positions of all joints by id, from the driven joints' positions (n x 1) [rad or m]."""
        return self._body.positions(driven)

    def read(self, signal: str, value: ca.SX) -> ca.SX:
        """Last estimate or sample of a signal, or the present reading of a continuous sensor (n x 1)."""
        last = self._reader(signal, value)
        return measured(self.robot_sensors.affine(signal), value) if last is None else last

    def delay_s(self, signal: str) -> float:
        """Delay of a signal that is read [s]; zero of one that is estimated."""
        errors = self._sections[signal].errors
        return 0.0 if errors is None or signal in dict(self.earlier.estimates) else errors.delay

    def holds(self, tip: str, link: str) -> ca.SX:
        """Switch (1x1): nonzero while one of the grasps of a tip and a link of the target is closed."""
        parts, label = self.robot_sensors.parts, f"{self.robot}/{tip}"
        _ = parts.grasps  # building them makes their switches
        grasps = [g for g in parts.scene.grasps if g.tip.label == label and g.config.frame == link]
        return either(*(parts.grasp_switch(grasp.name, "closed") for grasp in grasps))

    def stored_momentum(self) -> ca.SX:
        """Angular momentum (3x1) of the robot's wheels, world axes [N m s]."""
        contributions = self.robot_sensors.parts.actuators(self._body)
        stored = [part.stored for part in contributions]
        return sum((wheel.angular for part in stored for wheel in part), ca.SX(3, 1))

    def innovations(self, key: str) -> Sequence[Innovation]:
        """Innovations of an earlier estimator of the robot, by its key."""
        return [one for one in self.earlier.innovations if one.filter == f"{self.robot}/{key}"]

    def rejected(self, signal: str) -> ca.SX:
        """Switch (1x1): nonzero once a monitor has detected a failure of the sensor for this estimator."""
        assert isinstance(self._body.config, Robot)
        estimators = self._body.config.estimators
        monitors = sorted(name for name, one in estimators.items() if one.rejects() == (self.key, signal))
        switch = self.robot_sensors.parts.context.constants.switch
        return either(*(switch(f"{self._body.path}.estimators.{name}.detected") for name in monitors))

    def base_impulse(self) -> ca.SX:
        """Impulse (6x1) that the actuators of the robot's base have delivered since the start.

        Linear, and angular about the world's origin [N s, N m s].
        """
        assert isinstance(self._body.config, Robot)
        impulse = ca.SX(6, 1)
        if any(actuator.base_wrench for _, actuator in self._body.config.driven_by()):
            axes = [*self.plant.translation_axes, *(axis + 3 for axis in self.plant.rotation_axes)]
            symbol = ca.SX.sym(f"{self.robot}.pushed", len(axes))
            impulse[axes] = self.robot_sensors.parts.pushed.setdefault(self._body.root_joint, symbol)
        return impulse
