r"""Resolved rates by the generalized Jacobian, with or without the base kept at rest.

A free base reacts to the joints. Without a wrench on the base, joint rates $r$ entail the velocities

$$ v_\text{base} = v_0 + W r, \qquad v_\text{tip} = v_1 + J^* r, \qquad
   W = -H_b^{-1} H_{bm}, \qquad J^* = J_m + J_b W, $$

where $J^*$ is the generalized Jacobian (Umetani and Yoshida 1989), and momentum and other bodies cause $v_0$
and $v_1$. The desired rates move the tips along their references. With `keeps` they first keep the base at
rest, $W r = -v_0$; the tips then move in the reaction null space (Nenchev, Yoshida and Uchiyama 1992). The
columns of joints that are known to be held are left out, so that the other joints do the tasks. The joints
then accelerate by

$$ \dot r_\text{des} = a_\text{ref} + g\,(r_\text{des} - r), $$

where $a_\text{ref}$ are the accelerations of the same tasks. The torques follow by inverse dynamics.
A payload that the tip holds rigidly has the tip's twist $J_t v$. With its spatial inertia $I$ about the tip
it adds

$$ J_t^T I J_t \qquad \text{and} \qquad
   J_t^T \left( I \dot J_t v + (\omega \times (\omega \times m c),\ \omega \times I_o\, \omega) \right) $$

to the inertia and the bias of the robot, so that errors fade at the same rates with an object in the hand.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import casadi as ca
from pydantic import Field

from spacerobot.common.section import Vector, quantity
from spacerobot.dynamics.algebra import SymmetricFactors
from spacerobot.dynamics.inertial_parameters import inertial_parameters, inertial_wrench, spatial_inertia
from spacerobot.elements.controllers.controller import RobotController
from spacerobot.elements.controllers.free_base import FreeBase
from spacerobot.elements.core.context import RobotContext, TipContext
from spacerobot.elements.core.contribution import Contribution
from spacerobot.elements.core.registry import register
from spacerobot.elements.core.robot_element import RobotProperties


@register
class ResolvedRate(RobotController):
    """Joint rates that move the tips by the generalized Jacobian, optionally with the base at rest."""

    kind: Literal["resolved_rate"] = "resolved_rate"
    keeps: Literal["nothing", "attitude", "base"] = Field(
        default="nothing",
        description="what of the floating base the joints keep still (reaction null space): nothing, its "
        "attitude, or its position too",
    )
    orientation: bool = Field(default=True, description="whether the tips' orientation is controlled too")
    gain: float = quantity("1/s", "rate at which the tips' errors are removed", default=2.0, ge=0)
    rate_gain: float = quantity(
        "1/s", "rate at which errors of the joint rates are removed", default=20.0, ge=0
    )
    damping: float = quantity("m", "damping of the pseudo-inverse of the tips' tasks", default=1e-3, ge=0)
    payload_mass: float = quantity(
        "kg", "of an object that the first tip holds rigidly, as the controller assumes it", default=0.0, ge=0
    )
    payload_com: Vector = quantity("m", "its centre of mass, axes of the tip", default=(0.0, 0.0, 0.0))
    payload_inertia: tuple[float, float, float, float, float, float] = quantity(
        "kg m^2", "its ixx, iyy, izz, ixy, ixz, iyz about it, axes of the tip", default=(0.0,) * 6
    )
    payload_fraction: float = quantity(
        "1", "part of the payload that counts: 0 in phases in which it is not held", default=1.0, ge=0
    )

    def build(self, robot: RobotContext) -> Contribution:
        """Contribution: joint torques."""
        number, columns = robot.context.number, list(robot.columns)
        free = FreeBase.of(robot.plant, robot.base_joint, columns, self._payload(robot))
        rates, locked = robot.plant.v[columns], robot.locked
        tasks = []
        if self.keeps != "nothing":
            # the base keeps its position and attitude, or its attitude
            turning_alone = self.keeps == "attitude"
            planar = len(free.base) == 3
            rows = (
                [2]
                if planar and turning_alone
                else [3, 4, 5]
                if turning_alone
                else list(range(len(free.base)))
            )
            velocity = robot.plant.v[free.base]
            base_task = _Task(
                free.reaction[rows, :], velocity[rows], ca.SX(len(rows), 1), -free.falling[rows]
            )
            tasks.append(base_task)
        led = [task for tip in robot.tips for task in self._tip_tasks(robot, tip, free)]
        if led:
            tasks.append(_Task.of(led, number("damping")))
        # Held joints keep their rates; the others perform the tasks with the remaining columns.
        moving = 1 - locked
        tasks = [replace(task, rows=ca.mtimes(task.rows, ca.diag(moving))) for task in tasks]
        desired_rates = _resolved(tasks, [task.desired - task.velocity for task in tasks], rates)
        desired_acceleration = _resolved(
            tasks, [task.acceleration for task in tasks], ca.SX(rates.shape[0], 1)
        )
        read = robot.read("joint_rate", rates)
        torque = free.torque(moving * (desired_acceleration + number("rate_gain") * (desired_rates - read)))
        torque = moving * (torque + robot.plant.damping[columns] * rates)
        return Contribution(torques=(robot.torque(torque),))

    def _payload(self, robot: RobotContext) -> tuple[ca.SX, ca.SX] | None:
        """Inertia (nv x nv) and bias (nv x 1) that a payload at the first tip adds; None without one."""
        if robot.context.is_zero("payload_mass") or not robot.tips:
            return None
        number, plant, tip = robot.context.number, robot.plant, robot.tips[0]
        com, inertia = (
            ca.vertcat(*(number(f"payload_{key}.{i}") for i in range(size)))
            for key, size in (("com", 3), ("inertia", 6))
        )
        payload = number("payload_fraction") * inertial_parameters(number("payload_mass"), com, inertia)
        axes, _ = plant.placement(tip.frame)
        to_tip_axes = ca.diagcat(axes, axes).T  # world axes to those of the tip
        rows = ca.mtimes(to_tip_axes, plant.gathered(plant.jacobian(tip.frame).T).T)
        falling, spinning = plant.drift(tip.frame)
        gravity = ca.SX(ca.DM(plant.model.gravity.linear))
        spin = ca.mtimes(axes.T, tip.angular_velocity)
        wrench = inertial_wrench(
            payload, ca.mtimes(axes.T, falling - gravity), spin, ca.mtimes(axes.T, spinning)
        )
        return ca.mtimes([rows.T, spatial_inertia(payload), rows]), ca.mtimes(rows.T, ca.vertcat(*wrench))

    def _tip_tasks(self, robot: RobotContext, tip: TipContext, free: FreeBase) -> Iterator[_Task]:
        """Tasks by which the tip follows its reference in position and, optionally, in orientation."""
        plant, motion, gain = robot.plant, tip.motion, robot.context.number("gain")
        jacobian = plant.gathered(plant.jacobian(tip.frame).T).T
        rows, drift = jacobian[:, list(robot.columns)], ca.vertcat(*plant.drift(tip.frame))
        if free.base:
            on_base = jacobian[:, free.base]
            rows, drift = rows + ca.mtimes(on_base, free.reaction), drift + ca.mtimes(on_base, free.falling)
        tip_velocity = tip.read("tip_velocity", tip.velocity)
        error = motion.position - tip.read("tip_position", tip.position)
        bend = motion.acceleration + gain * (motion.velocity - tip_velocity) - drift[:3]
        axes = list(plant.translation_axes)
        yield _Task(rows[axes, :], tip_velocity[axes], (motion.velocity + gain * error)[axes], bend[axes])
        if not self.orientation:
            return
        tip_velocity = tip.read("tip_angular_velocity", tip.angular_velocity)
        error = -tip.read("tip_orientation", -tip.orientation_error)
        bend = motion.angular_acceleration + gain * (motion.angular_velocity - tip_velocity) - drift[3:]
        axes = list(plant.rotation_axes)
        desired = (motion.angular_velocity + gain * error)[axes]
        yield _Task(rows[3:, :][axes, :], tip_velocity[axes], desired, bend[axes])

    def reads(self) -> set[str]:
        """Signals of the joint rates, and of the tips' poses and velocities."""
        rotation_signals = {"tip_orientation", "tip_angular_velocity"} if self.orientation else set()
        return {"joint_rate", "tip_position", "tip_velocity"} | rotation_signals

    def faults(self, robot: RobotProperties) -> Iterable[tuple[str, str]]:
        """Errors: a fixed base, or more task directions than joints."""
        if self.keeps == "nothing":
            return
        if robot.base == "fixed":
            yield "keeps", f"the base of {robot.name} is fixed; leave `keeps` out"
            return
        rotations, moving = (1, 2) if robot.base == "planar" else (3, 3)
        constraint_count = rotations + moving * (self.keeps == "base")
        if constraint_count >= len(robot.joints):
            yield (
                "keeps",
                f"its {len(robot.joints)} joints cannot keep {constraint_count} velocities of the base "
                "and still move; allowed: nothing" + (", attitude" if rotations < len(robot.joints) else ""),
            )

    def words(self) -> str:
        """Kind, gains, and the base motion that is kept."""
        still = {"nothing": "", "attitude": ", base attitude kept", "base": ", base kept"}[self.keeps]
        payload = f", payload {self.payload_mass:g} kg" if self.payload_mass else ""
        return f"resolved rates, {self.gain:g} / {self.rate_gain:g} 1/s{still}{payload}"


@dataclass(frozen=True)
class _Task:
    """Velocity that is linear in the joint rates, with its desired value.

    Attributes:
        rows: Velocity per joint rate (k x n).
        velocity: Present velocity (k x 1).
        desired: Desired velocity (k x 1).
        acceleration: Desired acceleration minus that at zero joint acceleration (k x 1).
        damping: Damping of the pseudo-inverse (1x1); None for the task of the base, which has none.
    """

    rows: ca.SX
    velocity: ca.SX
    desired: ca.SX
    acceleration: ca.SX
    damping: ca.SX | None = None

    @classmethod
    def of(cls, several: list[_Task], damping: ca.SX) -> _Task:
        """Several as one."""
        names = ("rows", "velocity", "desired", "acceleration")
        parts = {name: ca.vertcat(*(getattr(task, name) for task in several)) for name in names}
        return cls(**parts, damping=damping)


def _resolved(tasks: list[_Task], missing: list[ca.SX], rates: ca.SX) -> ca.SX:
    """Joint rates (n x 1) that add ``missing`` (k x 1) to each task's velocity at ``rates`` (n x 1).

    Each task is solved in the null space of the tasks before it.
    """
    solution, free = ca.SX(rates.shape[0], 1), ca.SX.eye(rates.shape[0])
    for task, deficit in zip(tasks, missing, strict=True):
        right = deficit + ca.mtimes(task.rows, rates - solution)
        rows = ca.mtimes(task.rows, free)
        gram = ca.mtimes(rows, rows.T)
        if task.damping is not None:
            gram = gram + task.damping**2 * ca.SX.eye(gram.size1())
        factors = SymmetricFactors(gram)
        solution = solution + ca.mtimes(rows.T, factors.solve(right))
        free = free - ca.mtimes(rows.T, factors.solve(rows))
    return solution
