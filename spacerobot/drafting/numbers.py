"""Gains, a reference and steps that suit a scene: from its inertia, joint rates and efforts at the start.

Let W be the response of all velocities to generalised forces, bases free and grasps closed, and J a tip's
Jacobian, J_a its columns of the arm's joints. The PID acts by ``tau = J_a^T u``, so the tip accelerates by
``J W J_a^T u``: the inverse of its mean eigenvalue is the *effective mass* m that the controller feels.
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

DEFAULT_BANDWIDTH = 2.0  # [rad/s] where the URDF has no limits
BANDWIDTHS = (0.5, 10.0)  # [rad/s]
SHARE_OF_RATE = 0.1  # of a joint's greatest rate that the reference may ask for
JOINT_TRAVEL = 0.3  # [rad] or, of prismatic joints, [m], that the reference may ask for
PERIODS = 12.0  # of 1 / bandwidth that a reference takes at least
GUIDANCE, RATES = (0.5, 2.0), 5.0
"""Range of the gain of resolved rates [1/s], and their rate gain in parts of it."""
LONGEST = 120.0  # [s] of a reference
SPAN = 10.0
"""Bounds of a gain: this factor below and above what is proposed."""


@dataclass(frozen=True)
class Gains:
    """Proposed gains of one arm.

    Attributes:
        bandwidth: Rate at which the arm's slowest joint comes to its greatest speed by its greatest effort
            [rad/s].
        mass, inertia: Effective mass [kg] and inertia [kg m^2] at the tip; the latter None if orientation is
            not controlled.
        joint_inertia: Least effective inertia of a joint, for damping in the null space that makes no joint
            faster than the bandwidth; None if there is no null space.
        slowdown: Factor by which the bandwidth is divided in what follows from it.
    """

    bandwidth: float
    mass: float
    inertia: float | None
    joint_inertia: float | None
    slowdown: float = 1.0

    def slowed(self, slowdown: float) -> Gains:
        """The same with a bandwidth divided by a factor."""
        return replace(self, slowdown=slowdown)

    @property
    def guidance(self) -> float:
        """Gain of resolved rates [1/s], before it is slowed down within :data:`GUIDANCE`."""
        return short(float(np.clip(self.bandwidth, *GUIDANCE)) / self.slowdown, 2)

    def pid(self, mass: float) -> dict[str, float]:
        """K_p = m w and K_i = m w^2 / 4: both poles of the tip's velocity loop at -w/2."""
        w = self.bandwidth / self.slowdown
        return {"kp": short(mass * w), "ki": short(mass * w**2 / 4)}


@dataclass(frozen=True)
class DraftMotion:
    """A line of a tip or of the target: displacement [m] and duration [s]."""

    displacement: tuple[float, float, float]
    duration: float


class DraftNumbers:
    """Basis of the draft's numbers: the scene's initial state.

    Args:
        scene: The scene, its controllers without gains.
        arms: Its robots by name.
    """

    def __init__(self, scene: Scene, arms: Mapping[str, DraftArm]) -> None:
        self.scene, self.arms = scene, arms
        # accelerations for generalised forces (nv, nv), grasps closed; zero for joints that mimic
        upper = np.triu(pin.crba(scene.model, scene.model.createData(), scene.q))
        free = scene.spread[:, np.diag(scene.spread) > 0]
        inverse = free @ np.linalg.inv(free.T @ (upper + np.triu(upper, 1).T) @ free) @ free.T
        if not scene.grasps:
            self.response = np.asarray(inverse)
        else:
            rows = np.vstack([relative_jacobian(scene, grasp) for grasp in scene.grasps])
            held = inverse @ rows.T
            self.response = np.asarray(inverse - held @ np.linalg.pinv(rows @ held, rcond=1e-10) @ held.T)

    def gains(self, tip: SceneTip) -> Gains:
        """Proposed gains for the arm of a tip."""
        arm, columns = self.arms[tip.body.name], self._columns(tip)
        jacobian = self._jacobian(tip)
        linear, angular = self.scene.translation_axes, [3 + a for a in self.scene.rotation_axes]
        directions = len(linear) + len(angular) * arm.turns
        effective = 1 / np.diag(self.response)[columns]
        known = [
            joint.effort / (inertia * joint.velocity)
            for joint, inertia in zip(_free(arm), effective, strict=True)
            if np.isfinite(joint.effort * joint.velocity) and joint.effort > 0 and joint.velocity > 0
        ]
        bandwidth = short(float(np.clip(min(known), *BANDWIDTHS)), 2) if known else DEFAULT_BANDWIDTH
        return Gains(
            bandwidth,
            self._effective(jacobian[list(linear)], columns),
            self._effective(jacobian[angular], columns) if arm.turns else None,
            float(effective.min()) if len(columns) > directions else None,
        )

    def move(self, bandwidth: float, direction: Array | None = None) -> DraftMotion:
        """A line short and slow enough for every arm and for a bandwidth [rad/s].

        It goes along a direction (3,), equally along all axes if none is given.
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
        # a cubic blend's greatest speed is 1.5 times its mean
        slow = max(1.5 * length * rate / SHARE_OF_RATE, PERIODS / bandwidth)
        duration = float(np.clip(np.ceil(slow), 8, LONGEST))
        x, y, z = (short(length * a, 2) for a in direction)
        return DraftMotion((x, y, z), duration)

    def step(self, gains: Mapping[str, Gains], factor: float) -> float:
        """Step [s] that resolves the fastest rate with the gains times a factor; at most 4 ms."""
        model = self.scene.model
        force = np.diag(np.array(model.damping))
        for tip in self.scene.tips:
            found, jacobian, columns = gains[tip.label], self._jacobian(tip), self._columns(tip)
            masses = [found.mass] * 3 + [found.inertia or 0.0] * 3
            kp = factor * found.bandwidth * np.array(masses)
            arm = np.zeros_like(jacobian)
            arm[:, columns] = jacobian[:, columns]
            force = force + arm.T @ (kp[:, None] * jacobian)
        rate = float(np.abs(np.linalg.eigvals(self.response @ force)).max())
        return min(0.004, short(0.8 / max(rate, 1e-9), 1))

    def _effective(self, rows: Array, columns: list[int]) -> float:
        """Inverse of the mean eigenvalue of ``J W J_a^T``."""
        moved = float(np.trace(rows @ self.response[:, columns] @ rows[:, columns].T)) / len(rows)
        alone = float(np.trace(rows @ self.response @ rows.T)) / len(rows)
        return 1 / (moved if moved > 0.01 * alone else alone)

    def _rates(self, tip: SceneTip, direction: Array) -> Array:
        """Least joint rates of all arms that carry a tip along a direction without turning it.

        Bases give way: velocities are those that joint torques can bring about from rest.
        """
        columns = [column for other in self.scene.tips for column in self._columns(other)]
        drive = self.response[:, columns]
        moving = drive @ np.linalg.pinv(drive[columns], rcond=1e-9)
        axes = [*self.scene.translation_axes, *(3 + a for a in self.scene.rotation_axes)]
        axes = axes if self.arms[tip.body.name].turns else list(self.scene.translation_axes)
        wanted = np.array([*direction, 0.0, 0.0, 0.0])[axes]
        rates = np.linalg.pinv(self._jacobian(tip)[axes] @ moving, rcond=1e-6) @ wanted
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
    """Value rounded to a few digits."""
    return float(f"{value:.{digits}g}")


def payload_of(held: Scene) -> Document:
    """Keys of the object as payload, in axes of the tip that holds it."""
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
