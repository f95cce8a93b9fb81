"""Joints of the URDF as reaction wheels; see :mod:`spacerobot.elements.actuators.wheel_set`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Literal

import casadi as ca
from pydantic import Field

from spacerobot.common.errors import near_names
from spacerobot.common.section import matching
from spacerobot.elements.actuators.joint_lock import held_joints
from spacerobot.elements.actuators.wheel_set import (
    WheelMotors,
    WheelSet,
    are_independent,
    base_rotation_axes,
    pseudo_inverse,
)
from spacerobot.elements.core.context import ActuatorContext, once_for_each
from spacerobot.elements.core.contribution import ActuatorDrive, Contribution, PowerTerm, concatenate
from spacerobot.elements.core.registry import register
from spacerobot.elements.core.robot_element import RobotProperties


@register
class WheelJoints(WheelSet):
    """Continuous joints of the URDF as reaction wheels: none of the arm's, they deliver the base's torque."""

    kind: Literal["wheel_joints"] = "wheel_joints"
    joints: str = Field(description="joint by name; `*` matches any letters")

    def build(self, actuator: ActuatorContext) -> Contribution:
        """Contribution: torques on the joints.

        Links store the momentum and joint damping is the viscous friction.
        """
        plant, columns = actuator.plant, actuator.columns
        places = [columns[name] for name in self.owns(tuple(columns))]
        base, about = base_rotation_axes(actuator)
        joints = [joint for joint in plant.kinematics.joints if joint.idx_v in places]
        axes = ca.horzcat(*(ca.mtimes(joint.rotation, joint.angular) for joint in joints))
        inverse, speed, spin = pseudo_inverse(axes[about, :]), plant.v[places], ca.SX(3, 1)
        spin[about] = plant.v[list(base)]
        coulomb = self.coulomb_friction(actuator, speed)
        friction = coulomb + plant.damping[places] * speed
        moments = (ca.mtimes(plant.inertias.rotational[j.index], j.angular) for j in joints)
        inertia = ca.vertcat(*(ca.dot(turned, j.angular) for turned, j in zip(moments, joints, strict=True)))
        rotation = plant.placement(actuator.base_frame)[0]
        total_momentum = ca.mtimes(rotation, ca.mtimes(axes, inertia * (speed + ca.mtimes(axes.T, spin))))

        @once_for_each
        def motors(command: ca.SX) -> WheelMotors:
            wheel_torque = -ca.mtimes(inverse, command[: len(base)])
            return self.motors(actuator, wheel_torque, axes[about, :], speed, friction)

        def deliver(command: ca.SX) -> ca.SX:
            motor_torques = motors(command)
            remaining = command[: len(base)] + ca.mtimes(axes[about, :], motor_torques.command)
            return ca.vertcat(remaining, motor_torques.net + friction - coulomb)

        def answer(command: ca.SX) -> Contribution:
            """Friction's power, outputs of the wheels, and tests for failed wheels."""
            motor_torques, dissipated = motors(command), ca.dot(coulomb, speed)
            friction_terms = (
                (PowerTerm("actuator", dissipated, "in"), PowerTerm("wheel_friction", dissipated))
                if coulomb.nnz()
                else ()
            )
            tests = self.detected(actuator, motor_torques, speed, axes, inertia)
            observed = Contribution(
                powers=friction_terms,
                outputs=self.observed(actuator, motor_torques, speed, total_momentum),
                events=motor_torques.events,
            )
            return concatenate([observed, tests])

        drive = ActuatorDrive((*base, *places), deliver, answer, passes_on=base)
        names = self.owns(tuple(columns))
        lock_contribution, _, _ = held_joints(actuator, [names[wheel] for wheel in self.seized])
        return replace(lock_contribution, drives=(drive,), wheels=(total_momentum,))

    def seizing(self, actuator: ActuatorContext, wheel: int) -> tuple[dict[str, bool], dict[str, ca.SX]]:
        """The joint is held."""
        return held_joints(actuator, [self.owns(tuple(actuator.columns))[wheel]])[1:]

    def owns(self, joints: Sequence[str]) -> list[str]:
        """Joints that match the pattern."""
        return matching(joints, self.joints)

    def faults(self, robot: RobotProperties) -> Iterable[tuple[str, str]]:
        """Errors: joints that are not wheels, or that do not exist."""
        joints = (*robot.joints, *robot.owned)
        names = self.owns(joints)
        yield from self.wrong_wheels(len(names))
        if not names:
            yield "joints", f"no joint {self.joints!r}; {near_names(self.joints, joints)}"
        for name in names:
            if name not in robot.spinning:
                candidates = ", ".join(robot.spinning) or "there is none"
                required = "continuous joints on the root link that carry no other joint"
                yield "joints", f"found {name}, allowed: {required} ({candidates})"
                return
        if names and not are_independent([robot.spinning[name] for name in names]):
            yield (
                "joints",
                f"the axes of {', '.join(names)} depend on each other, so that torque cannot be shared out",
            )

    def words(self) -> str:
        """The joints and their limits."""
        return f"{self.joints} as reaction wheels, {self.within()}"
