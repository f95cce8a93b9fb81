r"""Detection of failed joints by the residual of a momentum observer, and their brakes.

For a joint with its axis through the point o, and the bodies on one side of it,

$$ m = s\,(a_v \cdot P + a_w \cdot L_o) + J v_j, \qquad \dot m = \tau - R v_j + s\,b, $$

$$ b = (\omega \times a_v) \cdot P + (\omega \times a_w) \cdot L_o - a_w \cdot (v_o \times P), $$

where $P$ and $L_o$ are linear and angular momentum (about o) of these bodies, $a_v$ and $a_w$ the joint's
directions of velocity, $\omega$ and $v_o$ spin and velocity of the joint, $J$ the inertia of its rotor, $R$
its viscous resistance, and $s = 1$ for the bodies beyond the joint, $-1$ for those from the base on. The
joint's torque $\tau$ explains the rate of $m$. The residual

$$ \dot r = K\,(\dot m - \tau_\text{commanded} + R v_j - s\,b - r) $$

is the missing torque behind a first-order lag (De Luca and Mattone 2003; Haddadin, De Luca and
Albu-Schaeffer 2017), here with the momentum of a free-floating base in $m$. Forces on the other side of the
joint act on $m$ through the joint alone. The base side therefore needs no measurement of what the tip
holds, and the tip side none of what acts on the base. :mod:`spacerobot.elements.actuators.momentum_residual`
describes the test.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import ClassVar, Literal

import casadi as ca
from pydantic import Field, model_validator

from spacerobot.common.errors import near_names
from spacerobot.common.section import MAX_SAMPLES, matching, quantity
from spacerobot.dynamics import Inertias, forward_kinematics, momentum
from spacerobot.dynamics.algebra import cross
from spacerobot.dynamics.momentum import subtree
from spacerobot.elements.actuators.actuator import Actuator
from spacerobot.elements.actuators.joint_lock import held_joints
from spacerobot.elements.actuators.momentum_residual import (
    Momenta,
    Residual,
    continuous_residual,
    measured_velocity,
    sampled_residual,
)
from spacerobot.elements.core.clock import Clock
from spacerobot.elements.core.context import ActuatorContext
from spacerobot.elements.core.contribution import (
    ActuatorDrive,
    Contribution,
    Output,
    concatenate,
)
from spacerobot.elements.core.failure import detected_failures, detection
from spacerobot.elements.core.registry import register
from spacerobot.elements.core.robot_element import RobotProperties

NOISES = ("joint_noise", "spin_noise", "velocity_noise")


@register
class MomentumObserver(Actuator):
    """Detects failed joints from the residual of their momentum, and engages their brakes.

    It reads the torques commanded to the actuators after it and passes them on unchanged: list it after
    torque limits and before failures.
    """

    kind: Literal["momentum_observer"] = "momentum_observer"
    detects_failures: ClassVar[bool] = True
    joints: str = Field(default="*", description="joints by name; `*` matches any letters")
    side: Literal["base", "tip"] = Field(
        default="base",
        description="bodies whose momentum is observed; base: those from the base to the joint, on which "
        "nothing else may act; tip: those beyond the joint, which may hold nothing",
    )
    bandwidth: float = quantity("1/s", "K, rate of the residual's lag", default=50.0, gt=0)
    allowance: float = quantity(
        "N m or N", "residual that errors of the model may cause, on top of noise", default=0.0, ge=0
    )
    period: float | None = quantity(
        "s",
        "time between two samples; continuous and without noise if not given",
        default=None,
        gt=0,
        recurs=MAX_SAMPLES,
    )
    joint_noise: float = quantity(
        "rad/s or m/s", "standard deviation of a sample of a joint's rate", default=0.0, ge=0
    )
    spin_noise: float = quantity(
        "rad/s", "standard deviation of a sample of the base's spin", default=0.0, ge=0
    )
    velocity_noise: float = quantity(
        "m/s", "standard deviation of a sample of the base's velocity", default=0.0, ge=0
    )
    false_alarms: float = quantity("1/h", "F, greatest rate of false alarms", default=0.01, gt=0)
    brake: bool = Field(default=True, description="whether a failed joint's brake locks it upon detection")

    @model_validator(mode="after")
    def _check(self) -> MomentumObserver:
        noisy = [key for key in NOISES if getattr(self, key)]
        if noisy and self.period is None:
            raise ValueError(f"{noisy[0]}: found one, allowed: none without `period`, of whose samples it is")
        if not noisy and not self.allowance:
            raise ValueError("allowance: found 0, allowed: above 0 where samples have no noise")
        return self

    def locks(self, joints: Sequence[str]) -> list[str]:
        """Names of the joints whose brakes it may engage."""
        return matching(joints, self.joints) if self.brake else []

    def faults(self, robot: RobotProperties) -> Iterable[tuple[str, str]]:
        """A pattern that no joint matches, or a base side that is the world."""
        if not matching(robot.joints, self.joints):
            yield "joints", f"no joint {self.joints!r}; {near_names(self.joints, robot.joints)}"
        if robot.base == "fixed" and self.side == "base":
            yield "side", f"found base, the base of {robot.name} is fixed; allowed: tip"

    def build(self, actuator: ActuatorContext) -> Contribution:
        """Contribution: torques as commanded, residuals of the momenta, and detection events."""
        names = matching(list(actuator.columns), self.joints)
        brakes = {name: held_joints(actuator, [name], is_known=True) for name in names} if self.brake else {}
        switches = [actuator.context.switch(f"detected.{name}") for name in names]
        columns = tuple(actuator.columns[name] for name in names)

        def answer(command: ca.SX) -> Contribution:
            """States, events and outputs for commanded torques (n x 1)."""
            law = _Observer(self, actuator, columns).residual(command)
            residual, threshold = law.values, law.threshold
            events, outputs = [], []
            for i, (name, detected) in enumerate(zip(names, switches, strict=True)):
                label = f"{actuator.robot}/{name}"
                sets = brakes[name][1] if self.brake else {}
                outputs += [
                    Output("joint_residual", residual[i], "N m or N", "torque missed", "observed", label),
                    Output("residual_threshold", threshold[i], "N m or N", "its limit", "observed", label),
                ]
                events.append(
                    detection(
                        f"{label}.detected", label, law.excess[i], detected, sets=sets, impact=self.brake
                    )
                )
            count = sum(switches[1:], switches[0])
            outputs.append(detected_failures(count, actuator.robot))
            return Contribution(states=law.states, events=(*law.events, *events), outputs=tuple(outputs))

        brake_contribution = concatenate(contribution for contribution, _, _ in brakes.values())
        return replace(brake_contribution, drives=(ActuatorDrive(columns, lambda command: command, answer),))

    def words(self) -> str:
        """Joints, sample rate and response, in text form."""
        rate = "continuous" if self.period is None else f"at {1 / self.period:g} Hz"
        response = ", brakes them" if self.brake else ""
        return f"detects failures of {self.joints} {rate}{response}"


class _Observer:
    """Momenta, residuals and thresholds of the joints at some columns; see above."""

    def __init__(self, config: MomentumObserver, actuator: ActuatorContext, columns: tuple[int, ...]) -> None:
        self.config, self.actuator, self.columns = config, actuator, columns
        self.name = f"{actuator.robot}/{actuator.context.path.rpartition('.')[2]}"

    def residual(self, command: ca.SX) -> Residual:
        """Residuals for commanded torques (n x 1)."""
        context = self.actuator.context
        if self.config.period is None:
            momenta = (*self._momenta(self.actuator.plant.v), ca.SX(0, 1))
            return continuous_residual(context, self.name, command, momenta)
        return sampled_residual(self.config, context, self.name, command, self._measured)

    def _momenta(self, velocity: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Momentum m and the part of its rate that no commanded torque makes (n x 1 each).

        The model is the scenario's nominal one, also where a campaign draws another plant.
        """
        plant, base = self.actuator.plant, self.actuator.base_joint
        model, inertias = plant.model, Inertias.from_model(plant.model)
        moving = forward_kinematics(model, plant.q, velocity)
        sign = 1 if self.config.side == "tip" else -1
        momenta, rates = [], []
        for column in self.columns:
            joint = next(joint.index for joint in moving.joints if joint.idx_v == column)
            beyond = subtree(model, joint)
            bodies = beyond if sign > 0 else [i for i in subtree(model, base) if i not in beyond]
            line, axis = moving.linear[joint], moving.angular[joint]
            spin, point = moving.angular_velocity[joint], moving.linear_velocity[joint]
            push, turn = momentum(model, moving, inertias, bodies, moving.origin[joint])
            rotor = float(model.armature[column])
            momenta.append(sign * (ca.dot(line, push) + ca.dot(axis, turn)) + rotor * velocity[column])
            bend = ca.dot(cross(spin, line), push) + ca.dot(cross(spin, axis), turn)
            bend = bend - ca.dot(axis, cross(point, push))
            rates.append(sign * bend - plant.damping[column] * velocity[column])
        return ca.densify(ca.vertcat(*momenta)), ca.densify(ca.vertcat(*rates))

    def _measured(self, clock: Clock) -> Momenta:
        """Momenta and their rates from a sample of the velocities."""
        assert self.config.period is not None
        velocity, numbers = measured_velocity(
            self.actuator, self.actuator.context, self.name, self.config.period, clock
        )
        return (*self._momenta(velocity), numbers)
