"""Controllers of bases: what they ask for, against closed forms, and what they refuse."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import spacerobot as sr
from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.pinocchio_engine import PinocchioLoop
from tests.oracles.small_scenes import random_x, small_scene

ALONE = """
robots:
  one:
    urdf: {urdf}
    base: {{joint: {base}, spin_deg: {spin}}}
    joints: {joints}
    tips: {{tip: {{pid: {{kp: 30, ki: 20, kd: 4}}, reference: {{kind: circle, radius: 0.08, duration: 2}}}}}}
    controllers: {{turn: {{kind: base_attitude, kp: 50, ki: 8, kd: 30}}}}
    actuators: {{ideal: {{kind: base_wrench}}}}
simulation: {{duration: 2, step: 0.004, output_step: 0.1}}
"""
"""One arm that moves its tip, with nothing in its hand."""

LONE = """
robots:
  one:
    urdf: plate.urdf
    base: {joint: planar}
    controllers: {turn: {kind: base_attitude, kp: 1.575, kd: 2.1, attitude_deg: [0, 0, 25]}}
    actuators: {ideal: {kind: base_wrench}}
simulation: {duration: 3}
"""
FLAT = ALONE.format(
    urdf="arm.urdf",
    base="planar",
    spin=[0, 0, 2],
    joints="{joint_1: {angle_deg: 50}, joint_2: {angle_deg: -70}}",
)
DEEP = ALONE.format(
    urdf="odd_arm.urdf",
    base="free_flyer",
    spin=[2, -1, 3],
    joints="{slant: {angle_deg: 20}, round: {angle_deg: -50}}",
)


def inertia_at_start(scene):
    """Of the robot about its centre of mass, axes of the base (3, 3), by Pinocchio."""
    q = np.array(scene.q)
    data = scene.model.createData()
    pin.ccrba(scene.model, data, q, np.zeros(scene.model.nv))
    rotation = pin.framesForwardKinematics(scene.model, data, q)
    rotation = data.oMf[scene.robots[0].root_frame].rotation
    return rotation.T @ data.Ig.inertia @ rotation


def motion_at(scene, loop, x, t=0.4):
    """Rates, and outputs by name, at a state."""
    c = loop.setup(loop.parameter_values)[1]
    found = loop.outputs(t, x, c)
    named = {name: value.full().ravel() for name, value in zip(loop.outputs.name_out(), found, strict=True)}
    return loop.dynamics(t, x, c).full().ravel(), named


@pytest.mark.parametrize("text", [FLAT, DEEP], ids=["planar", "spatial"])
def test_a_base_feels_its_pid_alone_whatever_the_arm_does(text):
    """J w' = K_p e + K_i int(e) - K_d w, and m a = the same of its position, at any state."""
    hold = {"kind": "base_position", "kp": 70, "ki": 5, "kd": 90}
    for controllers in ({}, {"robots.one.controllers.stay": hold}):
        scene = small_scene(text, controllers)
        loop, model = build_closed_loop(scene), scene.model
        flat = scene.planar
        inertia, mass = inertia_at_start(scene), pin.computeTotalMass(model)
        for seed in range(2):
            x = random_x(scene, np.random.default_rng(seed), loop.nx)
            rate, named = motion_at(scene, loop, x)
            data = model.createData()
            q, v = pin.normalize(model, x[: model.nq]), x[model.nq : model.nq + model.nv]
            pin.forwardKinematics(model, data, q, v, rate[model.nq : model.nq + model.nv])
            rotation = data.oMi[1].rotation
            axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
            moving = pin.getVelocity(model, data, 1, axes)
            going = pin.getClassicalAcceleration(model, data, 1, axes)
            integral = {n: x[i] for i, n in enumerate(loop.state_names) if ".integral" in n}
            own = [np.array([value for n, value in integral.items() if key in n]) for key in ("turn", "stay")]
            if flat:
                own = [np.r_[0, 0, own[0]], np.r_[own[1], 0] if len(own[1]) else own[1]]
            pid = 50 * named["base_attitude_error"][:3] + 8 * own[0] - 30 * moving.angular
            turned = rotation @ inertia @ rotation.T @ going.angular
            rows = [2] if flat else [0, 1, 2]
            scale = np.abs(turned).max() + np.abs(pid).max()
            np.testing.assert_allclose(turned[rows] / scale, pid[rows] / scale, atol=1e-10)
            if controllers:
                pid = 70 * named["base_position_error"][:3] + 5 * own[1] - 90 * moving.linear
                scale = mass * np.abs(going.linear).max() + np.abs(pid).max()
                np.testing.assert_allclose(mass * going.linear / scale, pid / scale, atol=1e-10)


def test_a_lone_body_turns_as_a_damped_oscillator_does():
    """I e'' + K_d e' + K_p e = 0, here critically damped with s = K_d / 2 I: e = e_0 (1 + s t) exp(-s t)."""
    scene = small_scene(LONE)  # a plate of 0.7 kg m^2
    rollout = sr.build_rollout(build_closed_loop(scene), duration_s=3, step_s=0.01, backend="interpreted")
    run = rollout.run()
    error = np.radians(25) * (1 + 1.5 * run.time) * np.exp(-1.5 * run.time)
    np.testing.assert_allclose(run.outputs["base_attitude_error"][:, 2], error, atol=1e-9)


def test_an_ideal_wrench_is_clipped_axis_by_axis():
    """Force and torque in the axes of the root link; the command is found as if all of it were delivered."""
    stay = {"robots.one.controllers.stay": {"kind": "base_position", "kp": 700, "position": [0.2, -0.1, 0.1]}}
    text = DEEP.replace("{kind: base_wrench}", "{kind: base_wrench, force: 2, torque: 0.5}")
    scene = small_scene(text, stay)
    loop, free = build_closed_loop(scene), build_closed_loop(small_scene(DEEP, stay))
    for seed in range(3):
        x = random_x(scene, np.random.default_rng(seed), loop.nx)
        bounded, whole = (motion_at(scene, one, x)[1] for one in (loop, free))
        for name, most in (("base_force", 2), ("base_torque", 0.5)):
            assert np.abs(whole[name]).max() > most
            np.testing.assert_allclose(bounded[name], np.clip(whole[name], -most, most), rtol=1e-9)
    assert "robots.one.actuators.ideal.torque" in loop.parameter_paths


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (
            {"robots.one.actuators": {}},
            "robots.one.controllers.turn: commands a torque on the base, which no actuator of the robot "
            "delivers; give one of kind base_wrench",
        ),
        (
            {"robots.one.base": {"joint": "fixed"}},
            "robots.one.controllers.turn: acts on the base, which is fixed",
        ),
        ({"robots.one.controllers.turn.kp": -1}, "robots.one.controllers.turn.kp: found -1"),
    ],
)
def test_what_cannot_hold_a_base_is_refused_in_one_line(change, told):
    with pytest.raises(ScenarioError) as fault:
        small_scene(DEEP, change)
    assert told in str(fault.value)
    assert "\n" not in str(fault.value)


def test_a_base_without_a_controller_costs_nothing():
    free = {"robots.one.controllers": {}, "robots.one.actuators": {}}
    idle = {"robots.one.controllers": {}}
    counts = [
        build_closed_loop(small_scene(FLAT, changes)).dynamics.n_instructions() for changes in (free, idle)
    ]
    assert counts[1] == counts[0]


def test_gains_and_feed_forward_have_exact_gradients():
    scene = small_scene(FLAT)
    rollout = sr.build_rollout(build_closed_loop(scene), duration_s=0.4, step_s=0.01, backend="interpreted")
    for path, value in (("kp", 50.0), ("feed_forward", 1.0)):
        path = f"robots.one.controllers.turn.{path}"
        found = rollout.jacobian(wrt=[path], outputs=["base_attitude_error"]).outputs["base_attitude_error"]
        step = 1e-4 * value
        ends = [rollout.run({path: value + s * step}).outputs["base_attitude_error"] for s in (1, -1)]
        slope = (ends[0] - ends[1]) / (2 * step)
        np.testing.assert_allclose(found[..., 0], slope, atol=1e-6 * np.abs(slope).max())


@pytest.mark.parametrize("text", [FLAT, DEEP], ids=["planar", "spatial"])
@pytest.mark.parametrize("key", ["turn", "stay"])
def test_a_filtered_rate_comes_near_to_the_ideal_one_as_its_time_falls(text, key):
    stay = {"kind": "base_position", "kp": 700, "kd": 90, "position": [0.05, 0, 0]}
    ways = {"derivative": "filtered", "filter_time": 0.004}
    output = {"turn": "base_attitude_error", "stay": "base_position_error"}[key]
    ends = []
    for changes in ({}, ways, ways | {"filter_time": 0.002}, {"feed_forward": 0}):
        own = {f"robots.one.controllers.{key}.{k}": v for k, v in changes.items()}
        rollout = sr.build_rollout(
            build_closed_loop(small_scene(text, {"robots.one.controllers.stay": stay} | own)),
            duration_s=0.3,
            step_s=0.002,
            backend="interpreted",
        )
        ends.append(rollout.run().outputs[output][-1])
    missed = [np.abs(end - ends[0]).max() for end in ends[1:]]
    assert missed[1] < 0.6 * missed[0]
    assert missed[0] < 0.1 * missed[2]


def test_both_engines_agree_on_a_filtered_rate():
    changes = {"robots.one.controllers.turn.derivative": "filtered"}
    for text in (FLAT, DEEP):
        scene = small_scene(text, changes)
        loop, engine = build_closed_loop(scene), PinocchioLoop(scene)
        x = random_x(scene, np.random.default_rng(3), loop.nx)
        first, second = motion_at(scene, loop, x)[0], engine.derivative(0.4, x)
        np.testing.assert_allclose(first, second, atol=1e-9 * np.abs(second).max())
        start = loop.setup(loop.parameter_values)[0].full().ravel()
        np.testing.assert_allclose(start, engine.x0, atol=1e-12)


TUMBLING = """
robots:
  one:
    urdf: odd_arm.urdf
    base: {joint: free_flyer, spin_deg: [20, 90, 40]}
    joints: {'*': {locked: true}}
    controllers: {turn: {kind: base_attitude, kd: 4, feed_forward: 0}}
    actuators: {ideal: {kind: base_wrench}}
simulation: {duration: 6, output_step: 0.1}
"""
"""A base that a rate gain alone brings to rest, past several half turns."""


def test_an_integral_without_a_gain_is_not_kept():
    """It would be that of a rotation vector, which jumps at half a turn, and drive the step down."""
    scene = small_scene(TUMBLING)
    loop = build_closed_loop(scene)
    assert not [name for name in loop.state_names if "integral" in name]
    rollout = sr.build_rollout(loop, duration_s=6, output_step_s=0.1, backend="interpreted")
    assert rollout.choice.step_s > 0.02
    start = loop.setup(loop.parameter_values)[0].full().ravel()
    np.testing.assert_allclose(start, PinocchioLoop(scene).x0, atol=1e-12)


STAYS = {
    "robots.one.controllers.stay": {"kind": "base_position", "kp": 70, "kd": 90},
    "robots.one.controllers.turn.ki": 0,
}


def test_both_engines_agree_on_controllers_without_an_integral():
    scene = small_scene(DEEP, STAYS)
    loop, engine = build_closed_loop(scene), PinocchioLoop(scene)
    x = random_x(scene, np.random.default_rng(3), engine.x0.size)
    np.testing.assert_allclose(motion_at(scene, loop, x)[0], engine.derivative(0.4, x), rtol=1e-9, atol=1e-7)


def test_a_phase_changes_the_controller_that_it_names_and_no_other_without_states():
    softer = {"robots": {"one": {"controllers": {"turn": {"kp": 9}}}}}
    phases = {"phases": {"first": {"until": {"time": 1}}, "second": softer}}
    phased = build_closed_loop(small_scene(DEEP, STAYS | phases))
    plain = build_closed_loop(small_scene(DEEP, STAYS | {"robots.one.controllers.turn.kp": 9}))
    c = phased.setup(phased.parameter_values)[1].full().ravel()
    for name, place in zip(phased.switch_names, phased.switches, strict=True):
        if name in ("phases.first", "phases.second"):
            c[place] = name == "phases.second"
    scene = small_scene(DEEP, STAYS)
    x = random_x(scene, np.random.default_rng(3), plain.nx)
    more = np.concatenate([x, np.zeros(phased.nx - plain.nx)])
    found = phased.dynamics(0.4, more, c).full().ravel()[plain.nq : plain.nq + plain.nv]
    expected = motion_at(scene, plain, x)[0][plain.nq : plain.nq + plain.nv]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


def test_a_sampled_attitude_is_the_rotation_since_the_start_whatever_attitude_is_held():
    """Other controllers and filters share the samples; the base turns as with an ideal sensor."""
    sensor = "    sensors: {base_orientation: {kind: star_tracker, errors: {period: 0.01}}}\nsimulation: "
    ideal = sr.simulate(small_scene(LONE), backend="interpreted").data
    sampled = sr.simulate(small_scene(LONE.replace("simulation: ", sensor)), backend="interpreted").data
    samples = sampled.measured_base_orientation.values[:, 0, 2]
    turned = [2 * np.arctan2(*data.body_orientation.values[-1, 0, 2:]) for data in (sampled, ideal)]
    assert samples[0] == 0
    assert samples[-1] == pytest.approx(turned[0], abs=0.01)
    assert turned[0] == pytest.approx(turned[1], abs=0.005)
    assert turned[0] > 0.3
