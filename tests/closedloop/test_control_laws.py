"""The control laws against motions worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import simpson

from tests.oracles.small_scenes import folder, small_scene
from tests.oracles.two_engines import ENGINES, part, places

GANTRY_URDF = """<robot name="gantry">
<link name="base"><inertial><mass value="9"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="beam"><inertial><mass value="3"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="trolley"><inertial><mass value="2"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tip"/>
<joint name="x" type="prismatic"><parent link="base"/><child link="beam"/><axis xyz="1 0 0"/>
  <limit lower="-9" upper="9" effort="7" velocity="9"/><dynamics damping="0.5"/></joint>
<joint name="y" type="prismatic"><parent link="beam"/><child link="trolley"/><axis xyz="0 1 0"/>
  <limit lower="-9" upper="9" effort="7" velocity="9"/><dynamics damping="0.8"/></joint>
<joint name="mount" type="fixed"><parent link="trolley"/><child link="tip"/></joint>
</robot>"""

GANTRY = """
robots:
  crane:
    urdf: gantry.urdf
    base: {joint: fixed}
    tips:
      tip:
        pid: {kp: 11, ki: 5, kd: 4, feedback: inertial}
        amnesia: {ge: 6, ta: 1.5}
        reference: {kind: line, displacement: [0.3, -0.2, 0], duration: 2}
simulation: {duration: 2, step: 0.005}
"""
MASS, DAMPING = np.array([5.0, 2.0]), np.array([0.5, 0.8])
PID = "robots.crane.tips.tip.pid"


@pytest.fixture(scope="module", autouse=True)
def _gantry():
    (folder() / "gantry.urdf").write_text(GANTRY_URDF, encoding="utf-8")


class Gantry:
    """State of the crane at one instant and what the law makes of it, by hand: J is the identity."""

    q, v = np.array([0.11, -0.07]), np.array([0.2, 0.3])
    integral, memory, filtered = np.array([0.4, -0.5]), np.array([0.03, 0.02]), np.array([0.1, -0.2])
    t = 0.8
    s = 0.4
    along = np.array([0.3, -0.2])
    reference = along * (3 * s**2 - 2 * s**3)
    reference_rate = along * 6 * s * (1 - s) / 2
    reference_acceleration = along * (6 - 12 * s) / 4

    def put(self, engine):
        x = engine.x0.copy()
        x[places(engine, "q.crane/x") + places(engine, "q.crane/y")] = self.q
        x[places(engine, "v.crane/x") + places(engine, "v.crane/y")] = self.v
        x[places(engine, "crane/tip/amnesia")] = self.memory
        x[places(engine, "crane/tip/pid.integral")] = self.integral
        if any("filter" in name for name in engine.names):
            x[places(engine, "crane/tip/pid.filter")] = self.filtered
        return x


@pytest.mark.parametrize("engine", ENGINES)
def test_ideal_derivative_is_added_mass(engine):
    hand, loop = Gantry(), ENGINES[engine](small_scene(GANTRY))
    x = hand.put(loop)
    rate, outputs = loop.rate(hand.t, x), loop.outputs(hand.t, x)
    memory_rate = -1.5 * hand.memory + (hand.reference - hand.q)  # Eq. 37, 38
    error = hand.reference_rate + 6 * hand.memory - hand.v
    push = 11 * error + 5 * hand.integral + 4 * (hand.reference_acceleration + 6 * memory_rate)  # Eq. 35
    acceleration = (push - DAMPING * hand.v) / (MASS + 4)
    np.testing.assert_allclose(part(loop, rate, "crane/tip/amnesia"), memory_rate, rtol=1e-12)
    np.testing.assert_allclose(part(loop, rate, "crane/tip/pid.integral"), error, rtol=1e-12)
    np.testing.assert_allclose(rate[2:4], acceleration, rtol=1e-12)
    np.testing.assert_allclose(outputs["joint_torque"], MASS * acceleration + DAMPING * hand.v, rtol=1e-12)
    np.testing.assert_allclose(outputs["tip_error"][:2], hand.reference - hand.q, rtol=1e-12)


@pytest.mark.parametrize("engine", ENGINES)
def test_filtered_derivative_is_a_first_order_lag(engine):
    scene = small_scene(GANTRY, {f"{PID}.derivative": "filtered", f"{PID}.filter_time": 0.05})
    hand, loop = Gantry(), ENGINES[engine](scene)
    x = hand.put(loop)
    rate = loop.rate(hand.t, x)
    error = hand.reference_rate + 6 * hand.memory - hand.v
    slope = (error - hand.filtered) / 0.05
    push = 11 * error + 5 * hand.integral + 4 * slope
    np.testing.assert_allclose(part(loop, rate, "crane/tip/pid.filter"), slope, rtol=1e-12)
    np.testing.assert_allclose(rate[2:4], (push - DAMPING * hand.v) / MASS, rtol=1e-12)
    # the filter begins at its input, which here is at rest
    moving = small_scene(GANTRY, {f"{PID}.derivative": "filtered", "robots.crane.joints.x.speed": 0.3})
    begun = ENGINES[engine](moving)
    np.testing.assert_allclose(part(begun, begun.x0, "crane/tip/pid.filter"), [-0.3, 0], atol=1e-15)


@pytest.mark.parametrize("feedback", ["inertial", "base"])
@pytest.mark.parametrize("engine", ENGINES)
def test_sensors_are_linear_in_every_signal(engine, feedback):
    """S = a + b s (section 1.6), of velocity and of position; the derivative sees it too."""
    velocity = {"inertial": "tip_velocity", "base": "joint_rate"}[feedback]
    sensors = {velocity: {"offset": 0.05, "scale": 0.9}, "tip_position": {"offset": -0.02, "scale": 1.1}}
    scene = small_scene(GANTRY, {"robots.crane.sensors": sensors, f"{PID}.feedback": feedback})
    hand, loop = Gantry(), ENGINES[engine](scene)
    rate = loop.rate(hand.t, hand.put(loop))
    memory_rate = -1.5 * hand.memory + hand.reference - (-0.02 + 1.1 * hand.q)
    error = hand.reference_rate + 6 * hand.memory - (0.05 + 0.9 * hand.v)
    push = 11 * error + 5 * hand.integral + 4 * (hand.reference_acceleration + 6 * memory_rate)
    acceleration = (push - DAMPING * hand.v) / (MASS + 0.9 * 4)
    np.testing.assert_allclose(part(loop, rate, "crane/tip/amnesia"), memory_rate, rtol=1e-12)
    np.testing.assert_allclose(rate[2:4], acceleration, rtol=1e-12)


@pytest.mark.parametrize("engine", ENGINES)
def test_torques_are_clipped_after_the_command_is_solved(engine):
    limits = {"robots.crane.torque_limits": True, "robots.crane.joints.x.torque_limit": 1.1}
    hand = Gantry()
    free, clipped = (ENGINES[engine](small_scene(GANTRY, changes)) for changes in ({}, limits))
    wanted = free.outputs(hand.t, hand.put(free))["joint_torque"]
    found = clipped.outputs(hand.t, hand.put(clipped))["joint_torque"]
    assert abs(wanted[0]) > 1.1
    np.testing.assert_allclose(found, [np.clip(wanted[0], -1.1, 1.1), wanted[1]], rtol=1e-12)
    rate = clipped.rate(hand.t, hand.put(clipped))
    np.testing.assert_allclose(rate[2:4], (found - DAMPING * hand.v) / MASS, rtol=1e-12)


@pytest.mark.parametrize("engine", ENGINES)
def test_joint_pd_follows_its_inverse_kinematics(engine):
    """Eq. 34; J is the identity, so theta_d' = (x_ref' + k (x_ref - theta_d)) / (1 + lambda^2)."""
    joint_pd = {"kp": 20, "kd": 3, "ik_rate": 7, "ik_damping": 0.1}
    scene = small_scene(
        GANTRY,
        {"robots.crane.joint_pd": joint_pd, "robots.crane.tips.tip.amnesia": None, PID: None},
    )
    hand, loop = Gantry(), ENGINES[engine](scene)
    x, desired = loop.x0.copy(), np.array([0.06, -0.01])
    x[:2], x[2:4] = hand.q, hand.v
    x[places(loop, "crane/joint_pd.theta_d")] = desired
    rate = loop.rate(hand.t, x)
    wanted = (hand.reference_rate + 7 * (hand.reference - desired)) / 1.01
    np.testing.assert_allclose(part(loop, rate, "crane/joint_pd.theta_d"), wanted, rtol=1e-12)
    push = 20 * (desired - hand.q) - 3 * hand.v
    np.testing.assert_allclose(rate[2:4], (push - DAMPING * hand.v) / MASS, rtol=1e-12)


@pytest.mark.parametrize("engine", ENGINES)
def test_null_space_torque_does_not_move_the_tip(engine):
    """Of a planar arm with three joints, the part of the joint PD that is left accelerates no tip."""
    text = """
robots:
  arm:
    urdf: arm.urdf
    base: {joint: fixed}
    joints: {joint_1: {angle_deg: 50}, joint_2: {angle_deg: -70}, joint_3: {angle_deg: 35}}
    joint_pd: {kp: 0, kd: 0, null_space: true}
    tips: {tip: {pid: {feedback: inertial}}}
"""
    scene = small_scene(text, {"robots.arm.joint_pd.kp": 30})
    free = small_scene(text, {"robots.arm.joint_pd.kp": 30, "robots.arm.joint_pd.null_space": False})
    motions = []
    for own in (scene, free):
        loop = ENGINES[engine](own)
        x = loop.x0.copy()
        x[places(loop, "arm/joint_pd.theta_d")] += [0.2, -0.1, 0.3]
        dt = 1e-5
        rate = loop.rate(0.0, x)
        assert np.abs(rate[3:6]).max() > 0.1
        x[:3] += 0.5 * dt**2 * rate[3:6]  # at rest: where the tip is after dt, to order dt^2
        motions.append(loop.outputs(0.0, x)["tip_position"] - loop.outputs(0.0, loop.x0)["tip_position"])
    assert np.abs(motions[0]).max() < 1e-4 * np.abs(motions[1]).max()


@pytest.mark.parametrize("ta", [0.0, 2.5])
def test_amnesia_is_a_leaky_integral_of_the_position_error(ta):
    """Eq. 37, 38 as corrected: exp(-ta t) int exp(ta s) error(s) ds; for ta = 0 the pure integral."""
    loop = ENGINES["casadi"](small_scene(GANTRY, {"robots.crane.tips.tip.amnesia.ta": ta}))
    ran = loop.run(2.0, 0.01)
    error = ran.outputs["tip_error"][:, :2]
    expected = simpson(np.exp(-ta * (2.0 - ran.time))[:, None] * error, x=ran.time, axis=0)
    memory = part(loop, ran.state[-1], "crane/tip/amnesia")
    assert np.abs(memory).min() > 1e-4
    np.testing.assert_allclose(memory, expected, rtol=1e-6)


DRIFTING = """
robots:
  one:
    urdf: arm.urdf
    base: {joint: planar, velocity: [0.02, -0.01, 0]}
    links: {base: {mass: 1.0e+9, inertia: [1.0e+9, 1.0e+9, 1.0e+9, 0, 0, 0]}}
    joints: {joint_1: {angle_deg: 50}, joint_2: {angle_deg: -70}, joint_3: {angle_deg: 35}}
    tips:
      tip:
        pid: {kp: 40, ki: 60, kd: 2, feedback: base}
        amnesia: {ge: 30, ta: 4}
        reference: {kind: hold}
simulation: {duration: 4, step: 0.005}
"""


@pytest.mark.parametrize("gains", [(400, 600, 20), (4000, 9000, 50)])
@pytest.mark.parametrize(("ge", "ta"), [(9.0, 4.0), (16.0, 6.0)])
def test_steady_base_drift_leaves_an_error_that_no_pid_gain_changes(gains, ge, ta):
    """Robot blind to its base's drift: the tip lags the reference by t_a v_b / G_e, whatever the PID does."""
    tip = "robots.one.tips.tip"
    pid = {f"{tip}.pid.{key}": gain for key, gain in zip(("kp", "ki", "kd"), gains, strict=True)}
    scene = small_scene(DRIFTING, pid | {f"{tip}.amnesia.ge": ge, f"{tip}.amnesia.ta": ta})
    ran = ENGINES["casadi"](scene).run(4.0, 0.5)
    drift = np.array([0.02, -0.01])
    error = ran.outputs["tip_error"][-1, :2]
    np.testing.assert_allclose(error, -ta * drift / ge, rtol=0.02)
    # seen from space, the same robot leaves none of it
    sighted = small_scene(DRIFTING, pid | {f"{tip}.pid.feedback": "inertial"})
    left = ENGINES["casadi"](sighted).run(4.0, 0.5).outputs["tip_error"][-1, :2]
    assert np.abs(left).max() < 0.2 * np.abs(error).max()
