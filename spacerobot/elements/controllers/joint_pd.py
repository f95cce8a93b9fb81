r"""Joint PD towards the inverse kinematics of the references (Eq. 34, Fig. 1).

$$ \tau_i = K_{p2}\,(\theta_{d,i} - \theta_i) - K_{d2}\,\dot\theta_i $$

The desired joint positions $\theta_d$ are states of the controller. It solves the inverse kinematics of its
references by closed-loop resolved rates, as a robot does that takes its base to be at its initial pose:

$$ \dot\theta_d = J^+ \bigl( \dot x_\text{ref} + k\,(x_\text{ref} - x(\theta_d)) \bigr), \qquad
   J^+ = J^\top (J J^\top + \lambda^2 I)^{-1} $$
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

import casadi as ca
from pydantic import Field

from spacerobot.common.section import quantity
from spacerobot.dynamics import forward_kinematics, frame_jacobian, frame_placement
from spacerobot.dynamics.algebra import SymmetricFactors
from spacerobot.elements.controllers.controller import RobotController
from spacerobot.elements.core.context import RobotContext
from spacerobot.elements.core.contribution import Contribution, State
from spacerobot.elements.core.registry import register
from spacerobot.elements.core.robot_element import RobotProperties
from spacerobot.elements.sensors.joint_position import joint_position, read_positions


@register
class JointPd(RobotController):
    """Joint PD towards the inverse kinematics of the reference (Eq. 34)."""

    kind: Literal["joint_pd"] = "joint_pd"
    kp: float = quantity("N m/rad or N/m", "proportional gain K_p2", default=0.0, ge=0)
    kd: float = quantity("N m s/rad or N s/m", "derivative gain K_d2", default=0.0, ge=0)
    null_space: bool = Field(
        default=False,
        description="only the part of the torque that does not accelerate the robot's tips; the "
        "robot needs more joints than controlled directions",
    )
    ik_rate: float = quantity(
        "1/s", "rate at which the inverse kinematics removes its position error", default=10.0, ge=0
    )
    ik_damping: float = quantity("m", "damping of the inverse kinematics' pseudo-inverse", default=1e-3, ge=0)

    def build(self, robot: RobotContext) -> Contribution:
        """Torques, and the desired joint positions as states."""
        plant, model = robot.plant, robot.plant.model
        kp, kd = robot.context.number("kp"), robot.context.number("kd")
        name = f"{robot.name}/{robot.key}.theta_d"
        desired = ca.SX.sym(name, len(robot.joints))
        rate = _inverse_kinematics(robot, desired)
        speeds = robot.read("joint_rate", plant.v[list(robot.columns)])
        torques = [
            kp * (desired[i] - position) - kd * speeds[i]  # Eq. 34
            for i, position in enumerate(read_positions(robot, desired))
        ]
        initial = ca.vertcat(*(joint_position(model, joint, plant.q) for joint in robot.joints))
        state = State(name, desired, initial, rate)
        torque = robot.torque(ca.vertcat(*torques), null_space=self.null_space)
        return Contribution(states=(state,), torques=(torque,))

    def reads(self) -> set[str]:
        """Joint positions and rates."""
        return {"joint_position", "joint_rate"}

    def words(self) -> str:
        """Gains."""
        return f"{self.kp:g} / {self.kd:g}" + (", in the null space" if self.null_space else "")

    def faults(self, robot: RobotProperties) -> Iterable[tuple[str, str]]:
        """A null space that does not exist."""
        if not self.null_space:
            return
        directions, joints = robot.moved.shape
        if robot.rank < directions:
            yield (
                "null_space",
                f"{robot.name} has no null space: its {joints} joints move {directions} controlled "
                f"directions of its tips, of which {robot.rank} are independent in the initial posture; "
                "leave `null_space` out, or control fewer directions",
            )

    def cautions(self, robot: RobotProperties) -> Iterable[str]:
        """Warning if the tips' tasks leave no null space."""
        if not self.null_space:
            return
        directions, joints = robot.moved.shape
        if directions == joints:
            yield (
                f"without effect, for its {joints} joints move as many controlled directions of its tips; "
                "`null_space` leaves nothing"
            )


def _inverse_kinematics(robot: RobotContext, desired: ca.SX) -> ca.SX:
    """Rate of the desired joint positions (n x 1); zero for a robot without tips."""
    if not robot.tips:
        return ca.SX.zeros(desired.size1())
    model = robot.plant.model
    rate_gain, damping = robot.context.number("ik_rate"), robot.context.number("ik_damping")
    q = robot.context.once("start", robot.start.q)
    for joint, position in robot.positions(desired).items():
        pin_joint = model.joints[joint]
        if pin_joint.nq == 2:
            q[pin_joint.idx_q : pin_joint.idx_q + 2] = ca.vertcat(ca.cos(position), ca.sin(position))
        else:
            q[pin_joint.idx_q] = position
    # jacobian rows and desired velocities of all tips: positions, and orientations where controlled
    kinematics = forward_kinematics(model, q)
    plant, rows, tip_velocities = robot.plant, [], []
    for tip in robot.tips:
        motion = tip.motion
        jacobian = frame_jacobian(plant.model, kinematics, tip.frame)
        tip_rotation, position = frame_placement(plant.model, kinematics, tip.frame)
        axes = list(plant.translation_axes)
        rows.append(jacobian[axes, :])
        tip_velocities.append((motion.velocity + rate_gain * (motion.position - position))[axes])
        if "orientation_pid" in tip.siblings:
            axes = list(plant.rotation_axes)
            error = plant.orientation_error(motion.rotation, tip_rotation)
            rows.append(jacobian[[axis + 3 for axis in axes], :])
            tip_velocities.append((motion.angular_velocity + rate_gain * error)[axes])
    jacobian = robot.plant.gathered(ca.vertcat(*rows).T).T[:, list(robot.columns)]
    gram = ca.mtimes(jacobian, jacobian.T) + damping**2 * ca.SX.eye(jacobian.size1())
    return ca.mtimes(jacobian.T, SymmetricFactors(gram).solve(ca.vertcat(*tip_velocities)))
