"""Networks in files of ONNX: chains against the evaluation of onnx itself; other graphs are refused."""

import sys

import numpy as np
import pytest

import spacerobot as sr
from spacerobot.common.errors import ScenarioError, SpaceRobotError
from spacerobot.elements.controllers.network_files import read_network
from tests.elements.test_neural import ACTIVATIONS
from tests.oracles.small_scenes import PLANAR, small_scene

RNG = np.random.default_rng(4)
FIRST, SECOND = RNG.normal(size=(5, 6)), RNG.normal(size=(3, 5))
BIAS, OTHER = RNG.normal(size=5), RNG.normal(size=3)


def evaluated(layers, x):
    """Output of layers whose activations are all in the file."""
    for layer in layers:
        biases = np.array(layer["biases"]) if layer["biases"] else 0.0
        x = ACTIVATIONS[layer["activation"] or "linear"](np.array(layer["weights"]) @ x + biases)
    return x


@pytest.fixture
def saved(tmp_path):
    """Function of nodes and constants that writes a graph from x (1, 6) to y."""
    onnx = pytest.importorskip("onnx", reason="onnx (extra neural) is not installed")

    def save(nodes, **constants):
        made = [onnx.helper.make_node(*node[:3], **(node[3] if len(node) > 3 else {})) for node in nodes]
        x, y = (
            onnx.helper.make_tensor_value_info(name, onnx.TensorProto.DOUBLE, shape)
            for name, shape in (("x", (1, 6)), ("y", None))
        )
        arrays = [onnx.numpy_helper.from_array(np.asarray(value), name) for name, value in constants.items()]
        model = onnx.helper.make_model(onnx.helper.make_graph(made, "policy", [x], [y], arrays))
        onnx.save(model, tmp_path / "policy.onnx")
        return tmp_path / "policy.onnx"

    return save


CHAINS = {
    "gemm": (
        [
            ("Gemm", ["x", "W", "b"], ["h"], {"transB": 1}),
            ("Tanh", ["h"], ["a"]),
            ("Gemm", ["a", "V", "c"], ["u"], {"transB": 1}),
            ("Tanh", ["u"], ["y"]),
        ],
        {"W": FIRST, "b": BIAS, "V": SECOND, "c": OTHER},
        ["tanh", "tanh"],
    ),
    "matmul": (
        [
            ("Flatten", ["x"], ["f"]),
            ("MatMul", ["f", "W"], ["h"]),
            ("Add", ["b", "h"], ["g"]),
            ("Sigmoid", ["g"], ["s"]),
            ("Mul", ["g", "s"], ["a"]),
            ("MatMul", ["a", "V"], ["u"]),
            ("Softplus", ["u"], ["y"]),
        ],
        {"W": FIRST.T, "b": BIAS, "V": SECOND.T},
        ["silu", "softplus"],
    ),
    "linear": (
        [("Gemm", ["x", "W"], ["h"]), ("Gemm", ["h", "V", "c"], ["y"])],
        {"W": FIRST.T, "V": SECOND.T, "c": OTHER},
        ["linear", None],
    ),
}


@pytest.mark.parametrize(("nodes", "constants", "activations"), CHAINS.values(), ids=CHAINS)
def test_a_chain_agrees_with_the_evaluation_of_onnx(saved, nodes, constants, activations):
    from onnx.reference import ReferenceEvaluator

    file, x = saved(nodes, **constants), RNG.normal(size=6)
    layers = read_network(file)
    assert [layer["activation"] for layer in layers] == activations
    expected = ReferenceEvaluator(str(file)).run(None, {"x": x[None]})[0][0]
    np.testing.assert_allclose(evaluated(layers, x), expected, rtol=1e-12)


def test_activations_of_the_file_are_those_of_the_controller(saved):
    file = saved(CHAINS["gemm"][0], W=1e3 * FIRST, b=BIAS, V=1e3 * SECOND, c=OTHER)
    policy = {"kind": "neural", "layers": read_network(file), "activation": "softplus", "scales": [2.0]}
    changes = {"robots.one.controllers": {"policy": policy}, "robots.one.tips.tip.pid": None}
    changes |= {"robots.one.tips.tip.amnesia": None, "simulation.duration": 0.1}
    torques = sr.simulate(small_scene(PLANAR, changes), backend="interpreted").data.joint_torque
    torques = torques.sel(joint=[f"one/joint_{k}" for k in (1, 2, 3)]).values
    assert 1.9 < np.abs(torques).max() <= 2.0  # tanh saturates; a softplus would not


HIDDEN, CHAIN = ("Gemm", ["x", "W"], ["h"]), "allowed: a chain"
WRONG = {
    "relu": ([HIDDEN, ("Relu", ["h"], ["y"])], f"node 'y': found Relu, {CHAIN}"),
    "branch": ([HIDDEN, ("Tanh", ["h"], ["a"]), ("Mul", ["a", "h"], ["y"])], f"node 'y': found Mul, {CHAIN}"),
    "scaled": ([("Gemm", ["x", "W"], ["y"], {"alpha": 2.0})], f"node 'y': found Gemm, {CHAIN}"),
    "row": (
        [("Gemm", ["x", "V"], ["h"]), ("Gemm", ["h", "W"], ["y"])],
        r"node 'y': found shape \(5, 6\), allowed: \(5, 3\), for node 'h' has 3 outputs",
    ),
    "bias": ([("MatMul", ["x", "W"], ["h"]), ("Add", ["h", "c"], ["y"])], r"found 3 biases, allowed: 5"),
    "path": ([("Gemm", ["x", "W"], ["z"])], r"found no path from input to output"),
    "nan": ([("Gemm", ["x", "N"], ["y"])], r"node 'y': holds what is no finite number"),
}


@pytest.mark.parametrize(("nodes", "message"), WRONG.values(), ids=WRONG)
def test_other_graphs_are_refused_by_their_node(saved, nodes, message):
    file = saved(nodes, W=FIRST.T, V=RNG.normal(size=(6, 3)), c=OTHER, N=np.full((6, 5), np.nan))
    with pytest.raises(ScenarioError, match=message) as fault:
        read_network(file)
    assert "policy.onnx" in str(fault.value)
    assert "\n" not in str(fault.value)


def test_a_file_that_is_no_graph_is_refused(tmp_path):
    pytest.importorskip("onnx", reason="onnx (extra neural) is not installed")
    (tmp_path / "policy.onnx").write_bytes(b"no graph\n")
    with pytest.raises(ScenarioError, match=r"policy\.onnx") as fault:
        read_network(tmp_path / "policy.onnx")
    assert "\n" not in str(fault.value)


def test_onnx_without_the_package_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnx", None)
    (tmp_path / "policy.onnx").write_bytes(b"")
    with pytest.raises(SpaceRobotError, match=r"pip install 'spacerobot\[neural\]'"):
        read_network(tmp_path / "policy.onnx")
