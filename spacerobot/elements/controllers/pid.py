r"""PID on the velocity error of a tip, its translation or its rotation (Eq. 26-30, 35-38).

$$ e = \dot x_\text{ref} + G_e X - \dot x_\text{fb}, \qquad
   u = K_p e + K_i \int e\,\mathrm{d}t + K_d \dot e, \qquad \tau = J^\top u $$

with the velocity $\dot x_\text{fb}$ that is fed back, the state $X$ of the amnesia controller (Eq. 37, 38),
and the manipulator Jacobian $J$ of the arm's joints alone.

The ideal derivative makes $u$ depend on the acceleration, which depends on $u$. The loop is left open here,
as $u = c - K_d\,(C \dot v + d)$ with the command $c$ without the derivative, and is solved exactly in
:mod:`spacerobot.closedloop.forward_dynamics`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import ClassVar, Literal

import casadi as ca
from pydantic import Field

from spacerobot.common.section import Section, quantity
from spacerobot.elements.controllers.amnesia import correct
from spacerobot.elements.controllers.controller import TipController, named_motion
from spacerobot.elements.core.context import TipContext
from spacerobot.elements.core.contribution import Contribution, ControlChannel, State
from spacerobot.elements.core.registry import register


@register
class Pid(TipController):
    """PID on the tip's velocity error, mapped to joint torques by the Jacobian's transpose (Eq. 35).

    For an orientation PID units are those of torque per angular velocity: N m s/rad, N m/rad, N m s^2/rad.
    """

    by_phase: ClassVar[tuple[str, ...]] = ("feedback",)
    kind: Literal["pid"] = "pid"
    kp: float = quantity("N s/m", "proportional gain K_p", rotation="N m s/rad", default=0.0, ge=0)
    ki: float = quantity("N/m", "integral gain K_i", rotation="N m/rad", default=0.0, ge=0)
    kd: float = quantity("kg", "derivative gain K_d", rotation="N m s^2/rad", default=0.0, ge=0)
    feedback: Literal["base", "inertial"] = Field(
        default="base",
        description="velocity that is fed back: seen from the robot's own base (joint rates through the "
        "manipulator Jacobian), or the true one",
    )
    derivative: Literal["ideal", "filtered"] = Field(
        default="ideal",
        description="ideal: the algebraic loop through the tip's acceleration, solved exactly; "
        "filtered: a first-order lag, as a real controller has",
    )
    filter_time: float = quantity("s", "time constant of the filtered derivative", default=0.02, gt=0)

    def build(self, tip: TipContext) -> Contribution:
        """Contribution: one channel and its states."""
        turns = self.controls(tip.key) == "rotation"
        axes = list(tip.plant.rotation_axes if turns else tip.plant.translation_axes)
        # the active feedback velocity
        options = tip.context.chosen("feedback", self.feedback)
        feedbacks = [(active, _seen_from(word, tip, axes, turns=turns)) for word, active in options.items()]
        (_, fed_back), *alternatives = feedbacks
        for active, alternative in alternatives:
            parts = (f.name for f in fields(_FedBack))
            fed_back = _FedBack(
                *(ca.if_else(active, getattr(alternative, n), getattr(fed_back, n)) for n in parts)
            )
        motion, states = tip.motion, []
        desired = (motion.angular_velocity if turns else motion.velocity)[axes]
        desired_rate = (motion.angular_acceleration if turns else motion.acceleration)[axes]
        memory = "orientation_amnesia" if turns else "amnesia"
        if memory in tip.siblings:
            # Reference minus measured position, or the rotation vector from measured orientation to
            # reference: the signal is the tip's rotation relative to its reference, so its negative.
            if not turns:
                position_error = (tip.motion.position - tip.read("tip_position", tip.position))[axes]
            else:
                position_error = -tip.read("tip_orientation", -tip.orientation_error)[axes]
            state, correction = correct(tip, memory, position_error)
            states.append(state)
            desired, desired_rate = desired + correction.value, desired_rate + correction.rate
        error = desired - fed_back.velocity
        # command, derivative gain and states (Eq. 35); `error_rate` lacks the part that depends on v'
        kp, ki, kd = (tip.context.number(gain) for gain in ("kp", "ki", "kd"))
        size, name = error.size1(), f"{tip.label}/{tip.key}"
        integral = ca.SX.sym(f"{name}.integral", size)
        channel_states = [State(f"{name}.integral", integral, ca.SX.zeros(size), error)]
        command = kp * error + ki * integral
        if self.derivative == "ideal":
            command, gain = command + kd * (desired_rate - fed_back.drift), ca.repmat(kd, size, 1)
        else:
            lag = tip.context.number("filter_time")
            filtered = ca.SX.sym(f"{name}.filter", size)
            # starts at the error itself, so that the derivative has no initial peak
            channel_states.append(State(f"{name}.filter", filtered, error, (error - filtered) / lag))
            command, gain = command + kd * (error - filtered) / lag, None
        rows = [axis + 3 * turns for axis in axes]
        channel = ControlChannel(
            tip.robot, tip.arm_jacobian[rows, :].T, fed_back.drive, fed_back.sense, command, gain
        )
        return Contribution(states=(*states, *channel_states), channels=(channel,))

    def reads(self, key: str, siblings: Mapping[str, Section]) -> set[str]:
        """Signals of the feedback velocity and of the amnesia controller."""
        turns = self.controls(key) == "rotation"
        inertial = "tip_angular_velocity" if turns else "tip_velocity"
        signals = {"joint_rate" if self.feedback == "base" else inertial}
        if ("orientation_amnesia" if turns else "amnesia") in siblings:
            signals.add("tip_orientation" if turns else "tip_position")
        return signals

    @property
    def feeds_back_joint_acceleration(self) -> bool:
        """Whether the controller differentiates the velocity seen from the base."""
        return self.feedback == "base" and self.derivative == "ideal" and self.kd > 0

    def controls(self, key: str) -> Literal["translation", "rotation"]:
        """The tip's translation, or its rotation at keys that say so."""
        return named_motion(key)

    def assumptions(self) -> list[str]:
        """Assumptions on the feedback and on the derivative."""
        sentences = []
        if self.feedback == "base":
            sentences.append("feeds back the velocity seen from the base, blind to its drift")
        if self.derivative == "ideal" and self.kd > 0:
            sentences.append("ideal derivative, its algebraic loop solved exactly")
        return sentences

    def words(self) -> str:
        """Gains and feedback."""
        return f"{self.kp:g} / {self.ki:g} / {self.kd:g} ({self.feedback} feedback)"


@dataclass(frozen=True)
class _FedBack:
    """Fed-back velocity (n x 1), its rate without the part that depends on v', and the channel's loads."""

    velocity: ca.SX
    drift: ca.SX
    drive: ca.SX
    sense: ca.SX


def _seen_from(feedback: str, tip: TipContext, axes: list[int], *, turns: bool) -> _FedBack:
    """Velocity relative to the base, or inertial velocity, from sensors (S = a + b s)."""
    plant = tip.plant
    drive, external_loads = tip.reduced_loads(axes, rotation=turns)
    if feedback == "inertial":
        signal = "tip_angular_velocity" if turns else "tip_velocity"
        _, scale = tip.sensors(signal)
        velocity = tip.read(signal, plant.velocity(tip.frame)[turns])[axes]
        return _FedBack(velocity, scale * plant.drift(tip.frame)[turns][axes], drive, scale * external_loads)
    offset, scale = tip.sensors("joint_rate")
    arm = tip.arm_jacobian[[axis + 3 * turns for axis in axes], :]
    last = tip.held("joint_rate", plant.v[list(tip.columns)])
    velocity = scale * ca.mtimes(arm, plant.v) if last is None else ca.mtimes(arm[:, list(tip.columns)], last)
    drift = scale * tip.relative_drift(rotation=turns)[axes]
    if offset is not None:
        ones = ca.SX(plant.v.size1(), 1)
        ones[list(tip.columns)] = 1
        velocity_gain = ca.mtimes(arm, ones)
        velocity = velocity + offset * velocity_gain if last is None else velocity
        drift = drift + offset * plant.rate(velocity_gain)
    return _FedBack(velocity, drift, drive, scale * drive)
