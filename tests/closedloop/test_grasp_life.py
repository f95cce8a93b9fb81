"""Grasps that begin open, are captured, and let go: events, plastic impacts, energy and momentum."""

import numpy as np
import pinocchio as pin
import pytest

from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.pinocchio_engine.mechanical_state import MechanicalState
from spacerobot.rollout import build_rollout
from tests.oracles.free_bodies import DEEP, ENVELOPE, FLAT, free_bodies
from tests.oracles.hybrid import roll
from tests.oracles.small_scenes import random_x

SCENES = {"planar": FLAT, "spatial": DEEP}
KEPT = ("momentum_linear", "momentum_angular")


def partial(outputs):
    """Largest momentum of a body, linear and angular."""
    return [max(np.linalg.norm(part) for part in np.split(outputs[f"body_{name}"], 2)) for name in KEPT]


def balance(run, x0, c0):
    """What the energy balance leaves open since the start [J]."""
    found = []
    for t, x, c in ((0.0, x0, c0), (run.t, run.x, run.c)):
        y = run.outputs(t, x, c)
        stored = y["energy_kinetic"] + y["energy_spring"] + y["energy_potential"]
        found.append(stored - sum(sign * y[f"work_{name}"] for name, sign in run.loop.works.items()))
    return float((found[1] - found[0])[0])


def at_start(loop):
    return [value.full().ravel() for value in loop.setup(loop.parameter_values)]


def as_bodies(scene, x):
    """Mass, centre, velocity, inertia about the centre and spin of each body, world axes."""
    model, data = scene.model, scene.model.createData()
    q, v = x[: model.nq], x[model.nq : model.nq + model.nv]
    pin.forwardKinematics(model, data, q, v)
    pin.updateFramePlacements(model, data)
    found = []
    for body in scene.bodies:
        joint = body.root_joint
        inertia, place = model.inertias[joint], data.oMi[joint]
        spin = place.rotation @ data.v[joint].angular
        arm = place.rotation @ inertia.lever
        speed = place.rotation @ data.v[joint].linear + np.cross(spin, arm)
        tensor = place.rotation @ inertia.inertia @ place.rotation.T
        found.append((inertia.mass, place.translation + arm, speed, tensor, spin))
    return found


@pytest.mark.parametrize("bases", SCENES.values(), ids=SCENES)
@pytest.mark.parametrize("kind", ["point", "weld", "compliant"])
def test_momentum_and_energy_are_accounted_for_across_a_capture(tmp_path, bases, kind):
    scene = free_bodies(tmp_path, bases, {"kind": kind, "capture": {"distance": 0.05}})
    loop = build_closed_loop(scene)
    run = roll(loop, 2.0)
    assert run.names == ["left.captured"]
    event = run.events[0]
    before = run.outputs(event.time, event.before, event.c_before)
    after = run.outputs(event.time, event.after, event.c_after)
    for name, largest in zip(KEPT, partial(before), strict=True):
        assert np.abs(after[name] - before[name]).max() < 1e-12 * largest
    taken = after["work_event"] - before["work_event"] if kind != "compliant" else np.zeros(1)
    lost = before["energy_kinetic"] - after["energy_kinetic"]
    assert taken == pytest.approx(lost, abs=1e-14)
    assert (taken > 0) == (kind != "compliant")
    assert abs(balance(run, *at_start(loop))) < 1e-6 * before["energy_kinetic"][0]
    assert after["grasp_state"] == 2
    assert before["grasp_state"] == 0
    np.testing.assert_allclose(np.linalg.norm(before["grasp_gap"]), 0.05, rtol=1e-9)
    np.testing.assert_allclose(after["grasp_captured_at"], event.time)


@pytest.mark.parametrize("bases", SCENES.values(), ids=SCENES)
def test_a_weld_in_flight_makes_one_body(tmp_path, bases):
    """Momentum and the merged inertia alone say how two welded bodies move on."""
    scene = free_bodies(tmp_path, bases, {"kind": "weld", "capture": {"distance": 0.06}})
    loop = build_closed_loop(scene)
    event = roll(loop, 2.0).events[0]
    parts = as_bodies(scene, event.before)
    mass = sum(m for m, *_ in parts)
    centre = sum(m * c for m, c, *_ in parts) / mass
    speed = sum(m * v for m, _, v, *_ in parts) / mass
    tensor, moment = np.zeros((3, 3)), np.zeros(3)
    for m, c, v, inertia, spin in parts:
        arm = c - centre
        tensor += inertia + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        moment += inertia @ spin + m * np.cross(arm, v - speed)
    axes = list(scene.rotation_axes)
    expected = np.zeros(3)
    expected[axes] = np.linalg.solve(tensor[np.ix_(axes, axes)], moment[axes])
    for _, c, v, _, spin in as_bodies(scene, event.after):
        np.testing.assert_allclose(spin, expected, atol=1e-13)
        np.testing.assert_allclose(v, speed + np.cross(expected, c - centre), atol=1e-13)
    # impulse and couple at the tip change the target's momentum
    m, c, v, inertia, spin = parts[1]
    _, _, after, _, turned = as_bodies(scene, event.after)[1]
    names = np.array([name.partition("[")[0] for name in loop.state_names])
    impulse, couple = np.zeros(3), np.zeros(3)
    impulse[list(scene.translation_axes)] = event.after[names == "left.impulse"]
    couple[axes] = event.after[names == "left.couple"]
    np.testing.assert_allclose(m * (after - v), impulse, atol=1e-13)
    arm = motion_of_tip(scene, event.before)["tip"].position - c
    turning = couple + np.cross(arm, impulse)
    np.testing.assert_allclose((inertia @ (turned - spin))[axes], turning[axes], atol=1e-13)


def motion_of_tip(scene, x):
    """Motions of tip and mating frame, and the gap, rotation vector, velocity and spin between them."""
    model, grasp = scene.model, scene.grasps[0]
    state = MechanicalState(model, x[: model.nq], x[model.nq : model.nq + model.nv])
    tip, mate = state.frame(grasp.tip.frame), state.frame(grasp.frame)
    gap, spin = tip.position - mate.position, tip.velocity[3:] - mate.velocity[3:]
    velocity = tip.velocity[:3] - mate.velocity[:3] - np.cross(mate.velocity[3:], gap)
    mated = pin.rpy.rpyToMatrix(np.radians(grasp.config.capture.mated_deg))
    turn = pin.log3(tip.rotation @ (mate.rotation @ mated).T)
    return {"tip": tip, "mate": mate, "gap": gap, "turn": turn, "velocity": velocity, "spin": spin}


@pytest.mark.parametrize("bases", SCENES.values(), ids=SCENES)
@pytest.mark.parametrize("name", ENVELOPE)
def test_the_margin_of_an_envelope_is_one_less_the_square_of_the_part_of_its_limit(tmp_path, bases, name):
    turn = [0, 0, 5] if bases is FLAT else [4, -3, 5]
    capture = {name: ENVELOPE[name], "axis": [1, 0.3, 0], "mated_deg": turn}
    scene = free_bodies(tmp_path, bases, {"kind": "point", "capture": capture})
    loop = build_closed_loop(scene)
    (captured,) = (k for k, event in enumerate(loop.events) if event.kind == "captured")
    _, c = at_start(loop)
    for seed in range(3):
        x = random_x(scene, np.random.default_rng(seed), loop.nx)
        now = motion_of_tip(scene, x)
        axis = now["mate"].rotation @ [1, 0.3, 0] / np.linalg.norm([1, 0.3, 0])
        closing = axis @ now["velocity"]
        value = {
            "distance": np.linalg.norm(now["gap"]),
            "misalignment_deg": np.degrees(np.linalg.norm(now["turn"])),
            "closing_speed": closing,
            "lateral_speed": np.linalg.norm(now["velocity"] - closing * axis),
            "spin_deg": np.degrees(np.linalg.norm(now["spin"])),
        }[name]
        margin = loop.guards(0, x, c, np.zeros(loop.nx))[0].full()[captured, 0]
        assert margin == pytest.approx(1 - (value / ENVELOPE[name]) ** 2, rel=1e-9)


@pytest.mark.parametrize("bases", SCENES.values(), ids=SCENES)
def test_a_capture_keeps_its_time_and_motion_and_draws_in_by_a_cubic_blend(tmp_path, bases):
    """The faster of the two rates of drawing in is the least that is used, at the middle of the way."""
    turn = [0, 0, 5] if bases is FLAT else [4, -3, 5]
    capture = {"at": 0.3, "draw_in": 0.05, "draw_in_deg": 9, "mated_deg": turn}
    scene = free_bodies(tmp_path, bases, {"kind": "weld", "capture": capture})
    loop = build_closed_loop(scene)
    run = roll(loop, 0.8, rtol=1e-11)
    event = run.events[0]
    met, kept = motion_of_tip(scene, event.before), run.outputs(event.time, event.after, event.c_after)
    assert kept["grasp_captured_at"] == pytest.approx(event.time)
    assert event.time == pytest.approx(0.3)
    np.testing.assert_allclose(kept["grasp_capture_velocity"], met["velocity"], atol=1e-12)
    np.testing.assert_allclose(kept["grasp_capture_spin"], met["spin"], atol=1e-12)
    np.testing.assert_allclose(kept["grasp_capture_gap"], met["mate"].rotation.T @ met["gap"], atol=1e-12)
    ways = np.linalg.norm(met["gap"]) / 0.05, np.linalg.norm(met["turn"]) / np.radians(9)
    s = (run.t - event.time) / (1.5 * max(ways))
    left, now = 1 - s**2 * (3 - 2 * s), motion_of_tip(scene, run.x)
    np.testing.assert_allclose(run.outputs()["grasp_gap"], now["gap"], atol=1e-12)
    for part in ("gap", "turn"):  # along the vectors at the capture, which turn with the target
        first = now["mate"].rotation @ met["mate"].rotation.T @ met[part]
        np.testing.assert_allclose(now[part], left * first, atol=1e-8)


@pytest.mark.parametrize("bases", SCENES.values(), ids=SCENES)
def test_a_point_capture_is_the_plastic_impact_of_two_free_bodies(tmp_path, bases):
    scene = free_bodies(tmp_path, bases, {"kind": "point", "capture": {"distance": 0.05}})
    loop = build_closed_loop(scene)
    event = roll(loop, 2.0).events[0]
    model, data = scene.model, scene.model.createData()
    pin.framesForwardKinematics(model, data, event.before[: model.nq])
    point = data.oMf[scene.grasps[0].tip.frame].translation
    axes = list(scene.translation_axes)
    mobility, slip = np.zeros((3, 3)), np.zeros(3)
    for sign, (m, c, v, inertia, spin) in zip((1, -1), as_bodies(scene, event.before), strict=True):
        turn = np.zeros((3, 3))
        about = list(scene.rotation_axes)
        turn[np.ix_(about, about)] = np.linalg.inv(inertia[np.ix_(about, about)])
        arm = pin.skew(point - c)
        mobility += np.eye(3) / m - arm @ turn @ arm
        slip += sign * (v + np.cross(spin, point - c))
    impulse = np.zeros(3)
    impulse[axes] = np.linalg.solve(mobility[np.ix_(axes, axes)], slip[axes])  # on the target
    names = [name.partition("[")[0] for name in loop.state_names]
    found = np.zeros(3)
    found[axes] = event.after[[i for i, name in enumerate(names) if name == "left.impulse"]]
    np.testing.assert_allclose(found, impulse, atol=1e-13)
    work = names.index("work.event")
    assert event.after[work] == pytest.approx(impulse @ slip / 2, rel=1e-12)
    (m, _, before, *_), (_, _, after, *_) = (
        as_bodies(scene, event.before)[1],
        as_bodies(scene, event.after)[1],
    )
    np.testing.assert_allclose(m * (after - before), impulse, atol=1e-13)


@pytest.mark.parametrize("bases", SCENES.values(), ids=SCENES)
def test_a_welded_pair_keeps_its_relative_pose(tmp_path, bases):
    scene = free_bodies(tmp_path, bases, {"kind": "weld", "capture": {"distance": 0.05}})
    run = roll(build_closed_loop(scene), 2.5)
    model, data, poses = scene.model, scene.model.createData(), []
    for x in (run.events[0].after, run.x):
        pin.framesForwardKinematics(model, data, x[: model.nq])
        poses.append(data.oMf[scene.grasps[0].frame].inverse() * data.oMf[scene.grasps[0].tip.frame])
    np.testing.assert_allclose(poses[1].homogeneous, poses[0].homogeneous, atol=1e-9)


@pytest.mark.parametrize("bases", SCENES.values(), ids=SCENES)
@pytest.mark.parametrize("kind", ["point", "weld", "compliant"])
def test_what_is_drawn_in_ends_at_the_mating_frame(tmp_path, bases, kind):
    capture = {"distance": 0.05, "draw_in": 0.05} | ({"draw_in_deg": 10.0} if kind != "point" else {})
    grasp = {"kind": kind, "capture": capture}
    if kind == "compliant":
        grasp |= {"stiffness": 2e4, "damping": 800, "rotational_stiffness": 800, "rotational_damping": 60}
    scene = free_bodies(tmp_path, bases, grasp)
    loop = build_closed_loop(scene)
    run = roll(loop, 6.0, rtol=1e-9)
    assert run.names == ["left.captured", "left.drawn"]
    y = run.outputs()
    assert np.linalg.norm(y["grasp_gap"]) < (1e-4 if kind == "compliant" else 1e-8)
    if kind != "point":
        assert np.linalg.norm(y["grasp_misalignment"]) < (1e-3 if kind == "compliant" else 1e-8)
    assert abs(balance(run, *at_start(loop))) < 1e-6 * y["energy_kinetic"][0]


def test_it_closes_after_the_dwell_time_and_counts_again_after_leaving(tmp_path):
    capture = {"distance": 0.06, "closing_speed": 0.1, "dwell": 0.4}
    scene = free_bodies(tmp_path, FLAT, {"kind": "compliant", "capture": capture})
    run = roll(build_closed_loop(scene), 2.0)
    assert run.names == ["left.entered", "left.captured"]
    assert run.events[1].time - run.events[0].time == pytest.approx(0.4, abs=1e-9)
    long = {"capture": capture | {"dwell": 5.0}, "kind": "compliant"}
    run = roll(build_closed_loop(free_bodies(tmp_path, FLAT, long)), 5.0)
    assert run.names == ["left.entered", "left.left"]
    assert run.outputs()["grasp_state"] == 0


def test_it_slips_off_where_it_is_pulled_too_hard(tmp_path):
    grasp = {
        "kind": "compliant",
        "stiffness": 100,
        "damping": 1,
        "capture": {"at": 0.2},
        "release": {"force": 0.3},
    }
    scene = free_bodies(tmp_path, FLAT, grasp)
    loop = build_closed_loop(scene)
    run = roll(loop, 3.0)
    assert run.names == ["left.captured", "left.slipped_by_force"]
    event = run.events[1]
    before = run.outputs(event.time, event.before, event.c_before)
    assert np.linalg.norm(before["grasp_force"]) == pytest.approx(0.3, rel=1e-8)
    assert before["energy_spring"] > 0
    assert run.outputs()["work_event"] == pytest.approx(before["energy_spring"])
    assert run.outputs()["grasp_state"] == 3
    assert abs(balance(run, *at_start(loop))) < 1e-9
    assert [rule.kind for rule in loop.events] == ["captured", "slipped"]


@pytest.mark.parametrize("kind", ["point", "weld"])
def test_a_rigid_grasp_slips_off_and_is_released_at_a_time(tmp_path, kind):
    scene = free_bodies(tmp_path, FLAT, {"kind": kind, "capture": {"at": 0.2}, "release": {"at": 0.9}})
    run = roll(build_closed_loop(scene), 2.0)
    assert run.names == ["left.captured", "left.released"]
    assert run.events[1].time == pytest.approx(0.9, abs=1e-9)
    np.testing.assert_array_equal(run.events[1].after, run.events[1].before)
    scene = free_bodies(tmp_path, FLAT, {"kind": kind, "capture": {"at": 0.2}, "release": {"force": 1e-4}})
    run = roll(build_closed_loop(scene), 2.0)
    assert run.names == ["left.captured", "left.slipped_by_force"]


def test_a_grasp_that_begins_closed_can_let_go(tmp_path):
    grasp = {"kind": "weld", "begins": "closed", "release": {"at": 0.5}}
    run = roll(build_closed_loop(free_bodies(tmp_path, FLAT, grasp)), 1.0)
    assert run.names == ["left.released"]
    y = run.outputs()
    assert y["grasp_state"] == 3
    assert "work_event" not in y


MISSES = {"at": 0.1, "mode": "misses", "retry": 0.25}


@pytest.mark.parametrize(
    "capture",
    [{"distance": 0.06}, {"distance": 0.06, "dwell": 0.3}, {"at": 0.4}],
    ids=["envelope", "dwell", "time"],
)
def test_a_gripper_that_misses_tries_again(tmp_path, capture):
    nominal, failing = (
        build_closed_loop(free_bodies(tmp_path, FLAT, {"kind": "weld", "capture": capture} | more))
        for more in ({}, {"failure": MISSES})
    )
    first = roll(nominal, 2.0).events[-1]
    run = roll(failing, 2.0)
    assert first.name == "left.captured"
    assert run.names[0] == "left.failed"
    assert run.names[-2:] == ["left.missed", "left.captured"]
    assert run.events[-2].time == pytest.approx(first.time, abs=1e-8)
    assert run.events[-1].time == pytest.approx(first.time + 0.25, abs=1e-8)
    assert abs(balance(run, *at_start(failing))) < 1e-9


def test_a_gripper_that_fails_after_it_has_closed_misses_nothing(tmp_path):
    grasp = {"kind": "weld", "capture": {"at": 0.4}, "failure": MISSES | {"at": 0.5}}
    assert roll(build_closed_loop(free_bodies(tmp_path, FLAT, grasp)), 1.0).names == [
        "left.captured",
        "left.failed",
    ]


@pytest.mark.parametrize(("at", "names"), [(0.1, []), (0.5, ["captured"]), (1.0, ["captured", "released"])])
def test_a_jammed_gripper_stays_as_it_is(tmp_path, at, names):
    grasp = {"kind": "weld", "capture": {"at": 0.2}, "release": {"at": 0.9}}
    grasp["failure"] = {"at": at, "mode": "jammed"}
    run = roll(build_closed_loop(free_bodies(tmp_path, FLAT, grasp)), 1.5)
    assert [name.removeprefix("left.") for name in run.names if not name.endswith("failed")] == names
    assert run.outputs()["grasp_state"] == {0: 0, 1: 2, 2: 3}[len(names)]


STRETCHED = {"kind": "compliant", "stiffness": 100, "damping": 1, "capture": {"at": 0.2}}
WEAK = {"release": {"force": 1.6}, "failure": {"at": 0.3, "mode": "weak", "remaining": 0.6}}


@pytest.mark.parametrize("at", [0.3, 0.5], ids=["later", "at once"])
def test_a_weak_gripper_breaks_away_at_what_is_left(tmp_path, at):
    weak = WEAK | {"failure": WEAK["failure"] | {"at": at}}
    loop = build_closed_loop(free_bodies(tmp_path, FLAT, STRETCHED | weak))
    run = roll(loop, 1.5)
    assert run.names == ["left.captured", "left.failed", "left.slipped_by_force"]
    slipped = run.events[-1]
    force = np.linalg.norm(run.outputs(slipped.time, slipped.before, slipped.c_before)["grasp_force"])
    if at == 0.3:
        assert slipped.time > 0.31
        assert force == pytest.approx(0.96, rel=1e-8)
    else:
        assert slipped.time == run.events[1].time
        assert 0.96 < force < 1.6
    assert abs(balance(run, *at_start(loop))) < 1e-9


@pytest.mark.parametrize(
    ("grasp", "path"),
    [
        (STRETCHED | WEAK, "remaining"),
        (STRETCHED | WEAK | {"failure": WEAK["failure"] | {"at": 0.5}}, "at"),
        ({"kind": "weld", "capture": {"distance": 0.06}, "failure": MISSES}, "retry"),
    ],
    ids=["weak later", "weak at once", "misses"],
)
def test_gradients_by_failures_of_a_gripper_are_exact(tmp_path, grasp, path):
    loop = build_closed_loop(free_bodies(tmp_path, FLAT, grasp))
    rollout = build_rollout(loop, duration_s=1.5, step_s=0.01, output_step_s=0.5, backend="interpreted")
    name = f"grasps.left.failure.{path}"
    value = loop.parameters()[loop.index(name)]
    slopes = rollout.jacobian(wrt=[name], outputs=["body_position"]).outputs["body_position"][-1, :, 0]
    ends = [rollout.run({name: value + h}).outputs["body_position"][-1] for h in (2e-3, -2e-3, 1e-3, -1e-3)]
    coarse, fine = (ends[0] - ends[1]) / 4e-3, (ends[2] - ends[3]) / 2e-3
    assert np.abs(slopes).max() > 1e-3
    np.testing.assert_allclose(slopes, fine + (fine - coarse) / 3, atol=1e-5 * np.abs(slopes).max())


@pytest.mark.parametrize(
    ("grasp", "told"),
    [
        ({"begins": "closed", "failure": MISSES}, "found misses, but without `capture`"),
        ({"capture": {"at": 1}, "failure": {"at": 1, "mode": "weak"}}, "found weak, but there is no"),
    ],
)
def test_failures_that_can_do_nothing_are_refused(tmp_path, grasp, told):
    with pytest.raises(ScenarioError, match=told):
        free_bodies(tmp_path, FLAT, {"kind": "weld"} | grasp)
