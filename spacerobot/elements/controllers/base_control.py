r"""Control law that controllers of a floating base share.

$$ u = K_p e + K_i \int e\,\mathrm{d}t - K_d\,\omega + k\,(\dot h - J \dot\omega) $$

$e$ is the base's error and $\omega$ its velocity. $h$ is the robot's momentum: the linear momentum, with
the mass for $J$, or the angular momentum about the centre of mass, with the robot's initial inertia for
$J$. The difference $\dot h - J \dot\omega$ is therefore the reaction of the arm, and of the base's own
turning, beyond the acceleration of the base. With $k = 1$ the base obeys

$$ J \dot\omega = K_p e + K_i \int e\,\mathrm{d}t - K_d\,\omega + (\text{grasps and contacts}) $$

for any motion of the arm. By the model, $\dot h = H \dot v + \dot H v$: the command $u$ depends on the
acceleration that it causes. This loop is solved exactly, like that of an ideal derivative, as if every
request were delivered. With a filtered derivative $h - J \omega$, which depends on velocities alone, passes
a first-order lag instead, and the rate of the lag is used.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import casadi as ca
from pydantic import Field

from spacerobot.common.section import quantity
from spacerobot.elements.controllers.controller import RobotController
from spacerobot.elements.core.context import RobotContext
from spacerobot.elements.core.contribution import Contribution, ControlChannel, Output, State


class BaseMotionController(RobotController):
    """PID on the motion of a base, with feed-forward of the arm's reaction."""

    kp: float
    ki: float
    kd: float
    feed_forward: float = quantity(
        "1",
        "fraction of the arm's reaction (rate of its linear or angular momentum) that is added",
        default=1.0,
        ge=0,
    )
    derivative: Literal["ideal", "filtered"] = Field(
        default="ideal",
        description="how that rate is found; ideal: by the model, with the accelerations that follow; "
        "filtered: by a first-order lag of the momentum, which costs less where wheels deliver",
    )
    filter_time: float = quantity("s", "time constant of the filtered rate", default=0.02, gt=0)

    def assumptions(self) -> list[str]:
        """Assumptions of its model, for the user."""
        return ["feeds the motion of the arm forward as it is, without errors"]

    def words(self) -> str:
        """Gains."""
        return f"{self.kind} {self.kp:g} / {self.ki:g} / {self.kd:g}, feed-forward {self.feed_forward:g}"


@dataclass(frozen=True)
class ArmReaction:
    """Reaction ``h' - J w'`` of the arm: reduced loads (nv x 3) along which v' gives it, and remainder (3x1).

    Without loads, the reaction is the filtered rate of ``momentum`` (3x1) plus the remainder.
    """

    sense: ca.SX | None
    drift: ca.SX
    momentum: ca.SX | None = None


def held(
    robot: RobotContext,
    motion: Literal["translation", "rotation"],
    error: ca.SX,
    actuation: ca.SX,
    reaction: ArmReaction | None,
) -> Contribution:
    """Contribution that holds a base: its error is driven to zero.

    Args:
        robot: Robot of the base; the section has the gains ``kp``, ``ki``, ``kd`` and ``feed_forward``.
        motion: Motion to hold.
        error: Position error [m] or rotation vector [rad] (3x1), world axes, as measured.
        actuation: Map from force [N] or torque [N m] in world axes to generalized forces (nv x 3).
        reaction: Reaction to feed forward, if any.
    """
    plant, context, turns = robot.plant, robot.context, motion == "rotation"
    axes = list(plant.rotation_axes if turns else plant.translation_axes)
    signal = "base_spin" if turns else "base_velocity"
    velocity = robot.read(signal, plant.velocity(robot.base_frame)[turns])[axes]
    kp, ki, kd = (context.number(gain) for gain in ("kp", "ki", "kd"))
    command, gain = kp * error[axes] - kd * velocity, None
    states = []
    # no state for an integral with zero gain: a rotation vector jumps at half a turn, and its integral
    # would make steps short there all the same
    if not context.is_zero("ki"):
        name = f"{robot.name}/{robot.key}.integral"
        integral = ca.SX.sym(name, len(axes))
        command = command + ki * integral
        states.append(State(name, integral, ca.SX.zeros(len(axes)), error[axes]))
    sense = ca.SX(plant.v.size1(), len(axes))
    if reaction is not None:
        part = context.number("feed_forward")
        command = command + part * reaction.drift[axes]
        if reaction.sense is not None:
            gain, sense = ca.repmat(-part, len(axes), 1), reaction.sense[:, axes]
        if reaction.momentum is not None:
            value = reaction.momentum[axes]
            label = f"{robot.name}/{robot.key}.filter"
            filtered = ca.SX.sym(label, value.size1())
            lag = (value - filtered) / robot.context.number("filter_time")
            states.append(State(label, filtered, value, lag))
            command = command + part * states[-1].derivative
    actuation = actuation[:, axes]
    drive = robot.plant.reduced(actuation)
    channel = ControlChannel(robot.name, actuation, drive, sense, command, gain, moves_tip=False)
    called, unit, text = (
        ("base_attitude_error", "rad", "rotation vector from bases to the attitudes they shall have")
        if turns
        else ("base_position_error", "m", "from bases to the positions they shall have")
    )
    brakes_only = context.is_zero("kp") and context.is_zero("ki")
    return Contribution(
        states=tuple(states),
        channels=(channel,),
        outputs=() if brakes_only else (Output(called, error, unit, text, "body", robot.name),),
    )


def resistance(robot: RobotContext, motions: ca.SX) -> ca.SX:
    """Reduced loads (nv x n) along which v' is the rate of the robot's momentum in given base motions.

    The motions (6 x n) are velocities of the base's origin and its angular velocities, world axes.
    """
    plant, base = robot.plant, robot.base_joint
    first, count = int(plant.model.idx_vs[base]), int(plant.model.nvs[base])
    jacobian = plant.jacobian(robot.base_frame)[:, first : first + count]
    loads = ca.SX(plant.v.size1(), 0)
    for motion in ca.horzsplit(motions):
        rates = ca.SX(plant.v.size1(), 1)
        rates[first : first + count] = ca.mtimes(jacobian.T, motion)  # whose columns are orthonormal
        loads = ca.horzcat(loads, plant.resistance(ca.sparsify(rates)))
    return loads
