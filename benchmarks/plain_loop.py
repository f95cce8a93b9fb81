"""The paper's closed loop in plain Python: ``pin.aba`` in an RK4 loop.

It is specific to this scenario (planar, compliant grasps, ideal derivative, feedback relative to the base),
with as few Python operations in the loop as a careful user would write.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from spacerobot.scene import Scene

WORLD = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


class PlainLoop:
    """Closed loop with the state x = (q, v, memory and integral of each tip), without an energy balance."""

    def __init__(self, scene: Scene) -> None:
        self.model, self.data, self.scene = scene.model, scene.model.createData(), scene
        pin.framesForwardKinematics(self.model, self.data, scene.q)
        self.tips = []
        for tip in scene.tips:
            columns = [self.model.joints[j].idx_v for j in tip.body.joints]
            start = self.data.oMf[tip.frame].translation[:2].copy()
            law = tip.config.pid, tip.config.amnesia, tip.reference
            self.tips.append((tip.frame, tip.body.root_frame, columns, start, *law))
        self.grasps = [(g.tip.frame, g.frame, g.config.stiffness, g.config.damping) for g in scene.grasps]
        self.x0 = np.concatenate([scene.q, scene.v, np.zeros(4 * len(self.tips))])

    def __call__(self, t: float, x: np.ndarray) -> np.ndarray:
        """Rate of x."""
        model, data, nq, nv = self.model, self.data, self.model.nq, self.model.nv
        q, v, z = x[:nq], x[nq : nq + nv], x[nq + nv :]
        pin.forwardKinematics(model, data, q, v, np.zeros(nv))
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        force = -model.damping * v
        for tip, mate, stiffness, damping in self.grasps:
            j_tip = pin.getFrameJacobian(model, data, tip, WORLD)[:2]
            j_mate = pin.getFrameJacobian(model, data, mate, WORLD)
            gap = data.oMf[tip].translation[:2] - data.oMf[mate].translation[:2]
            relative = j_tip - j_mate[:2] - np.outer([-gap[1], gap[0]], j_mate[5])
            force -= relative.T @ (stiffness * gap + damping * (relative @ v))
        inverse = pin.computeMinverse(model, data, q)
        controls = [self._control(t, v, z[4 * i : 4 * i + 4], tip) for i, tip in enumerate(self.tips)]
        free = pin.aba(model, data, q, v, force)
        acceleration, rates = free.copy(), []
        for (columns, arm, command, kd), rate in controls:
            response = inverse[:, columns] @ arm.T
            output = np.linalg.solve(
                np.eye(2) + kd * arm @ response[columns], command - kd * (arm @ free[columns])
            )
            acceleration += response @ output
            rates.append(rate)
        return np.concatenate([configuration_rate(model, q, v), acceleration, *rates])

    def _control(self, t: float, v: np.ndarray, z: np.ndarray, tip: tuple[Any, ...]) -> Any:
        frame, base, columns, start, pid, amnesia, circle = tip
        data = self.data
        arm = pin.getFrameJacobian(self.model, data, frame, WORLD)[:2][:, columns]
        position = data.oMf[frame].translation[:2]
        at_base = pin.getFrameVelocity(self.model, data, base, WORLD)
        velocity = pin.getFrameVelocity(self.model, data, frame, WORLD).linear[:2]
        drift = pin.getFrameClassicalAcceleration(self.model, data, frame, WORLD).linear[:2]
        base_drift = pin.getFrameClassicalAcceleration(self.model, data, base, WORLD).linear[:2]
        spin, relative = at_base.angular[2], velocity - at_base.linear[:2]
        seen_drift = drift - base_drift - spin * np.array([-relative[1], relative[0]])
        # the circle's position, velocity and acceleration
        tf, turn = circle.duration, np.radians(circle.end_deg - circle.start_deg)
        s, first = min(t / tf, 1.0), np.radians(circle.start_deg)
        delta = first + turn * s * s * (3 - 2 * s)
        rate, acceleration = turn * 6 * s * (1 - s) / tf, turn * (6 - 12 * s) / tf**2 * (t < tf)
        along, across = np.array([np.cos(delta), np.sin(delta)]), np.array([-np.sin(delta), np.cos(delta)])
        reference = (
            start + circle.radius * (along - np.array([np.cos(first), np.sin(first)])),
            circle.radius * rate * across,
            circle.radius * (acceleration * across - rate**2 * along),
        )
        error = reference[0] - position
        memory, integral = z[:2], z[2:]
        memory_rate = error - amnesia.ta * memory
        e = reference[1] + amnesia.ge * memory - arm @ v[columns]
        command = (
            pid.kp * e + pid.ki * integral + pid.kd * (reference[2] + amnesia.ge * memory_rate - seen_drift)
        )
        return (columns, arm, command, pid.kd), np.concatenate([memory_rate, e])

    def run(self, duration_s: float, step_s: float) -> np.ndarray:
        """Final state after classical Runge-Kutta steps."""
        x, h = self.x0.copy(), step_s
        for k in range(round(duration_s / h)):
            t = k * h
            k1 = self(t + 1e-9 * h, x)
            k2 = self(t + h / 2, x + h / 2 * k1)
            k3 = self(t + h / 2, x + h / 2 * k2)
            k4 = self(t + h - 1e-9 * h, x + h * k3)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            x[: self.model.nq] = pin.normalize(self.model, x[: self.model.nq])
        return x


def configuration_rate(model: pin.Model, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Rate of q, whose planar joints have x, y, cosine and sine (nq,)."""
    rate = np.empty(model.nq)
    for joint in model.joints[1:]:
        i, k = joint.idx_q, joint.idx_v
        if joint.nq == 1:
            rate[i] = v[k]
        else:
            c, s, w = q[i + 2], q[i + 3], v[k + 2]
            rate[i : i + 4] = c * v[k] - s * v[k + 1], s * v[k] + c * v[k + 1], -s * w, c * w
    return rate
