"""Conservation of momentum, balance of energy and order of convergence over whole rollouts."""

from __future__ import annotations

import numpy as np
import pytest

from spacerobot.closedloop import build_closed_loop
from spacerobot.rollout import build_rollout
from spacerobot.scene import load_scene
from tests.oracles.small_scenes import PLANAR, SPATIAL, random_x, small_scene
from tests.oracles.two_engines import Symbolic, part

STILL = {
    "robots.*.base.velocity": [0, 0, 0],
    "robots.*.base.spin_deg": [0, 0, 0],
    "target.base.spin_deg": [0, 0, 0],
}
SPRINGS = {"grasps.*.rotational_stiffness": 5, "grasps.*.rotational_damping": 2}
FORGETFUL = {
    "robots.*.sensors": {
        "joint_rate": {"offset": 0.01, "scale": 0.95},
        "tip_position": {"offset": 0.02, "scale": 1.02},
    }
}
CASES = {
    "planar springs": (PLANAR, SPRINGS | FORGETFUL),
    "spatial springs": (SPATIAL, SPRINGS),
    "planar weld and point": (
        PLANAR,
        STILL
        | {
            "robots.one.joints.joint_1.rate_deg": 0,
            "grasps.left": {"tip": "one/tip", "frame": "mate_1", "kind": "weld"},
            "grasps.right": {"tip": "two/tip", "frame": "mate_2", "kind": "point"},
        },
    ),
    "spatial weld": (
        SPATIAL,
        STILL
        | {
            "robots.one.joints.slant.rate_deg": 0,
            "robots.one.joints.slide.speed": 0,
            "robots.*.torque_limits": True,
            "robots.*.joints.wrist.torque_limit": 0.2,
            "grasps.left": {"tip": "one/tip", "frame": "left", "kind": "weld"},
        },
    ),
    "falling": (PLANAR, {"gravity": [0.3, -1.62, 0]}),
}


@pytest.mark.parametrize("case", CASES)
def test_momentum_and_energy_balance(case):
    scene = small_scene(*CASES[case])
    ran = Symbolic(scene).run(0.6, 0.1, step_s=1e-3)
    y, time = ran.outputs, ran.time[:, None]
    tolerance = 1e-7  # RK4 conserves no quadratic quantity exactly, and clipped torques have corners

    gravity = np.array(scene.scenario.gravity)
    mass = sum(scene.model.inertias[j].mass for body in scene.bodies for j in body.subtree)
    linear = y["momentum_linear"] - y["momentum_linear"][0] - mass * time * gravity
    assert np.abs(linear).max() < tolerance
    for kind in ("linear", "angular"):
        parts = y[f"body_momentum_{kind}"].reshape(len(time), -1, 3)
        np.testing.assert_allclose(parts.sum(axis=1), y[f"momentum_{kind}"], atol=1e-12)
        assert np.abs(parts - parts[0]).max() > 1e-3  # it moves from body to body all the same
    if not gravity.any():
        assert np.abs(y["momentum_angular"] - y["momentum_angular"][0]).max() < tolerance

    stored = y["energy_kinetic"] + y["energy_spring"] + y["energy_potential"]
    put_in = y["work_actuator"] + y["work_constraint"] - y["work_joint"] - y["work_grasp"]
    assert np.abs(stored - stored[0] - put_in).max() < tolerance
    assert np.abs(stored - stored[0]).max() > 1e-4
    assert (np.diff(y["work_joint"][:, 0]) > 0).all()
    assert (np.diff(y["work_grasp"][:, 0]) >= 0).all()
    assert (y["work_grasp"][-1] > 0) == any(g.config.kind == "compliant" for g in scene.grasps)


@pytest.mark.parametrize("case", CASES)
def test_power_balance_at_any_state(case):
    """Also where rigid grasps are far from closed and their stabilisation does work."""
    scene = small_scene(*CASES[case])
    loop = Symbolic(scene)
    x = random_x(scene, np.random.default_rng(6), len(loop.x0), spread=0.2)
    rate, dt = loop.rate(0.7, x), 1e-5

    def stored(x):
        outputs = loop.outputs(0.7, x)
        return sum(outputs[f"energy_{kind}"][0] for kind in ("kinetic", "spring", "potential"))

    actuator, joint, grasp, constraint = (
        part(loop, rate, f"work.{name}")[0] for name in ("actuator", "joint", "grasp", "constraint")
    )
    change = (stored(x + dt * rate) - stored(x - dt * rate)) / (2 * dt)
    assert change == pytest.approx(actuator + constraint - joint - grasp, rel=1e-6, abs=1e-6)
    assert (abs(constraint) > 1e-3) == any(g.config.kind != "compliant" for g in scene.grasps)


def test_fixed_base_takes_momentum():
    scene = small_scene(PLANAR, {"robots.one.base": {"joint": "fixed"}})
    ran = Symbolic(scene).run(0.2, 0.1)
    assert np.abs(ran.outputs["momentum_linear"][-1]).max() > 1e-3


def test_paper_converges_with_order_four():
    loop = build_closed_loop(load_scene("paper"))

    def end(step_s):
        steps = {"duration_s": 0.08, "step_s": step_s, "output_step_s": 0.08, "method": "rk4"}
        return build_rollout(loop, **steps, backend="interpreted").run().state[-1]

    # steps of 8 and 4 ms are too near to the limit of stability for their errors to have an order
    exact = end(1.25e-4)
    steps = np.array([2e-3, 1e-3, 5e-4])
    errors = [np.abs(end(h) - exact).max() for h in steps]
    slopes = np.diff(np.log(errors)) / np.diff(np.log(steps))
    assert ((slopes > 3.4) & (slopes < 4.4)).all()
    assert errors[0] < 2e-8
