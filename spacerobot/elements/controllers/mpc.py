"""Model predictive control: the plan is recomputed from measurements in each period and tracked meanwhile.

Joints track the plan as in :mod:`spacerobot.elements.controllers.joint_plan`. A planned base tracks it as in
:mod:`spacerobot.elements.controllers.base_plan`, with measured velocity and spin.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Literal, Self

import casadi as ca
import numpy as np
from pydantic import Field, model_validator

from spacerobot.common.errors import ScenarioError
from spacerobot.common.section import MAX_PLANS, quantity
from spacerobot.elements.controllers.base_plan import planned_parts, planned_wrench
from spacerobot.elements.controllers.controller import MPC_INPUT, Replanning
from spacerobot.elements.controllers.joint_plan import JointPlanController
from spacerobot.elements.controllers.measurements import robot_values, target_readings
from spacerobot.elements.core.context import RobotContext
from spacerobot.elements.core.contribution import CommandedTorque, Contribution, Output
from spacerobot.elements.core.registry import register
from spacerobot.elements.core.robot_element import Part, RobotProperties
from spacerobot.elements.references.knot_motion import Knots
from spacerobot.elements.references.plan_following import BaseMotion
from spacerobot.elements.sensors.signals import SIGNALS

HELD_UNITS = {
    "held_mass": "kg",
    "held_first_moment": "kg m",
    "held_moments": "kg m^2",
    "held_products": "kg m^2",
}


@register
class Mpc(JointPlanController):
    """Joints and base track a plan that is recomputed in each period for the remaining time (MPC)."""

    kind: Literal["mpc"] = "mpc"
    file: None = Field(default=None, description="none: plans are made in flight")
    phase: None = Field(default=None, description="none: plans are of one phase")
    period: float = quantity("s", "time between two plans", default=0.5, gt=0, recurs=MAX_PLANS)
    min_horizon: float = quantity(
        "s", "minimum horizon of a plan; the last plan before the end is continued", default=1.0, gt=0
    )
    delay: float = quantity(
        "s",
        "time from the measurements to the start of the plan that is computed from them",
        default=0.0,
        ge=0,
    )
    iterations: int = Field(default=60, ge=1, description="of the solver, at most, for a plan in flight")
    kd_linear: float = quantity("N s/m", "gain of the base's velocity", default=0.0, ge=0)
    kd_angular: float = quantity("N m s/rad", "gain of the base's spin", default=0.0, ge=0)
    base_knots: BaseMotion | None = Field(
        default=None, description="points of the planned trajectory of the base; filled in by the simulation"
    )
    begin: float = quantity("s", "when the plan in `knots` begins", default=0.0, ge=0)
    signals: tuple[str, ...] = Field(default=(), description="none: filled in by the simulation")
    frames: dict[str, str] = Field(default={}, description="none: filled in by the simulation")

    @model_validator(mode="after")
    def _check_plan(self) -> Self:
        """Check that a plan is ready before the next one is started; knots come from plans in flight."""
        if self.delay > self.period:
            raise ValueError(f"delay: found {self.delay:g} s, allowed: at most the period, {self.period:g} s")
        return self

    @property
    def update_scheme(self) -> str:
        """Plans are made in Python."""
        return "optim.planning.mpc.updates:MpcScheme"

    @property
    def replanning(self) -> Replanning:
        """Once in each period."""
        tables = dict[str, tuple[int, int]]()
        if self.knots is not None:
            sizes = len(self.knots.times), len(self.knots.joints)
            tables |= {f"knots.{name}": sizes for name in ("position", "rate", "effort")}
        if self.base_knots is not None:
            sizes = len(self.base_knots.times), len(self.base_knots.axes)
            tables |= {f"base_knots.{name}": sizes for name in ("wrench", "rate")}
        return Replanning(self.period, self.min_horizon, self.delay, self.iterations, tables)

    @property
    def own_wrench(self) -> frozenset[Part]:
        """Force, torque or both, by the axes of the base that the plan drives."""
        return frozenset() if self.base_knots is None else planned_parts(self.base_knots)

    def build(self, robot: RobotContext) -> Contribution:
        """Contribution: torques of the joints and wrench on the base by the plan of the present period.

        Raises:
            ScenarioError: If there is no plan.
        """
        motion = self.knots or self.base_knots
        if motion is None:
            raise ScenarioError(
                "kind mpc solves a plan in each period, which has no gradient: simulations, batches and "
                "campaigns do it, gradients and searches do not; there, follow a plan by joint_tracking",
                where=robot.context.path,
            )
        times, begin = np.array(motion.times), robot.context.number("begin")
        knots = Knots.at(robot.context, times, motion.points, begin=begin)
        torques = list[CommandedTorque]()
        if self.knots is not None:
            torques.append(self.joint_torques(robot, knots))
        if self.base_knots is not None:
            velocity = self._base_velocity(robot)
            torques.append(planned_wrench(robot, self.base_knots, knots, "base_knots", velocity))
        events = () if knots.event is None else (knots.event,)
        return Contribution(torques=tuple(torques), events=events, outputs=tuple(self._inputs(robot)))

    def _base_velocity(self, robot: RobotContext) -> ca.SX:
        """Measured velocity and spin of the base (3 or 6 x 1), root link's axes.

        Readings are in world axes; the base's true attitude rotates them to the root link.
        """
        plant = robot.plant
        first, size = (int(of[robot.base_joint]) for of in (plant.model.idx_vs, plant.model.nvs))
        if not {"base_velocity", "base_spin"} & set(self.signals):
            return plant.v[first : first + size]
        inverse, values = plant.placement(robot.base_frame)[0].T, robot_values(robot)
        velocity, spin = (
            ca.mtimes(inverse, robot.read(signal, values[signal]))
            for signal in ("base_velocity", "base_spin")
        )
        return ca.vertcat(velocity[:2], spin[2]) if size == 3 else ca.vertcat(velocity, spin)

    def _inputs(self, robot: RobotContext) -> Iterator[Output]:
        """Measured and estimated initial states of plans, of the signals named in ``signals``.

        Attitudes are rotation vectors from the initial attitudes. A tip's measurement of a mating frame is
        converted to world axes at the instant of the measurement.
        """
        values = robot_values(robot)
        for signal in (each for each in self.signals if each in values):
            reading = robot.read(signal, values[signal])
            if not signal.startswith("joint"):
                yield _output(signal, reading, "body", robot.name)
                continue
            for name, value in zip(robot.joint_names, ca.vertsplit(reading), strict=True):
                yield _output(signal, value, "driven_joint", f"{robot.name}/{name}")
        for tip in robot.tips:
            if tip.held_inertia is not None:
                mass, moment, (xx, xy, yy, xz, yz, zz) = (
                    tip.held_inertia[0],
                    tip.held_inertia[1:4],
                    ca.vertsplit(tip.held_inertia[4:]),
                )
                yield _output("held_mass", mass, "tip", tip.label)
                yield _output("held_first_moment", moment, "tip", tip.label)
                yield _output("held_moments", ca.vertcat(xx, yy, zz), "tip", tip.label)
                yield _output("held_products", ca.vertcat(xy, xz, yz), "tip", tip.label)
        for tip in (tip for tip in robot.tips if tip.label in self.frames):
            tip_values = target_readings(robot, tip, self.frames[tip.label])
            for signal in (each for each in self.signals if each in tip_values):
                yield _output(signal, tip.read(signal, *tip_values[signal]), "tip", tip.label)

    @property
    def begins(self) -> float:
        """Start time of the plan [s]."""
        return self.begin

    def faults(self, robot: RobotProperties) -> Iterable[tuple[str, str]]:
        """Errors: joints of the plan that the robot lacks, or the reverse; none without a plan."""
        return () if self.knots is None else super().faults(robot)

    def cautions(self, robot: RobotProperties) -> Iterable[str]:
        """No warnings: each plan starts at the robot's present state."""
        del robot
        return ()

    def reads(self) -> set[str]:
        """Signals of the joints, and those of base and target from which plans start."""
        signals = ("position", "velocity", "orientation", "spin")
        return super().reads() | {f"{frame}_{signal}" for frame in ("target", "base") for signal in signals}

    def words(self) -> str:
        """Gains and period."""
        base = f", base {self.kd_linear:g} / {self.kd_angular:g}" if self.base_knots is not None else ""
        return f"{self.kp:g} / {self.kd:g}{base} along plans recomputed every {self.period:g} s"


def _output(signal: str, value: ca.SX, dimension: str, label: str) -> Output:
    """Measurement or estimate as an output."""
    if signal in HELD_UNITS:
        unit, text = HELD_UNITS[signal], f"{signal.replace('_', ' ')} in axes of the tip"
    else:
        unit, text = SIGNALS[signal]
    text = f"read by mpc: {text}"
    return Output(f"{MPC_INPUT}{signal}", ca.densify(value), unit, text, dimension, label)
