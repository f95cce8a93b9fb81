"""A neural network as a controller, by numpy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.elements.controllers.neural import Neural
from spacerobot.scene import Scene, SceneBody
from tests.oracles.engine.kinematics import Kinematics, rotation_vector
from tests.oracles.engine.robot_law import Asked, Asking, RobotLaw, robot_law

ACTIVATIONS = {
    "tanh": np.tanh,
    "softplus": lambda x: np.logaddexp(0, x),
    "sigmoid": lambda x: 1 / (1 + np.exp(-x)),
    "silu": lambda x: x / (1 + np.exp(-x)),
    "linear": lambda x: x,
}


@dataclass(frozen=True)
class Network:
    """A robot whose joints and base obey a network, with ideal sensors."""

    scene: Scene
    body: SceneBody
    config: Neural
    state_names: ClassVar[tuple[str, ...]] = ()
    ends: ClassVar[tuple[float, ...]] = ()

    def initial(self, kinematics: Kinematics) -> Array:
        """No states."""
        del kinematics
        return np.empty(0)

    def ask(self, now: Asking, states: Array) -> Asked:
        """Torques of the network's outputs."""
        kinematics, config = now.kinematics, self.config
        base, tip = kinematics.frame(self.body.root_frame), kinematics.frame(self._tip.frame)
        axes = base.rotation if config.axes == "base" else np.eye(3)
        signals = self._signals(now, axes)
        h = np.concatenate([signals[name] for name in config.inputs])
        for k, layer in enumerate(config.layers):
            name = layer.activation or (
                config.output_activation if k == len(config.layers) - 1 else config.activation
            )
            h = ACTIVATIONS[name](np.array(layer.weights) @ h + np.array(layer.biases))
        effort = np.zeros(self.scene.model.nv)
        columns = [int(self.scene.model.idx_vs[joint]) for joint in self.body.driven_joints]
        rows = {"base_force": base.jacobian[:3], "base_torque": base.jacobian[3:]}
        arm = np.zeros_like(tip.jacobian)
        arm[:, columns] = tip.jacobian[:, columns]
        rows |= {"tip_force": arm[:3], "tip_torque": arm[3:]}
        for scale, name in zip(config.scales, config.outputs, strict=True):
            size = len(columns) if name == "joint_torque" else 3
            command, h = scale * h[:size], h[size:]
            if name == "joint_torque":
                effort[columns] += command
            else:
                effort += rows[name].T @ axes @ command
        return Asked(effort, states)

    @property
    def _tip(self):
        return next(tip for tip in self.scene.tips if tip.body is self.body)

    def _signals(self, now: Asking, axes: Array) -> dict[str, Array]:
        """Every input, vectors along the columns of ``axes``."""
        model, kinematics = self.scene.model, now.kinematics
        joints = self.body.driven_joints
        at_start = Kinematics(model, np.array(self.scene.q), np.zeros(model.nv)).frame(self.body.root_frame)
        base, tip = kinematics.frame(self.body.root_frame), kinematics.frame(self._tip.frame)
        origin = base.position if self.config.axes == "base" else np.zeros(3)
        angles = [
            np.arctan2(kinematics.q[i + 1], kinematics.q[i]) if model.joints[j].nq == 2 else kinematics.q[i]
            for j in joints
            for i in [model.joints[j].idx_q]
        ]
        vectors = {
            "base_position": base.position,
            "base_orientation": rotation_vector(base.rotation, at_start.rotation),
            "base_velocity": base.velocity[:3],
            "base_spin": base.velocity[3:],
            "tip_position": tip.position - origin,
            "tip_velocity": tip.velocity[:3],
            "tip_orientation": -rotation_vector(now.motions[self._tip.label].rotation, tip.rotation),
            "tip_angular_velocity": tip.velocity[3:],
        }
        if self.config.frame:
            seen = kinematics.frame(model.getFrameId(f"target/{self.config.frame}"))
            vectors |= {
                "target_position": seen.position - tip.position,
                "target_orientation": rotation_vector(seen.rotation, tip.rotation),
                "target_velocity": seen.velocity[:3],
                "target_spin": seen.velocity[3:],
            }
        signals = {name: axes.T @ vector for name, vector in vectors.items()}
        rates = kinematics.v[[int(model.idx_vs[joint]) for joint in joints]]
        return signals | {"joint_position": np.array(angles), "joint_rate": rates}


@robot_law.register
def _(controller: Neural, scene: Scene, body: SceneBody, key: str) -> RobotLaw:
    del key
    return Network(scene, body, controller)
