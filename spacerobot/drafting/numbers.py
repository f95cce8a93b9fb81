"""Gains, reference motion and steps of a draft, from the initial inertia and the joints' rate and effort
limits.

Let W be the matrix from generalised forces to accelerations with free bases and closed grasps, J a tip's
Jacobian and J_a its columns of the arm's joints. The PID commands ``tau = J_a^T u``, so that the tip
accelerates by ``J W J_a^T u``. The inverse of the mean eigenvalue of this matrix is the *effective mass* m at
the tip.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from spacerobot.common.arrays import Array
from spacerobot.description.parts import UrdfJoint
from spacerobot.drafting.arms import DraftArm
from spacerobot.scenario.paths import Document
from spacerobot.scene.configure import relative_jacobian
from spacerobot.scene.scene import Scene, SceneTip

DEFAULT_BANDWIDTH = 2.0  # bandwidth if the URDF has no limits [rad/s]
BANDWIDTHS = (0.5, 10.0)  # range of bandwidths [rad/s]
SHARE_OF_RATE = 0.1  # maximum joint rate of the reference, relative to the joint's limit
JOINT_TRAVEL = 0.3  # maximum joint travel of the reference [rad or m]
PERIODS = 12.0  # minimum duration of the reference, in units of 1 / bandwidth
GUIDANCE, RATES = (0.5, 2.0), 5.0
"""Range of the gain of resolved rates [1/s], and ratio of their rate gain to the gain."""
LONGEST = 120.0  # maximum duration of the reference [s]
SPAN = 10.0
"""Factor between a proposed gain and its bounds in tuning."""


@dataclass(frozen=True)
class Gains:
    """Proposed gains of one arm.

    Attributes:
        bandwidth: Minimum over the joints of effort limit / (effective inertia * rate limit) [rad/s]: the
            inverse of the time in which the slowest joint reaches its rate limit by its effort limit.
        mass, inertia: Effective mass [kg] and inertia [kg m^2] at the tip; the latter is None if the
            orientation is not controlled.
        joint_inertia: Smallest effective inertia of a joint, from which null-space damping follows such that
            no joint is faster than the bandwidth; None without a null space.
        slowdown: Factor by which the bandwidth is divided in all gains.
    """

    bandwidth: float
    mass: float
    inertia: float | None
    joint_inertia: float | None
    slowdown: float = 1.0

    def slowed(self, slowdown: float) -> Gains:
        """Gains with another slowdown."""
        return replace(self, slowdown=slowdown)

    @property
    def guidance(self) -> float:
        """Gain of resolved rates [1/s]: bandwidth, limited to :data:`GUIDANCE`, divided by the slowdown."""
        return short(float(np.clip(self.bandwidth, *GUIDANCE)) / self.slowdown, 2)

    def pid(self, mass: float) -> dict[str, float]:
        """PID gains K_p = m w and K_i = m w^2 / 4, which place both poles of the tip's velocity loop at -w/2.

        The velocity of a mass m under u = -K_p v - K_i x has the characteristic polynomial
        m s^2 + K_p s + K_i = m (s + w/2)^2.
        """
        w = self.bandwidth / self.slowdown
        return {"kp": short(mass * w), "ki": short(mass * w**2 / 4)}


@dataclass(frozen=True)
class DraftMotion:
    """Straight reference motion: displacement [m] and duration [s]."""

    displacement: tuple[float, float, float]
    duration: float


class DraftNumbers:
    """Proposed gains, motions and steps, from the scene's initial state.

    Attributes:
        scene, arms: As for the constructor.
        response: Accelerations for generalised forces W, with closed grasps (nv, nv).

    Args:
        scene: The scene; its gains are not used.
        arms: Robots by name.
    """

    def __init__(self, scene: Scene, arms: Mapping[str, DraftArm]) -> None:
        self.scene, self.arms = scene, arms
        # W = M^-1 - M^-1 R' (R M^-1 R')^+ R M^-1 with the constraint rows R of the grasps; M^-1 of the
        # independent joints, mapped to all joints
        upper = np.triu(pin.crba(scene.model, scene.model.createData(), scene.q))
        free = scene.spread[:, np.diag(scene.spread) > 0]
        inverse = free @ np.linalg.inv(free.T @ (upper + np.triu(upper, 1).T) @ free) @ free.T
        if not scene.grasps:
            self.response = np.asarray(inverse)
        else:
            rows = np.vstack([relative_jacobian(scene, grasp) for grasp in scene.grasps])
            columns = inverse @ rows.T
            constrained = columns @ np.linalg.pinv(rows @ columns, rcond=1e-10) @ columns.T
            self.response = np.asarray(inverse - constrained)

    def gains(self, tip: SceneTip) -> Gains:
        """Proposed gains for the arm of a tip."""
        arm, columns = self.arms[tip.body.name], self._columns(tip)
        jacobian = self._jacobian(tip)
        linear, angular = self.scene.translation_axes, [3 + a for a in self.scene.rotation_axes]
        directions = len(linear) + len(angular) * arm.turns
        effective = 1 / np.diag(self.response)[columns]
        rates = [
            joint.effort / (inertia * joint.velocity)
            for joint, inertia in zip(_free(arm), effective, strict=True)
            if np.isfinite(joint.effort * joint.velocity) and joint.effort > 0 and joint.velocity > 0
        ]
        bandwidth = short(float(np.clip(min(rates), *BANDWIDTHS)), 2) if rates else DEFAULT_BANDWIDTH
        return Gains(
            bandwidth,
            self._effective(jacobian[list(linear)], columns),
            self._effective(jacobian[angular], columns) if arm.turns else None,
            float(effective.min()) if len(columns) > directions else None,
        )

    def move(self, bandwidth: float, direction: Array | None = None) -> DraftMotion:
        """Straight reference motion that is short and slow enough for every arm.

        Args:
            bandwidth: Bandwidth of the slowest arm [rad/s].
            direction: Unit vector of the motion, world axes (3,); equal components along all axes if None.
        """
        axes = list(self.scene.translation_axes)
        if direction is None:
            direction = np.zeros(3)
            direction[axes] = 1 / np.sqrt(len(axes))
        travel, rate, reach = 0.0, 0.0, np.inf
        for tip in self.scene.tips:
            arm, columns = self.arms[tip.body.name], self._columns(tip)
            speeds = np.abs(self._rates(tip, direction)[columns])  # per m/s of the tip
            travel = max(travel, float(speeds.max()))
            limits = [joint.velocity for joint in _free(arm)]
            rate = max(
                rate, *(float(s / limit) for s, limit in zip(speeds, limits, strict=True) if limit > 0)
            )
            # distance of a tip from its robot's root link at the start [m]
            data = self.scene.model.createData()
            pin.framesForwardKinematics(self.scene.model, data, self.scene.q)
            ends = data.oMf[tip.frame].translation - data.oMf[tip.body.root_frame].translation
            reach = min(reach, float(np.linalg.norm(ends)))
        length = min(0.1 * reach, JOINT_TRAVEL / max(travel, 1e-9))
        # the peak speed of a cubic blend is 1.5 times its mean
        slow = max(1.5 * length * rate / SHARE_OF_RATE, PERIODS / bandwidth)
        duration = float(np.clip(np.ceil(slow), 8, LONGEST))
        x, y, z = (short(length * a, 2) for a in direction)
        return DraftMotion((x, y, z), duration)

    def step(self, gains: Mapping[str, Gains], factor: float) -> float:
        """Step [s] that resolves the fastest rate of the loop; at most 4 ms.

        Args:
            gains: Gains by tip.
            factor: Factor of the gains.
        """
        model = self.scene.model
        force = np.diag(np.array(model.damping))
        for tip in self.scene.tips:
            gain, jacobian, columns = gains[tip.label], self._jacobian(tip), self._columns(tip)
            masses = [gain.mass] * 3 + [gain.inertia or 0.0] * 3
            kp = factor * gain.bandwidth * np.array(masses)
            arm = np.zeros_like(jacobian)
            arm[:, columns] = jacobian[:, columns]
            force = force + arm.T @ (kp[:, None] * jacobian)
        rate = float(np.abs(np.linalg.eigvals(self.response @ force)).max())
        return min(0.004, short(0.8 / max(rate, 1e-9), 1))

    def _effective(self, rows: Array, columns: list[int]) -> float:
        """Inverse of the mean eigenvalue of ``J W J_a^T``; of ``J W J^T`` if the arm hardly moves the tip."""
        by_arm = float(np.trace(rows @ self.response[:, columns] @ rows[:, columns].T)) / len(rows)
        by_all = float(np.trace(rows @ self.response @ rows.T)) / len(rows)
        return 1 / (by_arm if by_arm > 0.01 * by_all else by_all)

    def _rates(self, tip: SceneTip, direction: Array) -> Array:
        """Velocities (nv,) of minimum joint rates that move a tip along a direction without rotating it.

        Floating bases react: the velocities are those that joint torques can produce from rest.
        """
        columns = [column for other in self.scene.tips for column in self._columns(other)]
        drive = self.response[:, columns]
        moving = drive @ np.linalg.pinv(drive[columns], rcond=1e-9)
        axes = [*self.scene.translation_axes, *(3 + a for a in self.scene.rotation_axes)]
        axes = axes if self.arms[tip.body.name].turns else list(self.scene.translation_axes)
        twist = np.array([*direction, 0.0, 0.0, 0.0])[axes]
        rates = np.linalg.pinv(self._jacobian(tip)[axes] @ moving, rcond=1e-6) @ twist
        return np.asarray(moving @ rates)

    def _columns(self, tip: SceneTip) -> list[int]:
        model, body = self.scene.model, tip.body
        ids = [model.getJointId(f"{body.name}/{joint.name}") for joint in _free(self.arms[body.name])]
        return [int(model.idx_vs[joint]) for joint in ids]

    def _jacobian(self, tip: SceneTip) -> Array:
        model, data = self.scene.model, self.scene.model.createData()
        pin.computeJointJacobians(model, data, self.scene.q)
        pin.updateFramePlacements(model, data)
        world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        return np.asarray(pin.getFrameJacobian(model, data, tip.frame, world) @ self.scene.spread)


def _free(arm: DraftArm) -> list[UrdfJoint]:
    return [joint for joint in arm.chain if joint.name in arm.joints]


def short(value: float, digits: int = 3) -> float:
    """Value rounded to a few significant digits."""
    return float(f"{value:.{digits}g}")


def payload_of(held: Scene) -> Document:
    """Payload keys of the object: mass, centre of mass and inertia in the frame of the tip that holds it."""
    data, frame = held.model.createData(), held.grasps[0].tip.frame
    pin.framesForwardKinematics(held.model, data, held.q)
    bodies = [data.oMi[joint].act(held.model.inertias[joint]) for joint in held.bodies[-1].subtree]
    inertia = data.oMf[frame].actInv(sum(bodies[1:], bodies[0]))
    about = inertia.inertia
    moments = [float(about[place]) for place in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    digits = 3 - int(np.floor(np.log10(max(moments))))  # four of the largest
    return {
        "payload_mass": short(float(inertia.mass), 4),
        "payload_com": [round(float(x), 4) + 0.0 for x in inertia.lever],
        "payload_inertia": [round(x, digits) + 0.0 for x in moments],
    }
