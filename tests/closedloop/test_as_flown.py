"""The scenarios as flown, shortened: a capture in both engines with the same numbers, and exact gradients."""

import numpy as np
import pytest

from spacerobot.closedloop import build_closed_loop
from spacerobot.pinocchio_engine import simulate
from spacerobot.rollout import Measures, Signals, build_rollout, final
from spacerobot.scene import load_scene
from tests.elements.test_sampling import difference

SERVICER, LEFT = "robots.servicer", "phases.reach.robots.servicer.tips.left_tip.reference"
CAMERA = {
    f"{SERVICER}.sensors.target_{signal}.errors.{key}": value
    for signal in ("position", "orientation")
    for key, value in {"period": 0.1, "delay": 0.05}.items()
}
NEAR = CAMERA | {
    # The mating frame is 8 mm in front of the tip, the camera fast enough for so short a time. One arm moves.
    # No wheel is clipped: where a torque that jumps clips several, the status of gradients is coincident.
    "target.base.rotation_deg": [3, -3, -4],
    "target.base.position": [2.13874213, 0.32997692, -0.02655023],
    f"{LEFT}.approach_time": 0.1473,
    f"{LEFT}.standoff": 0.005,
    "grasps.left.capture": {"distance": 0.007, "dwell": 0.0355},
    f"{SERVICER}.actuators.wheels.torque_limit": 40,
    f"{SERVICER}.joints.right_joint_*.locked": True,
    **{
        f"{SERVICER}.tips.right_tip.{key}": None
        for key in ("pid", "amnesia", "orientation_pid", "orientation_amnesia")
    },
}
DURATION_S = 0.1773
GRADIENTS = {
    f"{SERVICER}.tips.left_tip.pid.kp": 5.0,
    f"{SERVICER}.estimators.object.attitude_deg": 0.02,
    f"{SERVICER}.sensors.target_position.errors.noise": 1e-5,
}


@pytest.fixture(scope="module")
def near():
    scene = load_scene("examples/capture-rendezvous.yaml", NEAR)
    return scene, build_closed_loop(scene)


def rolled(loop, step_s, measures=None):
    steps = {"step_s": step_s, "output_step_s": DURATION_S, "duration_s": DURATION_S}
    return build_rollout(loop, **steps, measures=measures, backend="interpreted")


def test_it_captures_in_both_engines_with_the_same_numbers(near):
    """Between two instants, 10 ms apart, four steps: with one of order 6 the engines agree to 2e-7."""
    scene, loop = near
    run, other = rolled(loop, 0.0025).run(), simulate(scene, duration_s=DURATION_S, output_step_s=DURATION_S)
    assert "captured" in [loop.events[event.event].kind for event in run.events]
    np.testing.assert_allclose(run.state, other.state, rtol=0, atol=1e-9)


def test_gradients_go_through_filter_controllers_and_capture(near):
    _, loop = near
    signals = Signals.of(loop)
    measures = Measures(
        signals,
        {"end": final(signals["body_position"][-3:])},
        lambda r, p: {"x": r["end"][0] + r["end"][1]},
    )
    rollout = rolled(loop, 0.01, measures)
    found = rollout.value_and_gradient(wrt=list(GRADIENTS))
    assert set(found.status) == {"exact"}
    for (path, step), gradient in zip(GRADIENTS.items(), found.gradients["x"], strict=True):
        wanted = difference(rollout, path, step)
        assert abs(wanted) > 1e-9
        np.testing.assert_allclose(gradient, wanted, rtol=1e-7, err_msg=path)
