"""Whole rollouts: the two engines against each other, and what the second one promises of its own."""

from __future__ import annotations

import numpy as np
import pytest

from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import SpaceRobotError
from spacerobot.pinocchio_engine import PinocchioLoop, simulate
from spacerobot.rollout import build_rollout
from tests.oracles.small_scenes import PLANAR, SPATIAL, small_scene

RIGID = {
    "robots.*.base.velocity": [0, 0, 0],
    "robots.*.base.spin_deg": [0, 0, 0],
    "target.base.spin_deg": [0, 0, 0],
    "robots.one.joints.slant.rate_deg": 0,
    "robots.one.joints.slide.speed": 0,
    "grasps.left": {"tip": "one/tip", "frame": "left", "kind": "weld"},
    "grasps.right": {"tip": "two/tip", "frame": "right", "kind": "point"},
}


def fixed_step(scene, step_s, duration_s, output_step_s, method="tanaka6"):
    loop = build_closed_loop(scene)
    steps = {"duration_s": duration_s, "step_s": step_s, "output_step_s": output_step_s}
    return build_rollout(loop, **steps, method=method, backend="interpreted").run()


def test_paper_agrees_over_a_quarter_of_its_motion(paper):
    every = round(0.1 / paper.scene.scenario.simulation.output_step)
    ours, checked = paper.fixed_step, paper.checked
    assert (ours.status, checked.status, checked.backend) == ("completed", "completed", "pinocchio")
    np.testing.assert_allclose(ours.time[::every], checked.time, atol=1e-12)
    assert np.abs(ours.state[::every] - checked.state).max() < 2e-8
    assert list(checked.outputs) == list(ours.outputs)
    for name, values in checked.outputs.items():
        # torques carry the derivative gain of 5000 kg times the error of an acceleration
        tolerance = 1e-5 if name == "joint_torque" else 1e-7
        assert np.abs(ours.outputs[name][::every] - values).max() < tolerance, name


def test_spatial_rigid_scene_agrees_and_converges_on_it():
    scene = small_scene(SPATIAL, RIGID)
    checked = simulate(scene, duration_s=0.6, output_step_s=0.2)
    assert checked.status == "completed"
    gap = checked.outputs["grasp_gap"]
    assert np.abs(gap).max() < 1e-9  # the stabilisation holds the grasps
    errors = [
        np.abs(fixed_step(scene, step_s, 0.6, 0.2, "rk4").state - checked.state).max()
        for step_s in (8e-3, 4e-3, 2e-3)
    ]
    assert errors[2] < 1e-7
    slope = np.polyfit(np.log([8, 4, 2]), np.log(errors), 1)[0]
    assert 3.5 < slope < 4.6


def test_samples_lie_on_the_same_times_and_show_what_led_up_to_them():
    scene = small_scene(PLANAR)
    checked, ours = simulate(scene, output_step_s=0.5), fixed_step(scene, 4e-3, 2.0, 0.5)
    assert np.abs(checked.state - ours.state).max() < 1e-5
    # both references end on a sample, where the acceleration, and with it the torque, jumps
    for name in ("joint_torque", "tip_reference", "grasp_force"):
        assert np.abs(checked.outputs[name] - ours.outputs[name]).max() < 1e-4
    engine = PinocchioLoop(scene)
    x = checked.state[3]
    jump = engine.derivative(1.5, x) - engine.derivative(1.5, x, within=1.4)
    assert np.abs(jump).max() > 0.01


def test_references_may_end_between_samples():
    changes = {"robots.one.tips.tip.reference.duration": 0.3, "robots.two.tips.tip.reference.duration": 0.7}
    scene = small_scene(PLANAR, changes)
    found = simulate(scene, duration_s=0.8, output_step_s=0.8)
    assert np.abs(found.state - fixed_step(scene, 1e-3, 0.8, 0.8).state).max() < 1e-7


def test_defaults_come_from_the_scenario_and_progress_is_told():
    scene, told = small_scene(PLANAR, {"simulation.duration": 0.2, "simulation.output_step": 0.05}), []
    found = simulate(scene, rtol=1e-6, atol=1e-6, progress=told.append)
    np.testing.assert_allclose(found.time, [0, 0.05, 0.1, 0.15, 0.2])
    np.testing.assert_allclose(told, [0.25, 0.5, 0.75, 1.0])
    assert (found.steps, found.measures, found.costs) == (0, {}, {})
    assert np.isnan(found.step_s)
    assert found.wall_s > 0
    with pytest.raises(ValueError, match="read-only"):
        found.state[0, 0] = 1.0


UNSTABLE = {
    "robots.one.joint_pd": {"kd": 800},
    "robots.one.tips.tip.pid.kd": 0,
    "robots.one.sensors": {"joint_rate": {"scale": -1}},  # damping that drives
}


def test_divergence_is_a_status_and_keeps_what_was_good():
    scene = small_scene(PLANAR, UNSTABLE)
    steps = {"duration_s": 0.02, "output_step_s": 0.001}
    found, ours = simulate(scene, **steps, rtol=1e-4, atol=1e-4), fixed_step(scene, 1e-5, *steps.values())
    assert (found.status, ours.status) == ("diverged", "diverged")
    assert 1 < len(found.time) == len(found.state) == len(found.outputs["joint_torque"]) < 21
    assert found.time[-1] <= found.diverged_at_s < found.time[-1] + 0.001 + 1e-12
    assert found.diverged_at_s < ours.diverged_at_s < 0.02  # the first engine's bounds are wider
    for values in (found.state, *found.outputs.values()):
        assert np.isfinite(values).all()


def test_state_without_a_rate_is_divergence_not_an_endless_search(monkeypatch):
    monkeypatch.setattr(PinocchioLoop, "derivative", lambda self, t, x, within=None: np.full(len(x), np.nan))
    found = simulate(small_scene(PLANAR))
    assert (found.status, found.diverged_at_s, len(found.time)) == ("diverged", 0.0, 1)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [({"rtol": 0.0}, "rtol"), ({"atol": np.nan}, "atol"), ({"duration_s": -1.0}, "duration")],
)
def test_wrong_numbers_are_refused(wrong, message):
    with pytest.raises(SpaceRobotError, match=message):
        simulate(small_scene(PLANAR), **wrong)


def test_joint_past_half_a_turn_is_not_kicked():
    turned = small_scene(
        SPATIAL, {"robots.one.joints.round.angle_deg": 179.9, "robots.one.joint_pd": {"kp": 5, "kd": 0}}
    )
    loop, engine = build_closed_loop(turned), PinocchioLoop(turned)
    c = loop.setup(loop.parameter_values)[1]
    place = next(i for i, n in enumerate(loop.state_names) if n == "q.one/round[0]")
    desired = next(i for i, n in enumerate(loop.state_names) if n == "one/joint_pd.theta_d[1]")
    x = np.array(engine.x0)
    angle = np.radians(181)
    x[place : place + 2] = np.cos(angle), np.sin(angle)  # the joint has passed, its desired position not yet
    without = x.copy()
    without[desired] = angle
    for rate in (lambda x: loop.dynamics(0, x, c).full().ravel(), lambda x: engine.derivative(0, x)):
        torque_step = np.abs(rate(x) - rate(without))[loop.nq : loop.nq + loop.nv].max()
        assert torque_step < 5 * np.radians(1.1) * 60  # one degree of error, not 359
        whole_turn = x.copy()
        whole_turn[desired] += 2 * np.pi
        np.testing.assert_allclose(
            rate(whole_turn)[loop.nq : loop.nq + loop.nv], rate(x)[loop.nq : loop.nq + loop.nv], rtol=1e-9
        )


def test_robot_without_tips_keeps_its_posture():
    changes = {
        "robots.two.tips": {},
        "robots.two.joint_pd": {"kp": 9, "kd": 3},
        "robots.two.base": {"joint": "planar"},
        "grasps": {"left": {"tip": "one/tip", "frame": "mate_1", "kind": "compliant"}},
    }
    scene = small_scene(PLANAR, changes)
    found, ours = simulate(scene, duration_s=0.3, output_step_s=0.3), fixed_step(scene, 3e-3, 0.3, 0.3)
    np.testing.assert_allclose(ours.state, found.state, atol=1e-7)
    columns = [i for i, n in enumerate(build_closed_loop(scene).state_names) if "joint_pd" in n]
    np.testing.assert_array_equal(found.state[-1, columns], found.state[0, columns])
