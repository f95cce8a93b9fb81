"""Rollouts as functions of PyTorch; those that need it are skipped where it is not installed."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import spacerobot as sr
from optim.evaluation import build_quantity_rollout, find_quantities, parameter_paths
from spacerobot.common.errors import ScenarioError, SpaceRobotError
from tests.oracles.small_scenes import PLANAR, small_scene

QUANTITIES = ["tip_error_rms", "base_rotation_rms"]
GAINS = "robots.one.tips.tip.pid"
POLICY = "robots.one.controllers.policy"


def scene_of():
    """One arm with a PID controller, a small network, and torques of a plan as held feed-forward."""
    rng = np.random.default_rng(5)
    layers = [
        {"weights": rng.normal(size=(2, 6)).tolist(), "biases": [0.0, 0.1]},
        {"weights": rng.normal(size=(3, 2)).tolist(), "biases": [0.1, 0.2, -0.1]},
    ]
    rows = np.zeros((4, 3)).tolist()
    knots = {"times": [0, 0.1, 0.2, 0.3], "joints": ["joint_1", "joint_2", "joint_3"]}
    plan = {"kind": "joint_tracking", "knots": knots | dict.fromkeys(("position", "rate", "effort"), rows)}
    network = {"kind": "neural", "layers": layers, "sampled": {"period": 0.1}}
    changes = {
        "robots.one.controllers": {"policy": network, "plan": plan},
        "simulation.duration": 0.3,
        "simulation.step": 0.02,
    }
    return small_scene(PLANAR, changes)


def test_a_section_stands_for_all_its_numbers():
    scene = scene_of()
    paths = parameter_paths(scene, [f"{POLICY}.layers", f"{GAINS}.kp", f"{POLICY}.layers.0.biases"])
    assert len(paths) == 6 * 2 + 2 + 2 * 3 + 3 + 1
    assert paths[0] == f"{POLICY}.layers.0.weights.0.0"
    assert parameter_paths(scene, "robots.*.tips.tip.pid.kp") == (
        f"{GAINS}.kp",
        f"{GAINS}.kp".replace("one", "two"),
    )
    with pytest.raises(ScenarioError, match="holds no number"):
        parameter_paths(scene, f"{POLICY}.kind")


def test_one_sweep_gives_the_weighted_sum_of_gradients():
    scene, paths = scene_of(), (f"{GAINS}.kp", f"{POLICY}.layers.0.biases.0")
    rollout, _ = build_quantity_rollout(scene, find_quantities(QUANTITIES), paths, "interpreted", many=False)
    values = np.array([[30.0, 0.0], [40.0, 0.2]])
    weights = np.array([[1.0, 2.0], [-0.5, 3.0]])
    each = rollout.gradient_batch(paths, values, orders=False).gradients
    names = list(rollout.kernel.costs)
    expected = sum(weights[:, [k]] * each[name] for k, name in enumerate(names))
    np.testing.assert_allclose(rollout.pullback(paths, values, weights), expected, rtol=1e-12)
    with pytest.raises(SpaceRobotError, match=r"weights of shape \(2, 1\), allowed: \(2, 2\)"):
        rollout.pullback(paths, values, weights[:, :1])


def test_a_missing_package_names_its_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(SpaceRobotError, match=r"pip install 'spacerobot\[torch\]'"):
        sr.torch.rollout("paper", "tip_error_rms", "robots.rpr1.tips.tip.pid.kp")


@pytest.fixture
def torch():
    return pytest.importorskip("torch")


def test_gradcheck_passes_for_weights_gains_and_held_torques(torch):
    effort = f"{POLICY}.plan.knots.effort".replace("policy.", "")
    parameters = [f"{POLICY}.layers", f"{GAINS}.kp", effort]
    function = sr.torch.rollout(scene_of(), QUANTITIES, parameters, backend="interpreted")
    values = function.start.repeat(2, 1)
    values[1] += 0.1
    assert torch.autograd.gradcheck(
        function, (values.requires_grad_(),), eps=1e-5, atol=1e-7, rtol=1e-5, fast_mode=True
    )
    assert torch.autograd.gradcheck(
        function, (values[0].detach().requires_grad_(),), eps=1e-5, atol=1e-7, rtol=1e-5
    )


def test_a_network_of_pytorch_sets_the_parameters(torch):
    function = sr.torch.rollout(scene_of(), "tip_error_rms", f"{POLICY}.layers", backend="interpreted")
    scale = torch.tensor(1.0, dtype=torch.float32, requires_grad=True)
    found = function(scale * function.start.float())
    assert found.shape == (1,)
    assert found.dtype == torch.float32
    found.sum().backward()
    step = 1e-4
    with torch.no_grad():
        pair = function(function.start * torch.tensor([[1 - step], [1 + step]], dtype=torch.float64))
    np.testing.assert_allclose(scale.grad, (pair[1] - pair[0]).item() / (2 * step), rtol=1e-3)


def test_values_of_another_size_are_refused(torch):
    function = sr.torch.rollout(scene_of(), "tip_error_rms", f"{GAINS}.kp", backend="interpreted")
    with pytest.raises(SpaceRobotError, match=r"values of shape \(3,\), allowed: \(1,\) or \(N, 1\)"):
        function(torch.zeros(3))
