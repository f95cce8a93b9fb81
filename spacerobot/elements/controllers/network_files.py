"""Files of neural networks: arrays of ``safetensors`` and numpy's ``npz``, and graphs of ``onnx``.

A file of arrays has, for each layer, a matrix ``*.weight`` (outputs, inputs) and a vector ``*.bias``
(outputs,), which may be left out: the state of PyTorch's ``Sequential``. Layers are in the order of the
numbers in their names.

A graph is a chain of layers from its input to its output, with the activations that it names. Where its last
layer has none, the section's ``output_activation`` applies.
"""

from __future__ import annotations

import itertools
import re
import zipfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.errors import ScenarioError
from spacerobot.common.optional import optional_module
from spacerobot.common.section import LARGEST

MOST_WEIGHTS = 50_000
"""Largest number of weights and biases: each is a number of the scenario, and an operation of the compiled
loop."""
MOST_BYTES = 10_000_000

ACTIVATION_NODES = {"Tanh": "tanh", "Sigmoid": "sigmoid", "Softplus": "softplus"}
"""Activations by their node in a graph; the product of x and Sigmoid(x) is silu."""
NEUTRAL_NODES = ("Identity", "Flatten", "Dropout")
"""Nodes that do not change a vector."""
CHAIN = "a chain of Gemm, or of MatMul and Add, with constants, each followed by at most one of "
CHAIN += f"{', '.join(ACTIVATION_NODES)} and x Sigmoid(x)"


def check_chain(shapes: Sequence[tuple[int, int]], names: Iterable[str]) -> None:
    """Check that each layer has as many inputs as the preceding layer has outputs.

    Args:
        shapes: Number of outputs and of inputs of each layer.
        names: Name of each layer in messages.

    Raises:
        ValueError: If a layer does not fit, which the message names, or there are too many weights.
    """
    labels = [name for _, name in zip(shapes, names, strict=False)]
    for (before, after), (first, second) in zip(
        itertools.pairwise(shapes), itertools.pairwise(labels), strict=True
    ):
        if after[1] != before[0]:
            raise ValueError(
                f"{second}: found shape ({after[0]}, {after[1]}), allowed: ({after[0]}, {before[0]}), "
                f"for {first} has {before[0]} outputs"
            )
    count = sum(outputs * (inputs + 1) for outputs, inputs in shapes)
    if count > MOST_WEIGHTS:
        raise ValueError(f"found {count} weights and biases, allowed: at most {MOST_WEIGHTS}")


def read_network(file: Path) -> list[dict[str, Any]]:
    """Layers of a file of weights in the form of a scenario's section.

    Args:
        file: A file ``.safetensors`` or ``.npz`` with ``*.weight`` (outputs, inputs) and ``*.bias``
            (outputs,) of each layer, or a graph ``.onnx``.

    Raises:
        ScenarioError: If it cannot be read, or is not a chain of layers.
        SpaceRobotError: If the package ``safetensors`` or ``onnx`` is needed and not installed.
    """
    if file.suffix not in (".npz", ".safetensors", ".onnx"):
        problem = f"found {file.suffix or 'no suffix'!r}"
        raise ScenarioError(f"{problem}, allowed: .safetensors, .onnx or .npz", source=file)
    if file.stat().st_size > MOST_BYTES:
        raise ScenarioError(f"larger than {MOST_BYTES // 1_000_000} MB, so not such a network", source=file)
    layers, names = _graph_layers(file) if file.suffix == ".onnx" else _array_layers(file)
    shapes = [(len(layer["weights"]), len(layer["weights"][0])) for layer in layers]
    try:
        check_chain(shapes, names)
    except ValueError as fault:
        raise ScenarioError(str(fault), source=file) from None
    return layers


def _array_layers(file: Path) -> tuple[list[dict[str, Any]], list[str]]:
    """Layers of a file of arrays, and their names in messages."""
    arrays = _arrays(file)
    stems = sorted(
        {name.rpartition(".")[0] for name in arrays if name.endswith(("weight", "bias"))},
        key=lambda stem: [int(part) if part.isdecimal() else -1 for part in re.split(r"(\d+)", stem)],
    )
    stray = [name for name in arrays if not re.fullmatch(r"(.*\.)?(weight|bias)", name)]
    if stray or not stems:
        what = f"{stray[0]!r}" if stray else "no arrays"
        raise ScenarioError(f"found {what}, allowed: arrays NAME.weight and NAME.bias", source=file)
    layers = []
    for stem in stems:
        prefix = f"{stem}." if stem else ""
        weights, biases = arrays.get(f"{prefix}weight"), arrays.get(f"{prefix}bias")
        if weights is None:
            raise ScenarioError(f"layer {stem!r}: found a bias without {prefix}weight", source=file)
        if weights.ndim != 2 or not weights.size:
            problem = f"{prefix}weight: found shape {weights.shape}"
            raise ScenarioError(f"layer {stem!r}: {problem}, allowed: (outputs, inputs)", source=file)
        if biases is not None and biases.shape != weights.shape[:1]:
            problem = f"{prefix}bias: found shape {biases.shape}"
            raise ScenarioError(f"layer {stem!r}: {problem}, allowed: ({len(weights)},)", source=file)
        layers.append({"weights": weights.tolist(), "biases": [] if biases is None else biases.tolist()})
    return layers, [f"layer {stem!r}" for stem in stems]


def _arrays(file: Path) -> dict[str, Array]:
    """Arrays of a file by name, finite numbers."""
    load: Callable[[Path], Mapping[str, Any]] = _load_npz
    faults: tuple[type[Exception], ...] = (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile)
    if file.suffix == ".safetensors":
        load = optional_module("safetensors.numpy", "neural", f"the file {file.name}").load_file
        faults += (optional_module("safetensors", "neural", "").SafetensorError,)
    try:
        raw = load(file)
        arrays = {name: np.asarray(value, dtype=float) for name, value in raw.items()}
    except faults as fault:
        raise ScenarioError(f"cannot be read: {fault}", source=file) from None
    return _finite(arrays, file)


def _finite(arrays: dict[str, Array], file: Path) -> dict[str, Array]:
    """The arrays, if they are finite numbers."""
    for name, value in arrays.items():
        if not (np.abs(value) <= LARGEST).all():
            raise ScenarioError(f"{name}: holds what is no finite number", source=file)
    return arrays


def _load_npz(file: Path) -> dict[str, Any]:
    with np.load(file, allow_pickle=False) as stored:  # a pickle could run code
        return {name: stored[name] for name in stored.files}


def _graph_layers(file: Path) -> tuple[list[dict[str, Any]], list[str]]:
    """Layers of a graph, and their names in messages."""
    onnx = optional_module("onnx", "neural", f"the file {file.name}")
    try:
        graph = onnx.load(file).graph  # and the arrays that it keeps in a file beside it
        constants = {one.name: onnx.numpy_helper.to_array(one) for one in graph.initializer}
        constants |= {
            node.output[0]: onnx.numpy_helper.to_array(node.attribute[0].t)
            for node in graph.node
            if node.op_type == "Constant"
        }
    except Exception as fault:  # onnx, protobuf and the file system have errors of their own
        raise ScenarioError(f"cannot be read: {' '.join(str(fault).split())}", source=file) from None
    inputs = [one.name for one in graph.input if one.name not in constants]
    if len(inputs) != 1 or len(graph.output) != 1:
        problem = f"found {len(inputs)} inputs and {len(graph.output)} outputs"
        raise ScenarioError(f"{problem}, allowed: one of each", source=file)
    layers, names = list[dict[str, Any]](), list[str]()
    before, signal = "", inputs[0]
    for node in (node for node in graph.node if node.op_type != "Constant"):
        label, last = f"node {node.name or node.output[0]!r}", layers[-1] if layers else None
        read = [name for name in node.input if name and name not in constants]
        arrays = [np.asarray(constants[name]) for name in node.input if name in constants]
        passive = last is not None and last["activation"] is None
        fits = read == [signal]
        if node.op_type == "Mul" and last and last["activation"] == "sigmoid" and {*read} == {before, signal}:
            last["activation"] = "silu"
        elif fits and node.op_type in ("Gemm", "MatMul") and (layer := _affine_layer(node, signal, arrays)):
            layers.append(layer)
            names.append(label)
        elif fits and last and passive and node.op_type == "Add" and not last["biases"] and len(arrays) == 1:
            last["biases"] = arrays[0].reshape(-1).tolist()
        elif fits and last and passive and node.op_type in ACTIVATION_NODES:
            last["activation"] = ACTIVATION_NODES[node.op_type]
        elif not fits or node.op_type not in NEUTRAL_NODES:
            raise ScenarioError(f"{label}: found {node.op_type}, allowed: {CHAIN}", source=file)
        before, signal = signal, node.output[0]
    if signal != graph.output[0].name or not layers:
        raise ScenarioError(f"found no path from input to output, allowed: {CHAIN}", source=file)
    for layer, label in zip(layers, names, strict=True):
        _finite({label: np.asarray(layer["weights"]), f"{label}, biases": np.asarray(layer["biases"])}, file)
        outputs = len(layer["weights"])
        if layer["biases"] and len(layer["biases"]) != outputs:
            problem = f"found {len(layer['biases'])} biases"
            raise ScenarioError(f"{label}: {problem}, allowed: {outputs}", source=file)
    for layer in layers[:-1]:
        layer["activation"] = layer["activation"] or "linear"
    return layers, names


def _affine_layer(node: Any, signal: str, arrays: Sequence[Array]) -> dict[str, Any] | None:
    """Layer of a node ``Gemm`` or ``MatMul`` of a signal (1, n); None if it is more than W h + b."""
    attributes = {one.name: one.f or one.i for one in node.attribute}
    plain = {"alpha": 1, "beta": 1, "transA": 0, "transB": attributes.get("transB", 0)}
    sizes = (1, 2) if node.op_type == "Gemm" else (1,)
    if len(arrays) not in sizes or arrays[0].ndim != 2 or not arrays[0].size or node.input[0] != signal:
        return None
    if any(value != plain.get(name) for name, value in attributes.items()):
        return None
    weights = arrays[0] if attributes.get("transB") else arrays[0].T
    biases = arrays[1].reshape(-1).tolist() if len(arrays) == 2 else []
    return {"weights": weights.tolist(), "biases": biases, "activation": None}
