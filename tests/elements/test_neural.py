"""Neural networks as controllers: files of weights, gradients by the weights, bounded commands."""

from __future__ import annotations

import itertools
import shutil

import numpy as np
import pytest

import spacerobot as sr
from spacerobot.common.errors import ScenarioError, SpaceRobotError
from spacerobot.elements.controllers.network_files import MOST_WEIGHTS, read_network
from tests.oracles import engine as independent
from tests.oracles.small_scenes import PLANAR, folder, random_x, small_scene

INPUTS = ["joint_position", "joint_rate", "base_spin", "target_position"]
OUTPUTS = ["joint_torque", "base_force", "base_torque"]
POLICY = "robots.one.controllers.policy"


def arrays(*sizes, seed=1):
    """Arrays of a chain of layers, named as PyTorch names those of a ``Sequential``."""
    rng = np.random.default_rng(seed)
    named = {}
    for k, (before, after) in enumerate(itertools.pairwise(sizes)):
        named[f"{2 * k}.weight"] = rng.normal(size=(after, before)) / np.sqrt(before)
        named[f"{2 * k}.bias"] = 0.1 * rng.normal(size=after)
    return named


def layers(named):
    return [
        {"weights": named[f"{key}.weight"].tolist(), "biases": named[f"{key}.bias"].tolist()}
        for key in sorted({name.partition(".")[0] for name in named}, key=int)
    ]


def scene_of(**section):
    policy = {
        "kind": "neural",
        "layers": layers(arrays(12, 5, 9)),
        "inputs": INPUTS,
        "outputs": OUTPUTS,
        "scales": [2, 1.5, 0.5],
        "frame": "mate_2",
    }
    changes = {
        "robots.one.actuators": {"ideal": {"kind": "base_wrench"}},
        "robots.one.tips.tip.pid": None,
        "robots.one.tips.tip.amnesia": None,
        "robots.one.controllers": {"policy": policy | section},
        "simulation.duration": 0.4,
    }
    return small_scene(PLANAR, changes)


@pytest.mark.parametrize("activation", ["tanh", "softplus", "sigmoid", "silu"])
@pytest.mark.parametrize("axes", ["base", "world"])
def test_every_activation_and_both_axes_agree_with_numpy(activation, axes):
    scene = scene_of(activation=activation, axes=axes, output_activation="tanh")
    loop, oracle = sr.build_closed_loop(scene), independent.Engine(scene)
    _, c = loop.setup(loop.parameter_values)
    first = scene.model.nq + scene.model.nv
    own = [*range(first), *(loop.state_names.index(name) for name in oracle.state_names)]
    x = random_x(scene, np.random.default_rng(3), loop.nx)
    rate = loop.dynamics(0.3, x, loop.at(0.3, x, c)).full().ravel()
    np.testing.assert_allclose(rate[own], oracle.derivative(0.3, x[own]), rtol=1e-8, atol=1e-8)


def test_the_gradient_by_weights_is_that_of_finite_differences():
    scene = scene_of(sampled={"period": 0.05})
    paths = [f"{POLICY}.layers.0.weights.1.2", f"{POLICY}.layers.1.biases.4", f"{POLICY}.scales.0"]
    exact = sr.gradient(scene, "tip_error_rms", paths, backend="interpreted")
    assert exact.status == "exact"
    values = exact.data.parameter_value.values
    for k, path in enumerate(paths):
        step = 1e-4
        pair = [values[k] - step, values[k] + step]
        found = sr.batch(scene, "tip_error_rms", {path: pair}, backend="interpreted").data.tip_error_rms
        slope = np.linalg.norm(found.values, axis=1)
        difference = (slope[1] - slope[0]) / (2 * step)
        np.testing.assert_allclose(exact.gradients[0, k], difference, rtol=1e-5)


def test_a_weight_that_is_zero_has_a_gradient():
    named = arrays(12, 5, 9)
    named["0.bias"][:] = 0
    scene = scene_of(layers=layers(named))
    path = f"{POLICY}.layers.0.biases.0"
    assert path not in sr.build_closed_loop(scene).parameter_paths
    assert sr.gradient(scene, "tip_error_rms", [path], backend="interpreted").gradients[0, 0] != 0


@pytest.fixture
def place(tmp_path):
    """Folder with a scenario that reads ``policy.npz``, and the robots' URDFs."""
    for urdf in folder().glob("*.urdf"):
        shutil.copy(urdf, tmp_path)
    policy = "    controllers: {policy: {kind: neural, file: policy.npz}}\n"
    text = PLANAR.replace("    tips:\n", policy + "    tips:\n", 1)
    (tmp_path / "scenario.yaml").write_text(text)
    return tmp_path


def test_weights_come_from_a_file_and_stay_in_the_scenario(place):
    named = arrays(6, 4, 3)
    np.savez(place / "policy.npz", **named)
    scene = sr.load_scene(place / "scenario.yaml")
    policy = scene.scenario.robots["one"].controllers["policy"]
    np.testing.assert_array_equal(policy.layers[1].weights, named["2.weight"])
    assert policy.words() == "network 6-4-3, tanh"


def test_layers_are_in_the_order_of_their_numbers(tmp_path):
    named = {f"net.{2 * k}.weight": np.full((1, 1), float(k)) for k in range(12)}
    np.savez(tmp_path / "deep.npz", **dict(sorted(named.items())))
    found = [layer["weights"][0][0] for layer in read_network(tmp_path / "deep.npz")]
    assert found == list(range(12))


def test_safetensors_are_read(tmp_path):
    package = pytest.importorskip("safetensors.numpy")
    named = {name: value.astype(np.float32) for name, value in arrays(6, 4, 3).items()}
    package.save_file(named, tmp_path / "policy.safetensors")
    found = read_network(tmp_path / "policy.safetensors")
    np.testing.assert_array_equal(np.array(found[0]["weights"], dtype=np.float32), named["0.weight"])
    (tmp_path / "policy.safetensors").write_bytes(b"\x10\0\0\0\0\0\0\0{broken")
    with pytest.raises(ScenarioError, match=r"policy\.safetensors.*cannot be read"):
        read_network(tmp_path / "policy.safetensors")


def test_safetensors_without_the_package_name_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "safetensors", None)
    monkeypatch.setitem(__import__("sys").modules, "safetensors.numpy", None)
    (tmp_path / "policy.safetensors").write_bytes(b"")
    with pytest.raises(SpaceRobotError, match=r"pip install 'spacerobot\[neural\]'"):
        read_network(tmp_path / "policy.safetensors")


SHAPES = {
    "chain": (
        {"0.weight": np.ones((4, 6)), "2.weight": np.ones((3, 5))},
        r"layer '2': found shape \(3, 5\), allowed: \(3, 4\), for layer '0' has 4 outputs",
    ),
    "bias": (
        {"0.weight": np.ones((3, 6)), "0.bias": np.ones(2)},
        r"layer '0': 0.bias: found shape \(2,\), allowed: \(3,\)",
    ),
    "vector": (
        {"0.weight": np.ones(6)},
        r"layer '0': 0.weight: found shape \(6,\), allowed: \(outputs, inputs\)",
    ),
    "lone bias": ({"0.bias": np.ones(3)}, r"layer '0': found a bias without 0.weight"),
    "stray": ({"0.gamma": np.ones(3)}, r"found '0.gamma', allowed: arrays NAME.weight and NAME.bias"),
    "nan": ({"0.weight": np.full((3, 6), np.nan)}, r"0.weight: holds what is no finite number"),
    "pickle": ({"0.weight": np.array([[None]], dtype=object)}, r"cannot be read: .*allow_pickle=False"),
    "large": (
        {"0.weight": np.ones((300, 300))},
        rf"found 90300 weights and biases, allowed: at most {MOST_WEIGHTS}",
    ),
    "robot": (
        {"0.weight": np.ones((3, 5))},
        r"layers\.0: policy\.npz: found 5 inputs, allowed: 6, of joint_position 3, joint_rate 3",
    ),
}


@pytest.mark.parametrize(("named", "message"), SHAPES.values(), ids=SHAPES)
def test_a_bad_file_is_refused_by_layer_and_shape(place, named, message):
    np.savez(place / "policy.npz", **named)
    with pytest.raises(ScenarioError, match=message) as fault:
        sr.load_scene(place / "scenario.yaml")
    assert "policy.npz" in str(fault.value)
    assert "\n" not in str(fault.value)


@pytest.mark.parametrize(
    ("section", "message"),
    [
        ({"inputs": ["joint_rate", "joint_rate"]}, r"inputs\.1: found 'joint_rate' twice"),
        ({"scales": [1]}, r"scales: found 1 numbers, allowed: 3"),
        ({"frame": "mate_9"}, r"policy\.frame: found 'mate_9', did you mean mate_"),
        ({"tip": "hand"}, r"policy\.tip: found 'hand'"),
        ({"layers": None}, r"which weights\? give `file` or `layers`"),
        ({"layers": layers(arrays(12, 5, 8))}, r"layers\.1: found 8 outputs, allowed: 9"),
    ],
)
def test_a_bad_section_is_refused_by_its_key(section, message):
    with pytest.raises(ScenarioError, match=message):
        scene_of(**section)


def test_commands_are_held_and_bounded_by_their_scales():
    named = {name: 50 * value for name, value in arrays(12, 5, 9).items()}
    scene = scene_of(layers=layers(named), output_activation="tanh", sampled={"period": 0.1}, inputs=INPUTS)
    data = sr.simulate(scene, backend="interpreted").data
    torques = data.joint_torque.sel(joint=[f"one/joint_{k}" for k in (1, 2, 3)]).values
    assert 1.9 < np.abs(torques).max() <= 2
    assert 1.4 < np.abs(data.base_force.sel(body="one").values).max() <= 1.5 * np.sqrt(2)
