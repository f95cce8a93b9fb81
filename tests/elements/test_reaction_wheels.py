"""Reaction wheels, and joints of the URDF as such: closed forms, saturation, momentum, what is refused."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from spacerobot import build_rollout, simulate
from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.elements.actuators.reaction_wheels import ReactionWheels
from spacerobot.pinocchio_engine import simulate as pinocchio
from spacerobot.pinocchio_engine import simulate as second
from spacerobot.scenario.load import validate
from spacerobot.scene import build_scene, load_scene
from tests.oracles.small_scenes import PLANAR, small_scene

MASS, TURN, WHEEL = 20.0, 2.0, 0.05
"""Mass and inertia of the body, inertia of a wheel about its axis [kg, kg m^2]."""
LINK = (
    '<link name="{}"><inertial><mass value="{}"/>'
    '<inertia ixx="{}" iyy="{}" izz="{}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="{0}" type="continuous"><parent link="bus"/><child link="{0}_rotor"/>'
    '<axis xyz="{1}"/><dynamics damping="{2}"/></joint>'
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """URDFs of a lone body, and of one with three rotors about the axes of its own."""
    place = tmp_path_factory.mktemp("bus")
    (place / "bus.urdf").write_text(f'<robot name="bus">{LINK.format("bus", MASS, 1.5, 1.8, TURN)}</robot>')
    rotors = ""
    for name, axis in (("x", "1 0 0"), ("y", "0 1 0"), ("z", "0 0 1")):
        about = [WHEEL if own == name else 0.03 for own in "xyz"]
        rotors += LINK.format(f"{name}_rotor", 1, *about) + JOINT.format(name, axis, 1e-4)
    bare = LINK.format(
        "bus", MASS - 3, 1.5 - 0.06, 1.8 - 0.06, TURN - 0.06
    )  # what is across the axes goes with it
    (place / "rotors.urdf").write_text(f'<robot name="bus">{bare}{rotors}</robot>')
    return place


def scene_of(folder, wheels, base=None, control=None, *, urdf="bus", duration=4.0):
    """A lone body with wheels, whose attitude is controlled or not."""
    robot = {
        "urdf": str(folder / f"{urdf}.urdf"),
        "base": {"joint": "planar"} | (base or {}),
        "torque_limits": urdf == "rotors",  # without efforts: as wheels they have limits of their own
        "actuators": {"wheels": {"kind": "reaction_wheels"} | wheels},
        "controllers": {"hold": {"kind": "base_attitude", "feed_forward": 0} | control} if control else {},
    }
    simulation = {"duration": duration, "step": 0.01, "output_step": 0.02}
    return build_scene(validate({"robots": {"bus": robot}, "simulation": simulation}))


ONE = {"axes": [[0, 0, 1]], "inertia": WHEEL}


def conserved(result, parts=1e-10):
    """Momentum of everything, in parts of its largest in a body, and the energy balance."""
    ledger = result.summary["ledger"]
    assert ledger["momentum"]["linear"]["relative_drift"] < parts
    assert ledger["momentum"]["angular"]["relative_drift"] < parts
    assert ledger["energy"]["relative_residual"] < parts


def test_a_body_under_pd_is_a_second_order_system(folder):
    """I theta'' + kd theta' + kp theta = 0, whatever the wheel's inertia."""
    kp, kd, spin = 3.0, 1.2, np.radians(8)
    scene = scene_of(folder, ONE, {"spin_deg": [0, 0, 8]}, {"kp": kp, "kd": kd})
    result = simulate(scene, backend="interpreted")
    t = result.data.time.values
    decay = kd / (2 * TURN)
    beat = np.sqrt(kp / TURN - decay**2)
    angle = spin / beat * np.exp(-decay * t) * np.sin(beat * t)
    np.testing.assert_allclose(result.data.body_angle.sel(body="bus"), angle, atol=1e-10)
    rate = spin * np.exp(-decay * t) * (np.cos(beat * t) - decay / beat * np.sin(beat * t))
    speed = (TURN + WHEEL) / WHEEL * (spin - rate)  # from rest relative to the body
    np.testing.assert_allclose(result.data.wheel_speed[:, 0], speed, atol=1e-8)
    assert result.data.wheel_speed.attrs["units"] == "rad/s"
    conserved(result)


def test_what_one_set_leaves_is_taken_by_the_next(folder):
    """The first motor gives little; together they give what is asked, and hold their momentum together."""
    scene = scene_of(folder, ONE | {"torque_limit": 0.02}, {"spin_deg": [0, 0, 8]}, {"kd": 1.2})
    body = scene.scenario.robots["bus"]
    more = {"wheels": body.actuators["wheels"], "other": ReactionWheels(axes=((0, 0, -1),), inertia=0.1)}
    robots = {"bus": body.model_copy(update={"actuators": more})}
    scene = build_scene(scene.scenario.model_copy(update={"robots": robots}))
    data = simulate(scene, backend="interpreted").data
    spin = np.radians(8) * np.exp(-1.2 * data.time.values / TURN)
    np.testing.assert_allclose(data.v.sel(velocity="v.bus/root[2]"), spin, atol=1e-11)
    torque = data.wheel_torque
    np.testing.assert_allclose(torque.sel(wheel="bus/wheels.0"), np.minimum(0.02, 1.2 * spin), atol=1e-11)
    np.testing.assert_allclose(
        data.wheel_momentum.sel(body="bus", axis="z"),
        TURN * (np.radians(8) - spin) + 0.15 * np.radians(8),
        atol=1e-11,
    )


def test_what_joints_as_wheels_leave_is_taken_by_the_next(folder):
    base, joints = {"joint": "free_flyer", "spin_deg": [0, 0, 8]}, {"kind": "wheel_joints", "joints": "*"}
    scene = scene_of(folder, joints | {"torque_limit": 0.02}, base, {"kd": 1.2}, urdf="rotors")
    body = scene.scenario.robots["bus"]
    more = {"wheels": body.actuators["wheels"], "other": ReactionWheels(axes=((0, 0, -1),), inertia=0.1)}
    robots = {"bus": body.model_copy(update={"actuators": more})}
    scene = build_scene(
        scene.scenario.model_copy(update={"robots": robots}), {"robots.bus.joints.*.damping": 0}
    )
    data = simulate(scene, backend="interpreted").data
    spin = np.radians(8) * np.exp(-1.2 * data.time.values / TURN)
    np.testing.assert_allclose(data.v.sel(velocity="v.bus/root[5]"), spin, atol=1e-10)
    given = data.wheel_torque.sel(wheel="bus/wheels.2")
    np.testing.assert_allclose(given, np.minimum(0.02, 1.2 * spin), atol=1e-10)


def test_a_wheel_that_rubs_spins_its_body_up(folder):
    """Free of torque from outside: speed s' = -c s (1/J + 1/I), and the body takes what the wheel loses."""
    c, speed = 0.02, 40.0
    scene = scene_of(folder, ONE | {"viscous": c, "speeds": [speed]})
    result = simulate(scene, backend="interpreted")
    found = speed * np.exp(-c * (1 / WHEEL + 1 / TURN) * result.data.time.values)
    np.testing.assert_allclose(result.data.wheel_speed[:, 0], found, atol=1e-9)
    spin = result.data.v.sel(velocity="v.bus/root[2]")
    np.testing.assert_allclose(spin, WHEEL * (speed - found) / (WHEEL + TURN), atol=1e-11)
    conserved(result)


LIMITED = ONE | {"speed_limit": 8.0, "viscous": 1e-3, "coulomb": 2e-3}
TURNED = {"kp": 3.0, "kd": 5.0, "attitude_deg": [0, 0, 40]}


def test_a_wheel_at_its_limit_keeps_its_momentum_until_what_is_asked_leads_back(folder):
    result = simulate(scene_of(folder, LIMITED, control=TURNED), backend="interpreted")
    events = result.summary["events"]
    assert [(event["kind"], event["who"]) for event in events] == [
        ("saturated", "bus/wheels.0"),
        ("freed", "bus/wheels.0"),
    ]
    assert all(event["momentum_change"] < 1e-12 for event in events)
    first, last = (event["time_s"] for event in events)
    data = result.data.sel(time=slice(first, last))
    assert data.sizes["time"] > 20
    np.testing.assert_allclose(data.wheel_speed, -8.0, rtol=1e-10)
    np.testing.assert_allclose(data.wheel_margin, 0.0, atol=1e-10)
    spin = data.v.sel(velocity="v.bus/root[2]").values
    np.testing.assert_allclose(spin, WHEEL * 8 / (WHEEL + TURN), rtol=1e-10)
    rub = -1e-3 * 8 - 2e-3 * 8 / np.sqrt(8**2 + 1)
    np.testing.assert_allclose(data.wheel_torque, rub, rtol=1e-8)  # the motor balances friction
    angle = float(data.body_angle[-1, 0]) + spin[-1] * (last - float(data.time[-1]))
    assert 3 * (np.radians(40) - angle) - 5 * spin[-1] == pytest.approx(
        -rub, abs=1e-9
    )  # as when it was freed
    assert (np.abs(result.data.wheel_speed.sel(time=slice(last + 0.02, None))) < 8).all()
    conserved(result)


def test_the_second_engine_tells_the_same_saturation(folder):
    scene = scene_of(folder, LIMITED, control=TURNED, duration=1.6)
    simulation = scene.scenario.simulation.model_copy(update={"engine": "pinocchio", "output_step": 0.4})
    scenario = scene.scenario.model_copy(update={"simulation": simulation})
    one, other = (
        simulate(scene, backend="interpreted"),
        simulate(dataclasses.replace(scene, scenario=scenario)),
    )
    told = [[(e["name"], e["time_s"]) for e in result.summary["events"]] for result in (one, other)]
    assert [name for name, _ in told[0]] == [name for name, _ in told[1]]
    np.testing.assert_allclose([t for _, t in told[0]], [t for _, t in told[1]], atol=1e-8)
    for name in ("wheel_speed", "wheel_torque", "wheel_margin", "wheel_momentum", "body_rotation"):
        seen = one.data[name].sel(time=other.data.time, method="nearest")
        np.testing.assert_allclose(seen, other.data[name], atol=1e-8, err_msg=name)
    conserved(other, 1e-9)


def test_the_others_of_a_redundant_set_take_over_what_a_held_wheel_does_not_give(folder):
    """With one or two of five wheels held, the base moves as if none were; both engines say so."""
    wheels = {"pyramid": {"tilt_deg": 35, "wheels": 5}, "inertia": WHEEL, "speeds": [-20, 5, 0, 2, -16]}
    control, base = {"kp": 2.0, "kd": 1.5, "attitude_deg": [40, -20, 30]}, {"joint": "free_flyer"}
    free, limited = (
        scene_of(folder, wheels | limit, base, control, duration=1.2) for limit in ({}, {"speed_limit": 24})
    )
    one, other = (simulate(scene, backend="interpreted") for scene in (free, limited))
    events = other.summary["events"]
    assert [(e["kind"], e["who"]) for e in events][:2] == [
        ("saturated", "bus/wheels.0"),
        ("saturated", "bus/wheels.4"),
    ]
    np.testing.assert_allclose(one.data.body_rotation, other.data.body_rotation, atol=1e-7)
    assert float(abs(one.data.wheel_speed - other.data.wheel_speed).max()) > 1
    conserved(other)
    found = second(limited, duration_s=1.2, output_step_s=0.4, rtol=1e-9, atol=1e-11)
    assert [event.name for event in found.happened] == [event["name"] for event in events]
    times = [[event.time_s for event in found.happened], [event["time_s"] for event in events]]
    np.testing.assert_allclose(*times, atol=1e-6)
    speeds = other.data.wheel_speed.sel(time=found.time, method="nearest")
    np.testing.assert_allclose(found.outputs["wheel_speed"], speeds, atol=1e-5)


def _hubs(count):
    """Random turns of a hub whose wheels come to their limits, as parameters."""
    draw, robot = np.random.default_rng(0), "robots.bus."
    for _ in range(count):
        values = {"controllers.hold.kp": draw.uniform(0.03, 0.4), "controllers.hold.kd": draw.uniform(0.4, 2)}
        values["actuators.wheels.inertia"] = draw.uniform(1e-3, 4e-3)
        for i in range(3):
            values[f"base.spin_deg.{i}"] = draw.uniform(-15, 15)
            values[f"controllers.hold.attitude_deg.{i}"] = draw.uniform(-60, 60)
        for i in range(4):
            values[f"actuators.wheels.speeds.{i}"] = draw.uniform(-150, 150)
        yield {robot + name: float(value) for name, value in values.items()}


HUB = {"pyramid": {}, "inertia": 2e-3, "speed_limit": 190.0, "speeds": [1, 1, 1, 1]}
HUB_CONTROL = {"kp": 0.1, "kd": 1.0, "attitude_deg": [1, 1, 1]}
TUMBLING = {"joint": "free_flyer", "spin_deg": [1, 1, 1]}


@pytest.mark.parametrize("friction", [{}, {"viscous": 1e-5, "coulomb": 2e-4}])
@pytest.mark.usefixtures("compiled")
def test_wheels_of_a_pyramid_that_come_to_their_limits_do_not_chatter(folder, friction):
    """All of 400 complete, in lanes and alone, with the same events."""
    loop = build_closed_loop(scene_of(folder, HUB | friction, TUMBLING, HUB_CONTROL))
    rollout = build_rollout(loop, duration_s=60.0, step_s=0.1, output_step_s=1.0)
    hubs = list(_hubs(400))
    batch = rollout.batch(list(hubs[0]), [list(hub.values()) for hub in hubs])
    assert not np.isfinite(batch.diverged_at_s).any()
    assert (batch.events.count > 0).sum() > 200
    assert batch.events.count.max() < 100
    for hub, events in zip(hubs[:40], batch.events.event, strict=False):
        alone = rollout.run(hub)
        assert alone.status == "completed"
        found = [fired.event for fired in alone.events]
        assert found == events[events >= 0].tolist()[: len(found)]


def test_the_second_engine_holds_the_same_wheels_of_a_pyramid(folder):
    """Of a hub whose wheels chattered; friction too is balanced by the motors of held wheels."""
    hub = {path.removeprefix("robots.bus."): value for path, value in [*_hubs(8)][7].items()}

    def vector(path, size=3):
        return [hub[f"{path}.{i}"] for i in range(size)]

    own = {"inertia": hub["actuators.wheels.inertia"], "speeds": vector("actuators.wheels.speeds", 4)}
    control = {key: hub[f"controllers.hold.{key}"] for key in ("kp", "kd")}
    control["attitude_deg"] = vector("controllers.hold.attitude_deg")
    base = {"joint": "free_flyer", "spin_deg": vector("base.spin_deg")}
    wheels = HUB | own | {"viscous": 1e-5, "coulomb": 2e-4}
    scene = scene_of(folder, wheels, base, control, duration=3.0)
    one = simulate(scene, backend="interpreted")
    other = second(scene, duration_s=3.0, output_step_s=1.0, rtol=1e-8, atol=1e-10)
    events = one.summary["events"]
    assert len(events) > 3
    assert [event.name for event in other.happened] == [event["name"] for event in events]
    times = [[event.time_s for event in other.happened], [event["time_s"] for event in events]]
    np.testing.assert_allclose(*times, atol=1e-5)
    rotation = one.data.body_rotation.sel(body="bus").sel(time=other.time, method="nearest")
    np.testing.assert_allclose(other.outputs["body_rotation"], rotation, atol=1e-6)


def test_a_wheel_whose_base_turns_after_it_is_free_before_what_is_asked_leads_back(folder):
    """What turns the base the way a held wheel turns makes it slower relative to the base."""
    scene = scene_of(folder, LIMITED, {"spin_deg": [0, 0, 8]}, {"kd": 2.0})
    loop = build_closed_loop(scene)
    x, c = (value.full().ravel() for value in loop.setup(loop.parameter_values))
    c[loop.switches[0]] = 1.0
    spin, own = loop.state_names.index("v.bus/root[2]"), loop.state_names.index("bus/wheels.momentum[0]")
    x[spin], x[own] = 0.2, WHEEL * (8.0 + 0.2)
    guard = loop.guards(0, x, c, np.zeros(loop.nx))[0].full().ravel()
    assert np.isneginf(guard[0])
    assert guard[1] < 0
    x[spin] += 0.03  # beyond a thousandth of the limit
    assert loop.guards(0, x, c, np.zeros(loop.nx))[0].full().ravel()[1] > 0


@pytest.mark.parametrize("path", ["inertia", "speed_limit"])
def test_gradients_go_through_saturation(folder, path):
    loop = build_closed_loop(scene_of(folder, LIMITED, control=TURNED, duration=3.0))
    rollout = build_rollout(loop, duration_s=3.0, step_s=0.01, output_step_s=1.0, backend="interpreted")
    name = f"robots.bus.actuators.wheels.{path}"
    value = loop.parameters()[loop.index(name)]
    slopes = rollout.jacobian(wrt=[name], outputs=["wheel_speed", "body_rotation"])
    assert len(rollout.run().events) == 2
    ends = [rollout.run({name: value * (1 + sign * 1e-5)}).outputs for sign in (1, -1)]
    for output, slope in slopes.outputs.items():
        difference = (ends[0][output] - ends[1][output]) / (2e-5 * value)
        np.testing.assert_allclose(slope[..., 0], difference, atol=1e-5 * np.abs(difference).max())


def test_derivatives_by_the_torque_limit_do_not_depend_on_the_step(folder):
    """Steps end where torques are clipped and where they are no more, so that coarse ones are as good."""
    wheels = ONE | {"torque_limit": 0.5}
    loop = build_closed_loop(scene_of(folder, wheels, control=TURNED, duration=3.0))
    name, found = "robots.bus.actuators.wheels.torque_limit", []
    for step in (0.2, 0.05, 0.0125):
        rollout = build_rollout(loop, duration_s=3.0, step_s=step, output_step_s=1.0, backend="interpreted")
        slopes = rollout.jacobian(wrt=[name], outputs=["body_rotation"], accuracy=False)
        found.append(slopes.outputs["body_rotation"][-1, 2, 0])
    kinds = {loop.events[fired.event].kind for fired in slopes.trajectory.events}
    assert kinds == {"clipped", "unclipped"}
    assert abs(found[-1]) > 0.1
    np.testing.assert_allclose(found, found[-1], rtol=1e-5)
    result = simulate(scene_of(folder, wheels, control=TURNED, duration=3.0), backend="interpreted")
    assert not result.summary.get("events")


def test_joints_as_wheels_do_what_wheels_of_a_section_do(folder):
    """The same body, its rotors as links and about its axes as numbers: the same motion in space."""
    base = {"joint": "free_flyer", "spin_deg": [6, -9, 12]}
    control = {"kp": 2.0, "kd": 1.5}
    limits = {"torque_limit": 0.5, "speed_limit": 6.5, "coulomb": 1e-3}
    axes = {"axes": [[2, 0, 0], [0, 1, 0], [0, 0, 1]], "inertia": WHEEL, "viscous": 1e-4}
    plain = scene_of(folder, limits | axes, base, control)
    joints = {"kind": "wheel_joints", "joints": "*"} | limits
    jointed = scene_of(folder, joints, base, control, urdf="rotors")
    one, other = (simulate(scene, backend="interpreted") for scene in (plain, jointed))
    assert [e["name"] for e in one.summary["events"]] == [e["name"] for e in other.summary["events"]]
    assert one.summary["events"]
    for name in ("body_rotation", "wheel_speed", "wheel_torque", "wheel_momentum", "wheel_margin"):
        np.testing.assert_allclose(one.data[name], other.data[name], atol=1e-8, err_msg=name)
    for result in (one, other):
        conserved(result)
    assert other.data.sizes["joint"] == 0


def test_a_wheel_that_seizes_strikes_its_body(folder):
    """What is left is one body: I w + J (w + s) = (I + J) w+, and I J s^2 / (I + J) / 2 is lost."""
    speed, spin = 40.0, np.radians(8)
    wheels = ONE | {"speeds": [speed], "failures": [{"wheel": 0, "at": 1.0037}]}
    result = simulate(scene_of(folder, wheels, {"spin_deg": [0, 0, 8]}), backend="interpreted")
    after = result.data.sel(time=slice(1.02, None))
    np.testing.assert_allclose(
        after.v.sel(velocity="v.bus/root[2]"), spin + WHEEL * speed / (TURN + WHEEL), atol=1e-12
    )
    np.testing.assert_allclose(after.wheel_speed, 0, atol=1e-12)
    lost = TURN * WHEEL / (TURN + WHEEL) * speed**2 / 2
    assert float(result.data.work_event[-1]) == pytest.approx(lost, rel=1e-12)
    assert [event["name"] for event in result.summary["events"]] == ["bus/wheels.0.failed"]
    conserved(result)


FAILING = [
    {"wheel": 2, "at": 0.4},
    {"wheel": 0, "at": 0.7, "mode": "off"},
    {"wheel": 1, "at": 0.9, "mode": "off"},
    {"wheel": 0, "at": 1.3},
]
IN_SPACE = {"joint": "free_flyer", "spin_deg": [6, -9, 12]}
THREE = {"axes": [[2, 0, 0], [0, 1, 0], [0, 0, 1]], "inertia": WHEEL, "viscous": 1e-4}


def test_wheels_that_fail_are_joints_that_are_held(folder):
    """A seized wheel, a number, is the locked joint of a rotor, a link; both set in a body in space."""
    control = {"kp": 2.0, "kd": 1.5}
    more = {"torque_limit": 0.5, "speed_limit": 6.5, "coulomb": 1e-3, "failures": FAILING}
    joints = {"kind": "wheel_joints", "joints": "*"} | more
    plain = scene_of(folder, more | THREE, IN_SPACE, control, duration=2.0)
    jointed = scene_of(folder, joints, IN_SPACE, control, urdf="rotors", duration=2.0)
    one, other = (simulate(scene, backend="interpreted") for scene in (plain, jointed))
    assert [e["name"] for e in one.summary["events"]] == [e["name"] for e in other.summary["events"]]
    assert [e["kind"] for e in one.summary["events"]].count("failed") == 4
    for name in ("body_rotation", "wheel_speed", "wheel_torque", "wheel_momentum", "work_event"):
        np.testing.assert_allclose(one.data[name], other.data[name], atol=1e-8, err_msg=name)
    for result in (one, other):
        conserved(result, 1e-9)
    np.testing.assert_allclose(one.data.wheel_speed.values[-1, [0, 2]], 0, atol=1e-12)
    assert abs(one.data.wheel_speed.values[-1, 1]) > 0.1
    engine = pinocchio(plain, duration_s=2.0, output_step_s=0.5)
    rotation = one.data.body_rotation.sel(body="bus").sel(time=engine.time, method="nearest")
    np.testing.assert_allclose(engine.outputs["body_rotation"], rotation, atol=1e-7)


@pytest.mark.parametrize("mode", ["seized", "off"])
def test_gradients_by_the_time_at_which_a_wheel_fails_are_exact(folder, mode):
    failures = [{"wheel": 2, "at": 0.4, "mode": mode}]
    wheels, name = THREE | {"failures": failures}, "robots.bus.actuators.wheels.failures.0.at"
    control = {"kp": 2.0, "kd": 1.5, "attitude_deg": [20, 0, 30]}
    loop = build_closed_loop(scene_of(folder, wheels, IN_SPACE, control, duration=1.5))
    rollout = build_rollout(loop, duration_s=1.5, step_s=0.01, output_step_s=0.5, backend="interpreted")
    slopes = rollout.jacobian(wrt=[name], outputs=["body_rotation"]).outputs["body_rotation"][-1, :, 0]
    ends = [rollout.run({name: 0.4 + h}).outputs["body_rotation"][-1] for h in (2e-3, -2e-3, 1e-3, -1e-3)]
    coarse, fine = (ends[0] - ends[1]) / 4e-3, (ends[2] - ends[3]) / 2e-3
    assert np.abs(slopes).max() > 1e-3
    np.testing.assert_allclose(slopes, fine + (fine - coarse) / 3, atol=1e-5 * np.abs(slopes).max())


def pyramid_axes(tilt_deg):
    around, tilt = np.radians([0, 90, 180, 270]), np.radians(tilt_deg)
    return np.array([np.cos(tilt) * np.cos(around), np.cos(tilt) * np.sin(around), np.full(4, np.sin(tilt))])


@pytest.mark.parametrize(
    "axes", [None, [[1, 0, 0.5], [0, 1, 0], [0.2, 0.3, 2], [1, 1, 1]], [[1, 0, 1], [0, 2, 0]]]
)
def test_wheels_share_torque_by_the_pseudo_inverse_of_their_axes(folder, axes):
    wheels = {"pyramid": {"tilt_deg": 25}} if axes is None else {"axes": axes}
    control = {"kp": 1.0, "attitude_deg": [10, -20, 30]}
    scene = scene_of(folder, wheels | {"inertia": WHEEL}, {"joint": "free_flyer"}, control)
    loop = build_closed_loop(scene)
    x, c = loop.setup(loop.parameter_values)
    named = dict(zip(loop.outputs.name_out(), loop.outputs(0, x, c), strict=True))
    torque = named["wheel_torque"].full().ravel()
    lines = pyramid_axes(25) if axes is None else np.transpose([a / np.linalg.norm(a) for a in axes])
    asked = named["base_attitude_error"].full().ravel()[:3]
    np.testing.assert_allclose(torque, -np.linalg.pinv(lines) @ asked, atol=1e-14)


@pytest.mark.parametrize(
    ("wheels", "told"),
    [
        ({"axes": []}, "give either `axes` or `pyramid`"),
        ({"pyramid": {}}, "not both"),
        ({"axes": [[0, 0, 0]]}, "axes.0: found the zero vector"),
        ({"axes": [[0, 0, 1], [0, 0, 2], [1, 0, 1]]}, "axes.2: a planar base turns about z alone"),
        ({"axes": [[1, 0, 1], [2, 0, 2]]}, "depend on each other"),
        ({"axes": [[0, 1, 0]]}, "axes.0: a planar base turns about z alone"),
        ({"axes": [], "pyramid": {}}, "pyramid: a planar base turns about z alone"),
        ({"axes": [], "pyramid": {"tilt_deg": 90}}, "tilt_deg: found 90, allowed: "),
        ({"speeds": [1, 2]}, "speeds: found 2, allowed: 1"),
        ({"failures": [{"wheel": 1, "at": 1}]}, "failures.0.wheel: found 1, allowed: 0 to 0"),
        ({"failures": [{"wheel": 0, "at": 1}, {"wheel": 0, "at": 2}]}, "failures.0.wheel: found 0, which"),
        ({"speeds": [5], "speed_limit": 4}, "speeds: found 5, allowed: up to speed_limit, 4"),
        ({"kind": "wheel_joints", "joints": "x"}, "unknown key 'axes'"),
    ],
)
def test_what_wheels_cannot_be_is_told_in_one_line(folder, wheels, told):
    with pytest.raises(ScenarioError) as fault:
        scene_of(folder, ONE | wheels)
    assert told in str(fault.value)
    assert "robots.bus.actuators.wheels" in str(fault.value)
    assert "\n" not in fault.value.message


@pytest.mark.parametrize(
    ("joints", "told"),
    [
        ("wheel*", "no joint 'wheel*'"),
        ("joint_1", "found joint_1, allowed: continuous joints on the root link"),
    ],
)
def test_joints_that_are_no_wheels_are_refused(joints, told):
    motors = {"robots.one.actuators": {"w": {"kind": "wheel_joints", "joints": joints}}}
    with pytest.raises(ScenarioError) as fault:
        small_scene(PLANAR, motors)
    assert f"robots.one.actuators.w.joints: {told}" in str(fault.value)


def test_headline_and_words_name_the_wheels(folder):
    scene = scene_of(folder, LIMITED, control=TURNED, duration=1.0)
    result = simulate(scene, backend="interpreted")
    fastest = result.summary["fastest_wheel"]
    assert fastest["wheel"] == "bus/wheels.0"
    assert fastest["least_margin"] == pytest.approx(1 - fastest["speed_rad_s"] / 8)
    (words,) = (actuator.words() for _, actuator in scene.robots[0].config.driven_by())
    assert words == "1 reaction wheel, 0.05 kg m^2, each up to 8 rad/s (76 rpm)"


def test_the_servicer_holds_its_attitude_to_a_tenth_of_a_degree():
    """Its greatest error is that of the first seconds; docs/validation/planning.md states 0.035 deg."""
    scene = load_scene("servicer-wheels", {"simulation.duration": 6, "simulation.step": 0.04})
    result = simulate(scene, backend="interpreted")
    assert 0.03 < result.summary["attitude_error"]["servicer"]["max_deg"] < 0.035
    assert float(np.abs(result.data.wheel_torque).max()) < 0.4
    conserved(result)


PYRAMID = {"pyramid": {"tilt_deg": 35}, "inertia": WHEEL, "speeds": [20, -20, 15, -15]}
HELD = {"kp": 2.0, "kd": 2.5, "attitude_deg": [40, -20, 30]}


@pytest.mark.parametrize("mode", ["seized", "off"])
def test_wheels_that_are_left_share_the_torque_by_the_pseudo_inverse_of_their_axes(folder, mode):
    """After the failure torques are ``-A'^+ T`` of the other three, in both engines."""
    failing = {"failures": [{"wheel": 1, "at": 0.5, "mode": mode, "known": True}]}
    scene = scene_of(folder, PYRAMID | failing, IN_SPACE, HELD, duration=1.5)
    data = simulate(scene, backend="interpreted").data
    asked = HELD["kp"] * data.base_attitude_error.values[:, 0]
    spin = np.array([data.v.sel(velocity=f"v.bus/root[{i}]") for i in (3, 4, 5)]).T
    rotations = [quaternion_matrix(row[3:7]) for row in data.q.values]
    asked = np.array([r.T @ e for r, e in zip(rotations, asked, strict=True)]) - HELD["kd"] * spin
    axes, after = pyramid_axes(35), data.time.values > 0.51
    left = [0, 2, 3]
    torque = data.wheel_torque.values
    np.testing.assert_allclose(
        torque[~after][:-2], -(np.linalg.pinv(axes) @ asked.T).T[~after][:-2], atol=1e-9
    )
    expected = -(np.linalg.pinv(axes[:, left]) @ asked.T).T
    np.testing.assert_allclose(torque[after][:, left], expected[after], atol=1e-6 * np.abs(expected).max())
    np.testing.assert_array_equal(torque[after][:, 1], 0)
    assert np.abs(expected[after]).max() > 0.05
    limited = scene_of(folder, PYRAMID | failing | {"speed_limit": 21}, IN_SPACE, HELD, duration=1.0)
    result = simulate(limited, backend="interpreted")
    assert "saturated" in {event["kind"] for event in result.summary["events"]}
    conserved(result, 1e-9)
    engine = pinocchio(limited, duration_s=1.0, output_step_s=0.5)
    seen = result.data.body_rotation.sel(body="bus").sel(time=engine.time, method="nearest")
    np.testing.assert_allclose(engine.outputs["body_rotation"], seen, atol=1e-7)


def quaternion_matrix(q):
    """Rotation matrix of a quaternion (x, y, z, w)."""
    (x, y, z), w = q[:3], q[3]
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


DETECTION = {"period": 0.02, "speed_noise": 1e-3, "spin_noise": 1e-6, "allowance": 5e-3}


@pytest.mark.parametrize("urdf", ["bus", "rotors"])
@pytest.mark.parametrize("mode", ["seized", "off"])
def test_a_failed_wheel_is_detected_by_name_and_left_out(folder, mode, urdf):
    wheels = THREE | {"speeds": [3, 4, 5]} if urdf == "bus" else {"kind": "wheel_joints", "joints": "*"}
    wheels = wheels | {"failures": [{"wheel": 2, "at": 0.51, "mode": mode}], "detection": DETECTION}
    result = simulate(scene_of(folder, wheels, IN_SPACE, HELD, urdf=urdf), backend="interpreted")
    events = [e for e in result.summary["events"] if e["kind"] in ("failed", "detected")]
    assert [(e["kind"], e["who"]) for e in events] == [
        ("failed", "bus/wheels.2"),
        ("detected", "bus/wheels.2"),
    ]
    assert 0 < events[1]["delay_s"] < 0.5
    assert result.data.failures_detected.values[-1, 0] == 1
    after = result.data.time.values > events[1]["time_s"] + 0.01
    np.testing.assert_array_equal(result.data.wheel_torque.values[after, 2], 0)
    conserved(result, 1e-8)


def test_no_wheel_is_suspected_where_none_fails_and_residuals_are_the_missing_torque(folder):
    quiet = {"period": 0.002, "bandwidth": 20, "allowance": 100.0}
    wheels = THREE | {"coulomb": 1e-2, "viscous": 1e-3, "speeds": [3, 4, 5], "detection": quiet}
    free = scene_of(folder, wheels, IN_SPACE, HELD, duration=0.6)
    found = simulate(free, backend="interpreted").data
    assert np.abs(found.wheel_residual.values).max() < 1e-4 * np.abs(found.wheel_torque.values).max()
    assert not found.failures_detected.values.any()
    failing = wheels | {"failures": [{"wheel": 1, "at": 0.0, "mode": "off"}]}
    found = simulate(scene_of(folder, failing, IN_SPACE, HELD, duration=0.6), backend="interpreted").data
    torque = found.wheel_torque.values
    # behind the lag, the torque commanded of the wheel that gives none
    spin = np.array([found.v.sel(velocity=f"v.bus/root[{i}]") for i in (3, 4, 5)]).T
    rotations = [quaternion_matrix(row[3:7]) for row in found.q.values]
    turned = np.array(
        [r.T @ e for r, e in zip(rotations, found.base_attitude_error.values[:, 0], strict=True)]
    )
    asked = -(HELD["kp"] * turned - HELD["kd"] * spin)
    lag, expected, decay = 0.0, [0.0], np.exp(-20 * 0.02)
    for mean in (asked[1:, 1] + asked[:-1, 1]) / 2:
        lag = decay * lag - (1 - decay) * mean
        expected.append(lag)
    assert np.abs(torque[1:, 1]).max() < 1e-9
    residual = found.wheel_residual.values[:, 1]
    np.testing.assert_allclose(residual, expected, atol=0.06 * np.abs(expected).max())
    assert np.abs(found.wheel_residual.values[:, [0, 2]]).max() < 1e-3 * np.abs(residual).max()
