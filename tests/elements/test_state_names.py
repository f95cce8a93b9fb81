"""Elements of one kind side by side: each has states of its own, in both engines."""

import numpy as np
import pytest

from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import SpaceRobotError
from spacerobot.pinocchio_engine import PinocchioLoop
from tests.oracles.small_scenes import PLANAR, random_x, small_scene

BALL = {"kind": "sphere", "radius": 0.35}
TWICE = {
    "robots.one.joint_pd": {"kp": 20, "kd": 3},
    "robots.one.controllers": {"slow": {"kind": "joint_pd", "kp": 5, "ik_rate": 2}},
    "robots.one.tips.tip.controllers": {"soft": {"kind": "pid", "kp": 5, "ki": 3}},
    "grasps.left": {"tip": "one/tip", "frame": "mate_1", "kind": "weld"},
    "robots.one.joints.joint_1.rate_deg": 0,
    "robots.*.base.velocity": [0, 0, 0],
    "robots.*.base.spin_deg": [0, 0, 0],
    "pads": {"a": {"link": "one/tip"} | BALL, "b": {"link": "two/tip"} | BALL},
    "contacts": {"left": {"between": ["a", "b"], "stiffness": 300, "may_overlap": True}},
}


def test_two_of_a_kind_have_states_of_their_own_and_the_engines_agree():
    scene = small_scene(PLANAR, TWICE)
    loop, engine = build_closed_loop(scene), PinocchioLoop(scene)
    names = loop.state_names
    assert len(set(names)) == len(names)
    assert {"one/joint_pd.theta_d[0]", "one/slow.theta_d[0]"} < set(names)
    assert {"one/tip/amnesia[0]", "one/tip/controllers.soft.amnesia[0]"} < set(names)
    x = random_x(scene, np.random.default_rng(2), loop.nx)
    found = loop.dynamics(0.3, x, loop.setup(loop.parameter_values)[1]).full().ravel()
    assert engine.state_names == names[scene.model.nq + scene.model.nv :]
    rate = engine.derivative(0.3, x)
    np.testing.assert_allclose(found, rate, rtol=1e-8, atol=1e-8 * np.abs(rate).max())


def test_two_states_of_one_name_are_refused():
    pair = {"robots.one.joint_pd": {"kp": 20}, "robots.one.controllers": {"joint_pd": {"kind": "joint_pd"}}}
    told = r"more than one element has a state 'one/joint_pd.theta_d\[0\]'"
    with pytest.raises(SpaceRobotError, match=told):
        build_closed_loop(small_scene(PLANAR, pair))
