"""Detection of failed joints by the residual of a momentum observer, and their brakes.

The momentum that a joint sees of the n bodies on one side of it, with the joint's axis a at the point o,

    m = s (a_v . P + a_w . L_o) + J v_j,    m' = tau - R v_j + s b,
    b = (w x a_v) . P + (w x a_w) . L_o - a_w . (v_o x P),

has a rate that the joint's torque tau explains: P and L_o are linear and angular momentum (about o) of these
bodies, a_v and a_w the joint's directions of velocity, w and v_o spin and velocity of the joint, J the
inertia of its rotor and s = 1 for the bodies beyond the joint, -1 for those from the base on. The residual

    r' = K (m' - tau_commanded + R v_j - s b - r)

is the torque that is missing, behind a first-order lag (De Luca and Mattone 2003; Haddadin, De Luca and
Albu-Schaeffer 2017), here with the momentum of a free-floating base in m: forces on the other side of the
joint act on m through the joint alone. The bodies of the base side so need no measurement of what the tip
holds; those beyond the joint none of what acts on the base.

At instants a period T apart, from samples of the velocities and a = exp(-K T),

    r_k = a r_k-1 + (1 - a) ((m_k - m_k-1) / T - mean(tau_commanded - R v_j + s b)),

whose variance follows from the variances s_k^2 of m_k, which are white noise times the rows of the momentum,

    V_k = a^2 V_k-1 + ((1 - a) / T)^2 (s_k^2 + (1 - 2 a) s_k-1^2),

since r_k-1 and m_k-1 have the covariance (1 - a) s_k-1^2 / T for k > 1. A joint has failed where |r_k|
exceeds z times the root of V_k, and the allowance for errors of the model. With a rate F of false alarms in
all n joints, a sample may pass by p = F T / n, so z = Phi^-1(1 - p / 2). By Boole's inequality F is an upper
bound: samples that follow each other are correlated, and several that exceed are one alarm.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from statistics import NormalDist
from typing import ClassVar, Literal

import casadi as ca
from pydantic import Field, model_validator

from spacerobot.dynamics import Inertias, forward_kinematics, momentum
from spacerobot.dynamics.algebra import cross
from spacerobot.dynamics.momentum import subtree
from spacerobot.elements.actuator import Actuator
from spacerobot.elements.clock import Clock
from spacerobot.elements.context import ActuatorContext
from spacerobot.elements.contribution import (
    ActuatorDrive,
    Contribution,
    Output,
    State,
    concatenate,
    memory,
)
from spacerobot.elements.event import Event, negated
from spacerobot.elements.joint_lock import held_joints
from spacerobot.elements.registry import register
from spacerobot.elements.robot_element import RobotProperties
from spacerobot.errors import near_names
from spacerobot.section import matching, quantity

NOISES = ("joint_noise", "spin_noise", "velocity_noise")
TINY = 1e-30
"""Keeps the root of a variance differentiable where nothing was measured yet."""


@register
class MomentumObserver(Actuator):
    """Detects failed joints from the residual of their momentum, and engages their brakes.

    It sees the torques commanded of the actuators after it, and passes them on: it is listed after limits
    and before failures.
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
        "s", "time between two samples; continuous and without noise if not given", default=None, gt=0
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

    def faults(self, robot: RobotProperties) -> Iterable[tuple[str, str]]:
        """A pattern that no joint matches, or a base side that is the world."""
        if not matching(robot.joints, self.joints):
            yield "joints", f"no joint {self.joints!r}; {near_names(self.joints, robot.joints)}"
        if robot.base == "fixed" and self.side == "base":
            yield "side", f"found base, the base of {robot.name} is fixed; allowed: tip"

    def build(self, actuator: ActuatorContext) -> Contribution:
        """Torques as commanded, residuals of what becomes of them, and events of detection."""
        names = matching(list(actuator.columns), self.joints)
        brakes = {name: held_joints(actuator, [name]) for name in names} if self.brake else {}
        switches = [actuator.context.switch(f"detected.{name}") for name in names]
        columns = tuple(actuator.columns[name] for name in names)

        def answer(asked: ca.SX) -> Contribution:
            """States, events and outputs, of the torques that are commanded."""
            law = _Observer(self, actuator, columns, asked)
            found = law.sampled() if self.period is not None else law.continuous()
            (_, residual), threshold = found
            events, outputs = [], []
            for i, (name, detected) in enumerate(zip(names, switches, strict=True)):
                label = f"{actuator.robot}/{name}"
                sets = {detected.name(): True} | (brakes[name][1] if self.brake else {})
                guard = ca.fabs(residual[i]) / threshold[i] - 1
                outputs += [
                    Output("joint_residual", residual[i], "N m or N", "torque missed", "observed", label),
                    Output("residual_threshold", threshold[i], "N m or N", "its limit", "observed", label),
                ]
                events.append(
                    Event(
                        f"{label}.detected",
                        "detected",
                        label,
                        guard,
                        negated(detected),
                        sets,
                        impact=self.brake,
                    )
                )
            count = sum(switches[1:], switches[0])
            text = "failures that were detected"
            outputs.append(Output("failures_detected", count, "1", text, "body", actuator.robot))
            return Contribution(
                states=tuple(law.states), events=(*law.events, *events), outputs=tuple(outputs)
            )

        held = concatenate(contribution for contribution, _, _ in brakes.values())
        return replace(held, drives=(ActuatorDrive(columns, lambda asked: asked, answer),))

    def words(self) -> str:
        """The joints, the rate of samples, and the response."""
        rate = "continuous" if self.period is None else f"at {1 / self.period:g} Hz"
        then = ", brakes them" if self.brake else ""
        return f"detects failures of {self.joints} {rate}{then}"


class _Observer:
    """Momenta, residuals and thresholds of the joints at some columns; see above."""

    def __init__(
        self, config: MomentumObserver, actuator: ActuatorContext, columns: tuple[int, ...], asked: ca.SX
    ) -> None:
        self.config, self.actuator, self.columns, self.asked = config, actuator, columns, asked
        self.name = f"{actuator.robot}/{actuator.context.path.rpartition('.')[2]}"
        self.states, self.events = list[State](), list[Event]()

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

    def _allowed(self) -> ca.SX:
        return ca.repmat(self.actuator.context.number("allowance"), len(self.columns), 1)

    def continuous(self) -> tuple[tuple[ca.SX, ca.SX], ca.SX]:
        """Momenta and residuals, and thresholds, at any time."""
        found, rate = self._momenta(self.actuator.plant.v)
        name = f"{self.name}.explained"
        explained = ca.SX.sym(name, found.size1())
        residual = self.actuator.context.number("bandwidth") * (found - explained)
        self.states = [State(name, explained, found, self.asked + rate + residual)]
        return (found, residual), self._allowed()

    def sampled(self) -> tuple[tuple[ca.SX, ca.SX], ca.SX]:
        """The same, held since the last sample."""
        context, size, plant = self.actuator.context, len(self.columns), self.actuator.plant
        period = context.steady("period")
        clock = Clock.of(f"{self.name}.samples", context.time, period)
        noise, numbers = self._noise(clock)
        found, rate = self._momenta(plant.v + noise)
        name, effort, zeros = f"{self.name}.effort", ca.SX.sym(f"{self.name}.effort", size), ca.SX.zeros(size)
        last, before, residual = (
            memory(f"{self.name}.{key}", zeros) for key in ("momentum", "rate", "residual")
        )
        a = ca.exp(-context.number("bandwidth") * period)
        a = context.once("decay", context.constants.expanded(a))
        missed = (found - last.symbol - effort) / period - (rate + before.symbol) / 2
        first = clock.count.symbol < 0.5
        after = ca.if_else(first, 0, a * residual.symbol + (1 - a) * missed)
        self.states = [clock.count, State(name, effort, zeros, self.asked), last, before, residual]
        updates = {name: zeros, last.name: found, before.name: rate, residual.name: after}
        threshold = self._allowed()
        if numbers.numel():
            rows = ca.jacobian(found, numbers)
            own = ca.densify(ca.sum2(rows * rows))
            white, variance = (memory(f"{self.name}.{key}", zeros) for key in ("white", "variance"))
            scale = ((1 - a) / period) ** 2
            correlated = 2 * a * (clock.count.symbol > 1.5)  # the first residual is zero
            grown = a**2 * variance.symbol + scale * (own + (1 - correlated) * white.symbol)
            self.states += [white, variance]
            updates |= {white.name: own, variance.name: ca.if_else(first, 0, grown)}
            assert self.config.period is not None
            passes = self.config.false_alarms * self.config.period / 3600 / size
            exceeded = NormalDist().inv_cdf(1 - min(passes, 1.0) / 2)
            threshold = threshold + exceeded * ca.sqrt(variance.symbol + TINY)
        self.events = [clock.event(f"{self.name}.sampled", "measured", self.name, updates, silent=True)]
        return (found, residual.symbol), threshold

    def _noise(self, clock: Clock) -> tuple[ca.SX, ca.SX]:
        """Errors of the velocities (nv x 1) at a sample, and the normal numbers that they are made of."""
        actuator, context = self.actuator, self.actuator.context
        base = actuator.base_columns
        turning = base[2:] if len(base) == 3 else base[3:]
        sources = {"velocity_noise": base[: len(base) - len(turning)], "spin_noise": turning}
        sources["joint_noise"] = tuple(actuator.columns.values())
        sources = {key: own for key, own in sources.items() if not context.is_zero(key)}
        places = [(column, key) for key, own in sources.items() for column in own]
        found = ca.SX(actuator.plant.v.size1(), 1)
        if not places:
            return found, ca.SX(0, 1)
        assert self.config.period is not None
        rows = math.ceil(context.parameters.value("simulation.duration") / self.config.period) + 2
        numbers = context.random(self.name, rows, len(places), clock.count.symbol)
        for i, (column, key) in enumerate(places):
            found[column] = context.number(key) * numbers[i]
        return found, numbers
