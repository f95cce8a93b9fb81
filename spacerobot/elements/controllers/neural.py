r"""Feed-forward neural network as a controller.

$$ h_0 = y, \qquad h_{k+1} = \sigma(W_k h_k + b_k), \qquad u = S\,\sigma_o(W_n h_n + b_n) $$

$y$ are the measurements that ``inputs`` names, one below the other, $\sigma$ is the activation of the hidden
layers, $\sigma_o$ that of the output layer, and $S$ are the ``scales`` of the ``outputs``. All activations
are smooth, so that the gradient of a rollout by the weights is exact. With $\sigma_o = \tanh$ no command
exceeds its scale.

:mod:`spacerobot.elements.controllers.network_files` reads files of weights. A normalisation of inputs belongs
into the weights and biases of the first layer.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal

import casadi as ca
from pydantic import Field, model_validator

from spacerobot.common.errors import ScenarioError, near_names
from spacerobot.common.section import Name, Section, quantity
from spacerobot.dynamics.rotations import rotation_exp
from spacerobot.elements.controllers.controller import RobotController
from spacerobot.elements.controllers.measurements import first_rotation, robot_values, target_readings
from spacerobot.elements.controllers.network_files import check_chain, read_network
from spacerobot.elements.core.context import RobotContext, TipContext
from spacerobot.elements.core.contribution import CommandedTorque, Contribution
from spacerobot.elements.core.registry import register
from spacerobot.elements.core.robot_element import Part, RobotProperties

JOINT_SIGNALS = ("joint_position", "joint_rate")
Input = Literal[
    "joint_position",
    "joint_rate",
    "base_position",
    "base_orientation",
    "base_velocity",
    "base_spin",
    "tip_position",
    "tip_velocity",
    "tip_orientation",
    "tip_angular_velocity",
    "target_position",
    "target_orientation",
    "target_velocity",
    "target_spin",
]
Command = Literal["joint_torque", "base_force", "base_torque", "tip_force", "tip_torque"]
Activation = Literal["tanh", "softplus", "sigmoid", "silu"]
LayerActivation = Literal["tanh", "softplus", "sigmoid", "silu", "linear"]


def _sigmoid(x: ca.SX) -> ca.SX:
    return 0.5 * (1 + ca.tanh(0.5 * x))


def _softplus(x: ca.SX) -> ca.SX:
    # ln(1 + e^x) - x is below the rounding of x from 40 on
    return ca.if_else(x > 40, x, ca.log1p(ca.exp(ca.fmin(x, 40))))


ACTIVATIONS: Mapping[str, Callable[[ca.SX], ca.SX]] = {
    "tanh": ca.tanh,
    "softplus": _softplus,
    "sigmoid": _sigmoid,
    "silu": lambda x: x * _sigmoid(x),
    "linear": lambda x: x,
}


class NetworkLayer(Section):
    """Layer of a network."""

    weights: tuple[tuple[float, ...], ...] = quantity("1", "matrix, a row for each output", min_length=1)
    biases: tuple[float, ...] = quantity("1", "one for each output; zero if not given", default=())
    activation: LayerActivation | None = Field(
        default=None, description="activation of this layer, if not that of the network"
    )

    @property
    def shape(self) -> tuple[int, int]:
        """Number of outputs and of inputs."""
        return len(self.weights), len(self.weights[0])

    @model_validator(mode="after")
    def _check(self) -> NetworkLayer:
        outputs, inputs = self.shape
        for i, row in enumerate(self.weights):
            if len(row) != inputs or not row:
                raise ValueError(f"weights.{i}: found {len(row)} numbers, allowed: {inputs or 'at least 1'}")
        if self.biases and len(self.biases) != outputs:
            raise ValueError(f"biases: found {len(self.biases)} numbers, allowed: {outputs}, or none")
        return self


@register
class Neural(RobotController):
    """Feed-forward neural network from measurements to joint torques, base wrench or tip force."""

    fills: ClassVar[str | None] = "layers"
    kind: Literal["neural"] = "neural"
    file: str | None = Field(
        default=None,
        min_length=1,
        max_length=4096,
        description="weights, `.safetensors`, `.onnx` or `.npz`: a path in the scenario's folder; "
        "fills in `layers`",
    )
    layers: tuple[NetworkLayer, ...] | None = Field(
        default=None, min_length=1, description="layers from inputs to outputs, if not in a file"
    )
    inputs: tuple[Input, ...] = Field(
        default=("joint_position", "joint_rate"),
        min_length=1,
        description="measurements in the order of the network's inputs, as the robot's sensors show them",
    )
    outputs: tuple[Command, ...] = Field(
        default=("joint_torque",), min_length=1, description="commands in the order of the network's outputs"
    )
    scales: tuple[float, ...] | None = quantity(
        "N m or N", "factor of each of the `outputs`; 1 if not given", default=None
    )
    activation: Activation = Field(default="tanh", description="activation of the hidden layers")
    output_activation: Literal["linear", "tanh"] = Field(
        default="linear", description="activation of the output layer; tanh bounds commands by their scales"
    )
    axes: Literal["base", "world"] = Field(
        default="base",
        description="axes of vectors in inputs and outputs; tip_position is from the origin of these axes, "
        "target_position and target_orientation are from the tip",
    )
    tip: Name | None = Field(
        default=None, description="tip of inputs and outputs that begin with tip_ or target_; the only one"
    )
    frame: str | None = Field(
        default=None, description="link of the target, such as a mating frame, of inputs target_*"
    )

    @model_validator(mode="after")
    def _check(self) -> Neural:
        if self.file is None and self.layers is None:
            raise ValueError("file: which weights? give `file` or `layers`")
        for key in ("inputs", "outputs"):
            names = getattr(self, key)
            for i, name in enumerate(names):
                if name in names[:i]:
                    raise ValueError(f"{key}.{i}: found {name!r} twice, allowed: once")
        if self.scales is not None and len(self.scales) != len(self.outputs):
            raise ValueError(
                f"scales: found {len(self.scales)} numbers, allowed: {len(self.outputs)}, one for each of "
                "`outputs`"
            )
        if self.layers is not None:
            check_chain([layer.shape for layer in self.layers], (f"layers.{i}" for i in itertools.count()))
        return self

    @classmethod
    def read(cls, file: Path, where: str, phase: str | None = None) -> Mapping[str, Any]:
        """Weights and biases of the layers."""
        del where, phase
        return read_network(file)  # type: ignore[return-value]

    @property
    def own_wrench(self) -> frozenset[Part]:
        """Parts of the base wrench among the outputs."""
        parts: dict[str, Part] = {"base_force": "force", "base_torque": "torque"}
        return frozenset(part for name, part in parts.items() if name in self.outputs)

    def build(self, robot: RobotContext) -> Contribution:
        """Torques of the joints, of which a wrench on the base and on the tip are parts.

        Raises:
            ScenarioError: If the weights were not read.
        """
        if self.layers is None:
            raise ScenarioError("weights were not read", where=robot.context.path)
        plant = robot.plant
        axes = plant.placement(robot.base_frame)[0] if self.axes == "base" else ca.SX.eye(3)
        values = self._measured(robot, axes)
        signal = ca.vertcat(*(values[name] for name in self.inputs))
        last = len(self.layers) - 1
        for k, layer in enumerate(self.layers):
            activation = layer.activation or (self.output_activation if k == last else self.activation)
            signal = ACTIVATIONS[activation](_affine(robot, f"layers.{k}", layer, signal))
        commands, first = dict[str, ca.SX](), 0
        for k, (name, size) in enumerate(self._output_sizes(len(robot.joints)).items()):
            scale = ca.SX(1) if self.scales is None else robot.context.number(f"scales.{k}")
            command = scale * signal[first : first + size]
            commands[name] = command if name == "joint_torque" else ca.mtimes(axes, command)
            first += size
        torque = robot.torque(commands.get("joint_torque", ca.SX(len(robot.joints), 1))).value
        none = ca.SX(3, 1)
        wrench = [commands.get(name, none) for name in ("base_force", "base_torque")]
        torque = torque + ca.mtimes(plant.jacobian(robot.base_frame).T, ca.sparsify(ca.vertcat(*wrench)))
        if {"tip_force", "tip_torque"} & set(commands):
            at_tip = self._tip(robot).torque(commands.get("tip_force"), commands.get("tip_torque"))
            torque = torque + at_tip.value
        return Contribution(torques=(CommandedTorque(robot.name, torque),))

    def _measured(self, robot: RobotContext, axes: ca.SX) -> dict[str, ca.SX]:
        """Measured inputs (n x 1) by name; vectors have components along the columns of ``axes``."""
        true, values = robot_values(robot), dict[str, ca.SX]()
        target_values = {} if self.frame is None else self._target(robot)
        origin = robot.plant.placement(robot.base_frame)[1] if self.axes == "base" else ca.SX(3, 1)
        for name in self.inputs:
            if name.startswith("tip_"):
                tip = self._tip(robot)
                value = {
                    "tip_position": tip.position,
                    "tip_velocity": tip.velocity,
                    "tip_orientation": -tip.orientation_error,
                    "tip_angular_velocity": tip.angular_velocity,
                }[name]
                value = tip.read(name, value) - (origin if name == "tip_position" else ca.SX(3, 1))
            elif name.startswith("target_"):
                value = target_values[name]
            else:
                value = robot.read(name, true[name])
            values[name] = value if name in JOINT_SIGNALS else ca.mtimes(axes.T, value)
        return values

    def _target(self, robot: RobotContext) -> dict[str, ca.SX]:
        """Readings of signals of the target, world axes (3x1); position and orientation from the tip."""
        tip, link, values = self._tip(robot), str(self.frame), dict[str, ca.SX]()
        for name, reading in target_readings(robot, tip, link).items():
            if name not in self.inputs:
                continue
            value = tip.read(name, *reading)
            if name == "target_position":
                value = value - tip.position
            elif name == "target_orientation":
                rotation = ca.mtimes(rotation_exp(value), first_rotation(robot, tip, link))
                value = robot.plant.orientation_error(rotation, tip.rotation)
            values[name] = value
        return values

    def _tip(self, robot: RobotContext) -> TipContext:
        name = self.tip or robot.tips[0].label.rpartition("/")[2]
        return next(tip for tip in robot.tips if tip.label == f"{robot.name}/{name}")

    def _input_sizes(self, joints: int) -> dict[str, int]:
        return {name: joints if name in JOINT_SIGNALS else 3 for name in self.inputs}

    def _output_sizes(self, joints: int) -> dict[str, int]:
        return {name: joints if name == "joint_torque" else 3 for name in self.outputs}

    def reads(self) -> set[str]:
        """Signals of the network's inputs."""
        return set(self.inputs)

    def faults(self, robot: RobotProperties) -> Iterable[tuple[str, str]]:
        """Errors: sizes that do not match the robot's measurements and commands, or unknown names."""
        if self.layers is None:
            return
        joints, file = len(robot.joints), f"{self.file}: " if self.file else ""
        names: tuple[str, ...]
        for key, last, sizes, size in (
            ("inputs", 0, self._input_sizes(joints), self.layers[0].shape[1]),
            ("outputs", len(self.layers) - 1, self._output_sizes(joints), self.layers[-1].shape[0]),
        ):
            total = sum(sizes.values())
            if size != total:
                parts = ", ".join(f"{name} {count}" for name, count in sizes.items())
                yield f"layers.{last}", f"{file}found {size} {key}, allowed: {total}, of {parts}"
        if robot.base == "fixed":
            for key, names in (("inputs", self.inputs), ("outputs", self.outputs)):
                for name in (name for name in names if name.startswith("base_")):
                    yield key, f"found {name!r}, but the base of {robot.name} is fixed; leave it out"
        names = (*self.inputs, *self.outputs)
        if any(name.startswith(("tip_", "target_")) for name in names):
            if self.tip is None and len(robot.tips) != 1:
                yield "tip", f"which tip? allowed: {', '.join(robot.tips) or 'none, the robot has no tips'}"
            elif self.tip is not None and self.tip not in robot.tips:
                yield "tip", f"found {self.tip!r}, {near_names(self.tip, robot.tips)}"
        if any(name.startswith("target_") for name in names):
            if not robot.target_links:
                yield "inputs", "found signals of a target, but the scene has none; give `target`"
            elif self.frame not in robot.target_links:
                yield "frame", f"found {self.frame!r}, {near_names(str(self.frame), robot.target_links)}"

    def words(self) -> str:
        """Sizes of its layers."""
        if self.layers is None:
            return "network"
        sizes = [self.layers[0].shape[1], *(layer.shape[0] for layer in self.layers)]
        return f"network {'-'.join(map(str, sizes))}, {self.activation}"


def _affine(robot: RobotContext, key: str, layer: NetworkLayer, signal: ca.SX) -> ca.SX:
    """W h + b of a layer (n x 1); weights that are exactly zero and do not vary are structural zeros."""

    def number(path: str) -> ca.SX:
        return ca.SX(1, 1) if robot.context.is_zero(path) else robot.context.number(path)

    outputs, inputs = layer.shape
    rows = []
    for i in range(outputs):
        weights = ca.horzcat(*(number(f"{key}.weights.{i}.{j}") for j in range(inputs)))
        bias = number(f"{key}.biases.{i}") if layer.biases else ca.SX(1, 1)
        rows.append(ca.mtimes(weights, signal) + bias)
    return ca.densify(ca.vertcat(*rows))
