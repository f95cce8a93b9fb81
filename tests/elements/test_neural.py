"""Neural networks as controllers: files of weights, gradients by the weights, bounded commands."""

from __future__ import annotations

import itertools
import shutil
from typing import get_args

import numpy as np
import pinocchio as pin
import pytest

import spacerobot as sr
from spacerobot.common.errors import ScenarioError, SpaceRobotError
from spacerobot.elements.controllers.network_files import MOST_WEIGHTS, read_network
from spacerobot.elements.controllers.neural import Activation, Input
from spacerobot.pinocchio_engine.mechanical_state import MechanicalState
from tests.oracles.motions import DesiredMotions
from tests.oracles.small_scenes import ONE_SPATIAL_ARM, PLANAR, folder, random_x, small_scene

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


ACTIVATIONS = {
    "tanh": np.tanh,
    "softplus": lambda x: np.logaddexp(0, x),
    "sigmoid": lambda x: 1 / (1 + np.exp(-x)),
    "silu": lambda x: x / (1 + np.exp(-x)),
    "linear": lambda x: x,
}


@pytest.mark.parametrize("activation", get_args(Activation))
@pytest.mark.parametrize("axes", ["base", "world"])
def test_every_measurement_and_command_of_a_network_in_space_by_numpy(activation, axes):
    inputs = [name for name in get_args(Input) if not name.startswith("joint_")]
    inputs += ["joint_rate", "joint_position"]
    outputs = ["tip_torque", "joint_torque", "base_force", "tip_force", "base_torque"]
    named = arrays(3 * len(inputs) + 2, 5, 16)  # an arm of four joints
    policy = {
        "kind": "neural",
        "layers": layers(named),
        "inputs": inputs,
        "outputs": outputs,
        "frame": "right",
    }
    policy |= {"activation": activation, "axes": axes, "output_activation": "tanh", "scales": [1, 2, 3, 4, 5]}
    changes = {f"robots.one.tips.tip.{key}": None for key in ("pid", "amnesia")}
    changes |= {"robots.one.actuators": {"ideal": {"kind": "base_wrench"}}}
    scene = small_scene(ONE_SPATIAL_ARM, changes | {"robots.one.controllers": {"policy": policy}})
    desired, model = DesiredMotions(scene), scene.model
    x = random_x(scene, np.random.default_rng(3), len(desired.x0))
    state = MechanicalState(model, x[: model.nq], x[model.nq : model.nq + model.nv])
    start = MechanicalState(model, np.array(scene.q), np.zeros(model.nv))
    body, frame = scene.bodies[0], model.getFrameId("target/right")
    base, tip, target = (state.frame(one) for one in (body.root_frame, scene.tips[0].frame, frame))
    wanted = desired.at(0.3, x)["one/tip"]
    along = base.rotation if axes == "base" else np.eye(3)

    def turn(rotation, since):
        return pin.log3(rotation @ since.T)

    seen = {
        "base_position": base.position,
        "base_orientation": turn(base.rotation, start.frame(body.root_frame).rotation),
        "base_velocity": base.velocity[:3],
        "base_spin": base.velocity[3:],
        "tip_position": tip.position - (base.position if axes == "base" else 0),
        "tip_orientation": turn(tip.rotation, wanted.rotation),
        "tip_velocity": tip.velocity[:3],
        "tip_angular_velocity": tip.velocity[3:],
        "target_position": target.position - tip.position,
        "target_orientation": turn(target.rotation, tip.rotation),
        "target_velocity": target.velocity[:3],
        "target_spin": target.velocity[3:],
    }
    seen = {name: along.T @ vector for name, vector in seen.items()}
    joints = [model.joints[joint] for joint in body.driven_joints]
    angles = [x[j.idx_q] if j.nq == 1 else np.arctan2(x[j.idx_q + 1], x[j.idx_q]) for j in joints]
    columns = [joint.idx_v for joint in joints]
    seen |= {"joint_position": np.array(angles), "joint_rate": state.v[columns]}
    h = np.concatenate([seen[name] for name in inputs])
    h = ACTIVATIONS[activation](named["0.weight"] @ h + named["0.bias"])
    h = np.tanh(named["2.weight"] @ h + named["2.bias"])
    couple, torque, force, push, turning = (
        scale * part for scale, part in zip([1, 2, 3, 4, 5], np.split(h, [3, 7, 10, 13]), strict=True)
    )
    torque = torque + tip.jacobian[:, columns].T @ np.r_[along @ push, along @ couple]
    found = desired.outputs(0.3, x)
    np.testing.assert_allclose(
        found["joint_torque"][: len(columns), 0], torque[np.argsort(columns)], rtol=1e-9
    )
    for name, vector in (("base_force", force), ("base_torque", turning)):
        np.testing.assert_allclose(base.rotation @ found[name][:3, 0], along @ vector, rtol=1e-9)


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
