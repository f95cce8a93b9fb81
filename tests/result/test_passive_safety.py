"""Passive safety: closed forms of straight and orbital drift, independent attitudes, simulated drift."""

import json

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

import spacerobot as sr
from spacerobot.cli.app import app
from spacerobot.common.errors import ScenarioError, SpaceRobotError
from spacerobot.result.abort_drift import advance_attitudes, drifted_centre
from tests.oracles.balls import body, scene
from tests.oracles.small_scenes import folder

STICK = """<robot name="stick"><link name="body">
<inertial><origin xyz="0.1 0 0.05"/><mass value="4"/>
<inertia ixx="0.2" iyy="1.1" izz="0.9" ixy="0.05" ixz="0" iyz="-0.1"/></inertial>
<collision><origin xyz="0.7 0.1 0"/><geometry><sphere radius="0.1"/></geometry></collision>
<collision><origin xyz="-0.5 0 0.2"/><geometry><sphere radius="0.15"/></geometry></collision></link>
</robot>"""
ARM = """<robot name="arm"><link name="body">
<inertial><mass value="20"/><inertia ixx="2" iyy="2.5" izz="3" ixy="0" ixz="0.2" iyz="0"/></inertial>
<collision><geometry><sphere radius="0.3"/></geometry></collision></link>
<link name="hand"><inertial><origin xyz="0.5 0 0"/><mass value="5"/>
<inertia ixx="0.1" iyy="0.6" izz="0.6" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0.9 0 0"/><geometry><sphere radius="0.1"/></geometry></collision></link>
<joint name="elbow" type="revolute"><parent link="body"/><child link="hand"/><origin xyz="0.3 0 0"/>
<axis xyz="0 0.6 0.8"/><limit lower="-3" upper="3" effort="9" velocity="9"/></joint></robot>"""


def drifting(robot, target, duration=20.0, step=5.0, **more):
    document = {"robots": {"one": robot}, "target": target}
    times = {"duration": duration, "step": step / 10, "output_step": step}
    return sr.simulate(scene(document | {"simulation": times} | more), backend="interpreted")


def urdf(name, text, base):
    file = folder() / f"passive_{name}.urdf"  # names of its own: other tests' scenes are in this folder too
    file.write_text(text, encoding="utf-8")
    return {"urdf": str(file), "base": {"joint": "free_flyer"} | base}


def test_balls_that_drift_straight_pass_at_the_closed_form_distance():
    velocity, place = np.array([0.02, -0.01, 0.001]), np.array([1.5, 0.1, 0.2])
    one = body("one", 2.0, {"velocity": velocity.tolist(), "spin_deg": [3, 1, 2]})
    other = body("other", 3.0, {"position": place.tolist(), "spin_deg": [0, 10, 0]})
    found = sr.passive_safety(drifting(one, other), duration_s=200.0, tolerance_m=1e-3)
    passing = place @ velocity / (velocity @ velocity)
    expected = np.linalg.norm(place - passing * velocity) - 0.2
    np.testing.assert_allclose(found.time_s, [0, 5, 10, 15, 20])
    assert expected > 0.1
    np.testing.assert_allclose(found.distance_m, expected, atol=1e-3)
    assert (found.distance_m >= expected - 1e-9).all()
    np.testing.assert_allclose(found.drift_s, passing - found.time_s, atol=6)  # flat near the minimum
    # a drift that ends earlier ends at its least distance
    short = sr.passive_safety(drifting(one, other), duration_s=10.0)
    ends = [np.linalg.norm(place - (t + 10) * velocity) - 0.2 for t in found.time_s]
    np.testing.assert_allclose(short.distance_m, ends, atol=1e-12)
    assert short.worst == 4
    assert short.unsafe(short.distance_m[3] + 1e-9).tolist() == [15.0, 20.0]


def test_a_tumbling_target_is_met_where_an_independent_integration_meets_it():
    robot = body("one", 2.0, {"velocity": [0.01, 0.004, 0], "position": [-1.8, -0.3, 0.1]})
    spin, began = np.radians([8.0, -5, 12]), Rotation.from_euler("xyz", [20, -30, 40], degrees=True)
    base = {"spin_deg": np.degrees(spin).tolist(), "rotation_deg": [20, -30, 40]}
    target = urdf("stick", STICK, base)
    result = drifting(robot, target, 5.0)
    found = sr.passive_safety(result, duration_s=60.0, tolerance_m=1e-3)
    # Euler's equations in the body's axes, and the attitude as a rotation matrix
    inertia = np.array([[0.2, 0.05, 0], [0.05, 1.1, -0.1], [0, -0.1, 0.9]])
    matrix, com = began.as_matrix(), np.array([0.1, 0, 0.05])

    def rate(_, y):
        own, turn = y[:3], y[3:].reshape(3, 3)
        skew = np.array([[0, -own[2], own[1]], [own[2], 0, -own[0]], [-own[1], own[0], 0]])
        return np.r_[np.linalg.solve(inertia, -np.cross(own, inertia @ own)), (turn @ skew).ravel()]

    times = np.linspace(0, 60, 60_001)
    first = np.r_[matrix.T @ spin, matrix.ravel()]
    turned = solve_ivp(rate, (0, 60), first, t_eval=times, rtol=1e-10, atol=1e-12).y[3:].T.reshape(-1, 3, 3)
    moved = np.outer(times, np.cross(spin, matrix @ com)) + matrix @ com  # of the centre of mass
    ball = np.array([-1.8, -0.3, 0.1]) + np.outer(times, [0.01, 0.004, 0])
    gaps = [
        np.linalg.norm(moved + turned @ (np.array(own) - com) - ball, axis=1) - 0.1 - radius
        for own, radius in (((0.7, 0.1, 0), 0.1), ((-0.5, 0, 0.2), 0.15))
    ]
    expected = min(gap.min() for gap in gaps)
    assert 0.05 < expected < np.linalg.norm([1.8, 0.3, 0.1]) - 0.9
    assert found.distance_m[0] == pytest.approx(expected, abs=1.2e-3)
    # the abort 5 s later drifts on the same way
    later = min(gap[times >= 5].min() for gap in gaps)
    assert found.distance_m[1] == pytest.approx(later, abs=1.2e-3)


def test_drift_in_a_circular_orbit_is_that_of_clohessy_and_wiltshire():
    orbit = {"orbit": {"kind": "orbit", "altitude": 4e5, "model": "linear", "gravity_gradient": False}}
    one = body("one", 2.0, {"position": [3, -20, 2], "velocity": [0.01, 0.008, -0.004]})
    result = drifting(one, body("other", 3.0, {}), 600.0, 300.0, environment=orbit)
    found = sr.passive_safety(result, duration_s=3000.0)
    n = np.sqrt(3.986004418e14 / (6378137 + 4e5) ** 3)

    def rate(t, y):
        up = np.array([np.cos(n * t), np.sin(n * t), 0])
        return np.r_[y[3:], -(n**2) * (y[:3] - 3 * (up @ y[:3]) * up)]

    times = np.linspace(0, 3600, 7201)
    way = solve_ivp(rate, (0, 3600), [3, -20, 2, 0.01, 0.008, -0.004], t_eval=times, rtol=1e-11, atol=1e-12)
    gaps = np.linalg.norm(way.y[:3], axis=0) - 0.2
    expected = [gaps[(times >= t) & (times <= t + 3000)].min() for t in found.time_s]
    straight = (
        np.linalg.norm(np.cross([3, -20, 2], [0.01, 0.008, -0.004])) / np.linalg.norm([10, 8, -4]) * 1e3
    )
    assert abs(straight - 0.2 - expected[0]) > 0.5
    np.testing.assert_allclose(found.distance_m, expected, rtol=0.01)


def test_an_arm_is_braked_at_the_abort_and_keeps_its_momentum():
    base = {"position": [-1.5, 0, 0.2], "velocity": [0.01, 0, 0], "spin_deg": [2, 0, -3]}
    robot = urdf("arm", ARM, base) | {"joints": {"elbow": {"angle_deg": 30, "rate_deg": 20}}}
    spinning = {"axes": [[0.6, 0, 0.8]], "inertia": 0.02, "speeds": [400]}
    wheels = {"wheels": {"kind": "reaction_wheels"} | spinning}
    locks = wheels | {"brake": {"kind": "joint_failure", "joint": "elbow", "at": 2}}
    target = body("other", 3.0, {})
    found = sr.passive_safety(
        drifting(robot | {"actuators": wheels}, target, 2.0, 1.0), duration_s=28.0, tolerance_m=1e-3
    )
    braked = drifting(robot | {"actuators": locks}, target, 30.0, 0.2)
    model, data = braked.scene().model, braked.scene().model.createData()
    gaps = []
    for q, t in zip(braked.array("q"), braked.array("time"), strict=True):
        if t >= 2 - 1e-9:
            pin.forwardKinematics(model, data, q)
            hand = data.oMi[model.getJointId("one/elbow")].act(np.array([0.9, 0, 0]))
            own = data.oMi[model.getJointId("one/elbow") - 1].translation
            gaps.append(min(np.linalg.norm(hand) - 0.2, np.linalg.norm(own) - 0.4))
    assert found.distance_m[-1] == pytest.approx(min(gaps), abs=2e-3)
    assert abs(found.distance_m[0] - found.distance_m[-1]) > 0.02  # the instant of the abort counts
    result = drifting(robot, target, 2.0, 1.0)
    without = sr.passive_safety(result, duration_s=28.0, tolerance_m=1e-3)
    assert abs(without.distance_m[-1] - found.distance_m[-1]) > 5e-3  # and so does what wheels hold


def test_collisions_are_found():
    one = body("one", 2.0, {"velocity": [0.05, 0, 0]})
    found = sr.passive_safety(
        drifting(one, body("other", 3.0, {"position": [1.0, 0, 0]}), 5.0), duration_s=100
    )
    assert (found.distance_m <= 0).all()


def test_bad_input_is_one_line():
    orbit = {"orbit": {"kind": "orbit", "altitude": 4e5, "eccentricity": 0.1}}
    one, other = body("one", 2.0, {"position": [3, 0, 0]}), body("other", 3.0, {})
    with pytest.raises(ScenarioError, match=r"environment\.orbit: bodies drift in it by no closed form"):
        sr.passive_safety(drifting(one, other, 1.0, 1.0, environment=orbit), duration_s=10)


def test_the_command_exits_with_1_where_a_clearance_is_not_kept(tmp_path):
    one = body("one", 2.0, {"velocity": [0, 0.05, 0]})
    drifting(one, body("other", 3.0, {"position": [1.0, 0, 0]}), 5.0).save(tmp_path / "result")
    ran = [
        CliRunner().invoke(
            app, ["passive-safety", str(tmp_path / "result"), "--drift", "9", "--clearance", far]
        )
        for far in ("0.7", "0.9")
    ]
    assert [one.exit_code for one in ran] == [0, 1]
    assert "0.8 m" in ran[0].output


def test_free_bodies_with_wheels_keep_their_angular_momentum():
    rng = np.random.default_rng(0)
    parts = rng.normal(size=(4, 3, 3))
    inertia = parts @ parts.transpose(0, 2, 1) + np.eye(3)
    wheels, spin = rng.normal(size=(2, 4, 3))
    state = np.concatenate([np.tile([0.0, 0, 0, 1], (4, 1)), spin], axis=1)
    for _ in range(2000):
        state = advance_attitudes(state, inertia, wheels, 0.005)
    turned = Rotation.from_quat(state[:, :4])
    momentum = turned.apply(np.einsum("nij,nj->ni", inertia, state[:, 4:]) + wheels)
    expected = np.einsum("nij,nj->ni", inertia, spin) + wheels
    np.testing.assert_allclose(momentum, expected, atol=1e-6)
    assert np.linalg.norm(turned.as_rotvec(), axis=1).min() > 0.3


def test_centres_drift_by_the_linear_equations_of_an_orbit():
    n, begin, place, velocity = 1.1e-3, 700.0, np.array([3.0, -20, 2]), np.array([0.01, 0.008, -0.004])

    def rate(t, y):
        up = np.array([np.cos(n * t), np.sin(n * t), 0])
        return np.r_[y[3:], -(n**2) * (y[:3] - 3 * (up @ y[:3]) * up)]

    way = solve_ivp(rate, (begin, 3700), np.r_[place, velocity], rtol=1e-11, atol=1e-12).y[:3, -1]
    np.testing.assert_allclose(drifted_centre(place, velocity, begin, 3000.0, n), way, atol=1e-6)
    assert np.linalg.norm(way - place - 3000 * velocity) > 1


def test_an_approach_whose_arm_fails_retreats_to_a_hold_that_is_safe(tmp_path):
    """A detected failure ends the approach; the retreat gains distance, and so does every drift after it."""
    robot = {
        "urdf": "short_arm.urdf",
        "base": {"joint": "planar", "position": [-0.5, 0, 0]},
        "joints": {f"joint_{i}": {"angle_deg": angle} for i, angle in ((1, 40), (2, 40), (3, -40))},
        "tips": {"tip": {"pid": {"kp": 60, "ki": 20, "kd": 40}, "amnesia": {"ge": 60, "ta": 4}}},
        "actuators": {
            "monitor": {"kind": "momentum_observer", "allowance": 0.05},
            "jam": {"kind": "joint_failure", "joint": "joint_3", "mode": "weak", "remaining": 0.2, "at": 1.5},
        },
    }
    come = {
        "kind": "rendezvous",
        "frame": "mate_1",
        "standoff": 0.1,
        "approach_time": 2,
        "closing_speed": 0.02,
    }
    back = {"kind": "line", "displacement": [-0.2, -0.2, 0], "duration": 2}
    target = {
        "joint": "planar",
        "position": [0.8, 0.8, 0],
        "velocity": [0.01, 0.02, 0],
        "spin_deg": [0, 0, 2],
    }
    document = {
        "name": "retreat",
        "robots": {"one": robot},
        "target": {"urdf": "rectangle.urdf", "base": target | {"spin_deg": [0, 0, 2]}},
        "phases": {
            "approach": {
                "robots": {"one": {"tips": {"tip": {"reference": come}}}},
                "abort": {"output": "failures_detected", "of": "one", "above": 0.5},
                "on_abort": "retreat",
            },
            "retreat": {"robots": {"one": {"tips": {"tip": {"reference": back}}}}},
        },
        "simulation": {"duration": 4.5, "step": 0.02, "output_step": 0.5},
    }
    file = tmp_path / "retreat.yaml"
    file.write_text(json.dumps(document), encoding="utf-8")
    result = sr.simulate(sr.load_scene(file), backend="interpreted")
    failed, detected, phase = (event["time_s"] for event in result.summary["events"])
    assert failed < detected == phase < failed + 0.1
    found = sr.passive_safety(result, duration_s=30.0)
    assert (np.diff(found.distance_m[found.time_s > 2]) > 0).all()
    assert found.distance_m[-1] > 0.3
    # one that comes on is as near as it is told to, and nearer the longer it drifts
    document["phases"]["approach"].pop("abort"), document["phases"]["approach"].pop("on_abort")
    del document["phases"]["retreat"], robot["actuators"]
    file.write_text(json.dumps(document), encoding="utf-8")
    comes = sr.passive_safety(sr.simulate(sr.load_scene(file), backend="interpreted"), duration_s=30.0)
    assert comes.distance_m[-1] < 0.12


@pytest.fixture(scope="module")
def balls():
    one = body("one", 2.0, {"velocity": [0.02, 0, 0], "spin_deg": [3, 1, 2]})
    return drifting(one, body("other", 3.0, {"position": [1.5, 0.1, 0.2]}))


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"duration_s": 10.0, "until_s": -5.0}, "until: found -5 s, allowed: from 0 s"),
        ({"duration_s": 10.0, "until_s": np.nan}, "until: found nan s"),
        ({"duration_s": np.inf}, "drift: found inf s, allowed: above 0, at most"),
        ({"duration_s": np.nan}, "drift: found nan s"),
        ({"duration_s": 0.0}, "drift: found 0 s"),
        ({"duration_s": 1e300}, "drift: found 1e\\+300 s"),
        ({"duration_s": 9e7}, "takes .* attitudes, allowed: 2e\\+07; drift for .* s or less"),
        ({"duration_s": 10.0, "tolerance_m": 0.0}, "tolerance: found 0 m"),
    ],
    ids=str,
)
def test_drifts_that_cannot_be_are_refused(balls, options, expected):
    with pytest.raises(SpaceRobotError, match=expected):
        sr.passive_safety(balls, **options)


@pytest.mark.parametrize("clearance", [np.nan, np.inf, -1.0])
def test_a_clearance_that_is_none_is_refused(balls, clearance):
    found = sr.passive_safety(balls, duration_s=1.0)
    with pytest.raises(SpaceRobotError, match="clearance: found"):
        found.unsafe(clearance)


def test_a_longest_drift_that_is_proposed_is_accepted(balls, monkeypatch):
    monkeypatch.setattr("spacerobot.result.abort_drift.MAX_STATES", 1000)
    with pytest.raises(SpaceRobotError) as caught:
        sr.passive_safety(balls, duration_s=1e5)
    longest = float(str(caught.value).partition("drift for ")[2].partition(" s")[0])
    assert sr.passive_safety(balls, duration_s=longest).duration_s == longest
