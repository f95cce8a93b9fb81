"""Phases of a closed loop: how they end, what follows, and what begins with them."""

import numpy as np
import pytest

from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.pinocchio_engine.mechanical_state import MechanicalState
from tests.oracles.free_bodies import DEEP, FLAT, free_bodies
from tests.oracles.hybrid import roll
from tests.oracles.small_scenes import PLANAR, SPATIAL, random_x, small_scene

LINE = {"kind": "line", "displacement": [0.06, 0.02, 0], "duration": 0.4}
BACK = {"kind": "line", "displacement": [-0.03, 0.01, 0], "rotation_deg": [0, 0, 10], "duration": 0.5}


def with_phases(text, phases, changes=None):
    """A small scene with phases."""
    return small_scene(text, {"phases": phases} | (changes or {}))


def tips(reference):
    return {"robots": {"*": {"tips": {"*": {"reference": reference}}}}}


@pytest.mark.parametrize("text", [PLANAR, SPATIAL], ids=["planar", "spatial"])
def test_a_scenario_of_one_phase_moves_as_one_without(text):
    plain = build_closed_loop(small_scene(text))
    phased = build_closed_loop(with_phases(text, {"all": {}}))
    one, other = roll(plain, 0.3), roll(phased, 0.3)
    np.testing.assert_allclose(other.x[: plain.nq + plain.nv], one.x[: plain.nq + plain.nv], atol=1e-9)
    assert other.outputs()["phase"] == 0


@pytest.mark.parametrize("text", [PLANAR, SPATIAL], ids=["planar", "spatial"])
def test_references_begin_where_the_tips_are_when_their_phase_begins(text):
    phases = {"out": {"until": {"time": 0.3}, **tips(LINE)}, "back": tips(BACK)}
    loop = build_closed_loop(with_phases(text, phases))
    run = roll(loop, 0.9)
    assert run.names[0] == "out.time"
    assert run.names[1:] == [
        f"{tip}/tip:phases.back.robots.{tip}.tips.tip.reference.duration.passed" for tip in ("one", "two")
    ]
    event = run.events[0]
    assert event.time == pytest.approx(0.3, abs=1e-9)
    before = run.outputs(event.time, event.before, event.c_before)
    after = run.outputs(event.time, event.after, event.c_after)
    assert np.abs(before["tip_error"]).max() > 1e-4
    np.testing.assert_allclose(after["tip_error"], 0, atol=1e-12)
    np.testing.assert_allclose(after["tip_orientation_error"], 0, atol=1e-9)
    np.testing.assert_array_equal(event.after[: loop.nq + loop.nv], event.before[: loop.nq + loop.nv])
    ended = run.outputs()
    moved = (ended["tip_reference"] - after["tip_position"]).reshape(2, 3)
    np.testing.assert_allclose(moved, [[-0.03, 0.01, 0]] * 2, atol=1e-12)
    assert ended["phase"] == 1


def test_references_begin_where_the_reference_before_led_on_request():
    phases = {"out": {"until": {"time": 0.3}, **tips(LINE)}, "back": {"begins_at": "reference", **tips(BACK)}}
    run = roll(build_closed_loop(with_phases(PLANAR, phases)), 0.31)
    event = run.events[0]
    before = run.outputs(event.time, event.before, event.c_before)
    after = run.outputs(event.time, event.after, event.c_after)
    np.testing.assert_allclose(after["tip_reference"], before["tip_reference"], atol=1e-12)


def test_a_reference_goes_on_where_the_next_phase_has_the_same():
    phases = {
        "first": {"until": {"time": 0.3}},
        "second": {"robots": {"one": {"tips": {"tip": {"pid": {"kp": 60}}}}}},
    }
    loop = build_closed_loop(with_phases(PLANAR, phases))
    run = roll(loop, 0.31)
    event = run.events[0]
    before = run.outputs(event.time, event.before, event.c_before)
    after = run.outputs(event.time, event.after, event.c_after)
    np.testing.assert_array_equal(after["tip_reference"], before["tip_reference"])
    assert "phases.second.robots.one.tips.tip.pid.kp" in loop.parameter_paths


def test_numbers_differ_by_phase_and_controllers_rest():
    """The law of each phase is that of the scenario with the phase's changes."""
    changes = {"robots": {"one": {"tips": {"tip": {"pid": {"kp": 60, "kd": 2}}}, "joint_pd": None}}}
    base = {"robots.*.joint_pd": {"kp": 5, "kd": 1}}
    loop = build_closed_loop(
        with_phases(PLANAR, {"first": {"until": {"time": 1.0}}, "second": changes}, base)
    )
    same = build_closed_loop(
        small_scene(
            PLANAR,
            base
            | {
                "robots.one.tips.tip.pid.kp": 60,
                "robots.one.tips.tip.pid.kd": 2,
                "robots.one.joint_pd": None,
            },
        )
    )
    x, c = (value.full().ravel() for value in loop.setup(loop.parameter_values))
    rng = np.random.default_rng(3)
    v = slice(loop.nq, loop.nq + loop.nv)
    x[v] += 0.1 * rng.normal(size=loop.nv)
    first = loop.dynamics(0.2, x, c).full().ravel()
    c[list(loop.switches)[:2]] = [0.0, 1.0]
    second = loop.dynamics(0.2, x, c).full().ravel()
    xs, cs = (value.full().ravel() for value in same.setup(same.parameter_values))
    names = {name: i for i, name in enumerate(loop.state_names)}
    for i, name in enumerate(same.state_names):
        xs[i] = x[names[name]]
    expected = same.dynamics(0.2, xs, cs).full().ravel()[v]
    np.testing.assert_allclose(second[v], expected, atol=1e-12)
    assert np.abs(first[v] - expected).max() > 1e-3
    rests = [i for i, name in enumerate(loop.state_names) if name.startswith("one/joint_pd")]
    assert rests
    assert not second[rests].any()


def test_controllers_with_names_rest_and_an_amnesia_controller_with_its_pid():
    tip = {"pid": None, "amnesia": None}
    rest = {"robots": {"one": {"tips": {"tip": tip}, "controllers": {"still": None}}}}
    base = {"robots.one.controllers.still": {"kind": "joint_pd", "kp": 5, "kd": 1}}
    scene = with_phases(PLANAR, {"first": {"until": {"time": 1.0}}, "second": rest}, base)
    assert not scene.scenario.during("second").robots["one"].controllers
    loop = build_closed_loop(scene)
    x, c = (value.full().ravel() for value in loop.setup(loop.parameter_values))
    c[list(loop.switches)[:2]] = [0.0, 1.0]
    torque = loop.outputs.call({"t": 0.2, "x": x, "c": c})["joint_torque"].full().reshape(2, 3)
    assert not torque[0].any()
    assert torque[1].all()


def test_an_amnesia_controller_does_not_rest_alone():
    alone = {"robots": {"one": {"tips": {"tip": {"amnesia": None}}}}}
    with pytest.raises(ScenarioError, match="write `ge: 0`"):
        with_phases(PLANAR, {"first": {"until": {"time": 1.0}}, "second": alone})


def test_controllers_keep_their_states_unless_they_begin_anew():
    for reset in (False, True):
        phases = {"out": {"until": {"time": 0.3}, **tips(LINE)}, "back": {"reset": reset, **tips(BACK)}}
        filtered = {"robots.one.tips.tip.pid.derivative": "filtered"}
        loop = build_closed_loop(with_phases(PLANAR, phases, filtered))
        event = roll(loop, 0.31).events[0]
        own = [i for i, name in enumerate(loop.state_names) if "pid.integral" in name or "amnesia" in name]
        assert np.abs(event.before[own]).max() > 1e-5
        np.testing.assert_array_equal(event.after[own], 0 if reset else event.before[own])
        lag = [i for i, name in enumerate(loop.state_names) if "pid.filter" in name]
        rate = loop.dynamics(event.time, event.after, event.c_after).full().ravel()[lag]
        assert (np.abs(rate).max() < 1e-9) == reset  # the filter begins at the error itself


def test_a_docking_in_phases(tmp_path):
    phases = {
        "approach": {"until": {"captured": ["left"]}, "timeout": 2.5, "on_timeout": "lost"},
        "carry": {
            "until": {"limit": {"output": "momentum_linear", "above": 1e3}},
            "timeout": 0.3,
            "next": "part",
        },
        "part": {"releases": ["left"], "until": {"released": ["left"]}, "next": "end"},
        "lost": {"until": {"time": 1.0}, "next": "end"},
    }
    grasp = {"kind": "weld", "capture": {"distance": 0.05}}
    loop = build_closed_loop(free_bodies(tmp_path, FLAT, grasp, phases=phases))
    run = roll(loop, 5.0)
    assert run.names == [
        "left.captured",
        "approach.captured",
        "carry.timeout",
        "left.release_commanded",
        "part.released",
    ]
    assert run.events[1].time == run.events[0].time
    assert run.events[2].time == pytest.approx(run.events[0].time + 0.3, abs=1e-9)
    assert run.events[-1].time == run.t
    run = roll(loop, 5.0, {"grasps.left.capture.distance": 1e-3})
    assert run.names == ["approach.timeout", "lost.time"]
    assert run.t == pytest.approx(3.5, abs=1e-9)


def test_grasps_close_only_in_phases_that_let_them(tmp_path):
    grasp = {"kind": "compliant", "capture": {"distance": 0.06}, "release": {"force": 0.2}}
    phases = {
        "wait": {"captures": [], "until": {"time": 1.2}},
        "catch": {"until": {"released": ["left"]}},
        "again": {"captures": ["left"], "until": {"captured": ["left"]}, "timeout": 0.5, "next": "end"},
    }
    run = roll(build_closed_loop(free_bodies(tmp_path, FLAT, grasp, phases=phases)), 6.0)
    assert run.names[:4] == ["wait.time", "left.captured", "left.slipped_by_force", "catch.released"]
    assert run.events[1].time == pytest.approx(1.2, abs=1e-9)


def test_a_phase_ends_when_a_body_has_settled(tmp_path):
    settled = {"of": "target", "speed": 0.05, "spin_deg": 10, "dwell": 0.5}
    phases = {"calm": {"until": {"settled": settled}, "next": "end"}}
    run = roll(
        build_closed_loop(free_bodies(tmp_path, FLAT, {"capture": {"at": 9}, "kind": "weld"}, phases=phases)),
        2.0,
    )
    assert run.names == ["calm.settling", "calm.settled"]
    assert run.t == pytest.approx(0.5, abs=1e-9)


SETTLED = {"of": "target", "speed": 0.05, "spin_deg": 10}
WAYS = {
    "settled": {"settled": SETTLED},
    "settling": {"settled": SETTLED | {"speed": 50, "dwell": 0.5}},
    "dwell": {"settled": SETTLED | {"dwell": 0.5}},
    "above": {"limit": {"output": "grasp_gap", "of": "left", "above": 0.06}},
    "below": {"limit": {"output": "grasp_gap", "of": "left", "below": 0.3}},
    "number above": {"limit": {"output": "energy_kinetic", "above": 0.02}},
    "number below": {"limit": {"output": "energy_kinetic", "below": 0.02}},
}


@pytest.mark.parametrize("way", WAYS)
def test_guards_of_phases_are_margins_to_their_limits(tmp_path, way):
    """Speed and spin by the square of their parts of the limits, vectors by the square of their size."""
    grasp = {"kind": "weld", "capture": {"at": 9}}
    scene = free_bodies(tmp_path, DEEP, grasp, phases={"calm": {"until": WAYS[way], "next": "end"}})
    loop = build_closed_loop(scene)
    c = loop.setup(loop.parameter_values)[1].full().ravel()
    if way == "dwell":
        c[loop.switches[loop.switch_names.index("phases.calm.settling")]] = 1
    x = random_x(scene, np.random.default_rng(2), loop.nx)
    target = MechanicalState(scene.model, x[: loop.nq], x[loop.nq : loop.nq + loop.nv])
    speed, spin = np.split(target.frame(scene.bodies[1].root_frame).velocity, 2)
    outputs = dict(zip(loop.outputs.name_out(), loop.outputs(0.3, x, c), strict=True))
    gap, energy = float(np.sum(outputs["grasp_gap"].full() ** 2)), float(outputs["energy_kinetic"])
    settled_at = sum(x[i] for i, name in enumerate(loop.state_names) if name == "phase.settled_at[0]")
    expected = {
        "settled": 1 - (np.linalg.norm(speed) / 0.05) ** 2,
        "settling": 1 - (np.degrees(np.linalg.norm(spin)) / 10) ** 2,
        "dwell": 0.3 - settled_at - 0.5,
        "above": gap - 0.06**2,
        "below": 0.3**2 - gap,
        "number above": energy - 0.02,
        "number below": 0.02 - energy,
    }[way]
    how = {"dwell": "settled", "settled": "settled", "settling": "settling"}.get(way, "limit")
    names = [event.name for event in loop.events]
    found = loop.guards(0.3, x, c, np.zeros(loop.nx))[0].full()[names.index(f"calm.{how}"), 0]
    assert found == pytest.approx(expected, rel=1e-9)


BAD = {
    "a name": ({"one": {"next": "two", "timeout": 1.0}}, "phases.one.next", "no phase 'two'"),
    "unreached": ({"one": {}, "two": {}}, "phases.two", "never reached; 'one' never ends"),
    "skipped": ({"one": {"timeout": 1.0, "next": "end"}, "two": {}}, "phases.two", "never reached"),
    "a grasp": ({"one": {"until": {"captured": ["lef"]}}}, "phases.one.until.captured", "'lef'"),
    "no release": ({"one": {"until": {"released": ["left"]}}}, "phases.one.until.released", "never released"),
    "two ways": ({"one": {"until": {"time": 1, "captured": ["left"]}}}, "phases.one.until", "time, captured"),
    "a body": (
        {"one": {"until": {"settled": {"of": "x", "speed": 1}}}},
        "phases.one.until.settled.of",
        "no body",
    ),
    "an output": (
        {"one": {"until": {"limit": {"output": "grasp_forc", "above": 1}}}},
        "phases.one.until.limit.output",
        "grasp_force",
    ),
    "of which": (
        {"one": {"until": {"limit": {"output": "grasp_force", "of": "lef", "above": 1}}}},
        "phases.one.until.limit.of",
        "left",
    ),
    "a key": (
        {"one": {"robots": {"one": {"tips": {"tip": {"pid": {"kpp": 1}}}}}}},
        "phases.one.robots.one.tips.tip.pid",
        "unknown key 'kpp'",
    ),
    "a value": (
        {"one": {"robots": {"one": {"tips": {"tip": {"pid": {"kp": -1}}}}}}},
        "phases.one.robots.one.tips.tip.pid.kp",
        "found -1, allowed: at least 0",
    ),
    "a robot": ({"one": {"robots": {"three": {"tips": {}}}}}, "phases.one.robots.three", "allowed: one, two"),
    "a pattern": ({"one": {"robots": {"t*e": {"tips": {}}}}}, "phases.one.robots.t*e", "finds nothing"),
    "a mass": (
        {"one": {"robots": {"one": {"base": {"position": [1, 0, 0]}}}}},
        "phases.one.robots.one.base",
        "same in every",
    ),
    "a new controller": (
        {"one": {"robots": {"one": {"joint_pd": {"kp": 1}}}}},
        "phases.one.robots.one.joint_pd",
        "give it there",
    ),
    "a word": (
        {"one": {"robots": {"one": {"tips": {"tip": {"pid": {"derivative": "filtered"}}}}}}},
        "phases.one.robots.one.tips.tip.pid.derivative",
        "only a number",
    ),
    "no time passes": (
        {"one": {"until": {"captured": ["left"]}}, "two": {"until": {"captured": ["right"]}, "next": "one"}},
        "phases.one",
        "no time passes in one -> two -> one",
    ),
    "end": ({"end": {}}, "phases.end", "rename"),
    "on_timeout": ({"one": {"on_timeout": "end"}}, "phases.one.on_timeout", "never followed"),
    "abort": ({"one": {"on_abort": "end"}}, "phases.one.abort", "give it with `on_abort`"),
    "abort to": (
        {"one": {"abort": {"output": "momentum_linear", "above": 1}, "on_abort": "two"}},
        "phases.one.on_abort",
        "no phase 'two'",
    ),
}


@pytest.mark.parametrize(("phases", "where", "told"), BAD.values(), ids=BAD)
def test_what_cannot_be_is_refused_by_its_path(phases, where, told):
    with pytest.raises(ScenarioError) as fault:
        build_closed_loop(with_phases(PLANAR, phases))
    assert str(fault.value.where).startswith(where), fault.value
    assert told in fault.value.message
    assert "\n" not in str(fault.value)


def test_numbers_of_a_phase_are_set_and_read_by_their_paths():
    from spacerobot.scenario.units import unit_at

    changes = {"robots": {"*": {"tips": {"*": {"pid": {"kp": 60}, "reference": BACK}}}}}
    scene = with_phases(PLANAR, {"one": changes}, {"phases.one.robots.two.tips.tip.pid.kp": 70})
    loop = build_closed_loop(scene)
    path = "phases.one.robots.two.tips.tip.pid.kp"
    assert loop.parameter_values[loop.index(path)] == 70
    assert unit_at(scene.scenario, path) == "N s/m"
    assert unit_at(scene.scenario, "phases.one.robots.two.tips.tip.reference.duration") == "s"


def test_a_grasp_that_no_phase_lets_close_is_refused(tmp_path):
    with pytest.raises(ScenarioError, match=r"grasps\.left\.capture: never holds, for no phase names 'left'"):
        free_bodies(
            tmp_path, FLAT, {"capture": {"distance": 0.1}, "kind": "weld"}, phases={"one": {"captures": []}}
        )


def test_a_phase_that_waits_for_a_grasp_that_cannot_close_in_it_is_refused(tmp_path):
    phases = {
        "one": {"until": {"captured": ["left"]}, "captures": [], "timeout": 1.0},
        "two": {"until": {"captured": ["left"]}, "captures": ["left"]},
    }
    grasp = {"capture": {"distance": 0.1}, "kind": "weld"}
    told = r"phases\.one\.until\.captured: never holds, for 'left' is open when the phase begins"
    with pytest.raises(ScenarioError, match=told):
        free_bodies(tmp_path, FLAT, grasp, phases=phases)
    again = {"one": {"captures": ["left"], "timeout": 1.0}, "two": phases["one"], "three": {}}
    free_bodies(tmp_path, FLAT, grasp, phases=again)  # it may have closed before


def test_the_velocity_that_is_fed_back_may_differ_by_phase():
    def phased(**pid):
        robots = {"one": {"tips": {"tip": {"pid": pid}}}}
        phases = {"first": {"until": {"time": 1}}, "second": {"robots": robots}}
        return small_scene(PLANAR, {"phases": phases})

    scene = phased(feedback="inertial", kp=3)
    loop = build_closed_loop(scene)
    x, c = random_x(scene, np.random.default_rng(1), loop.nx), loop.setup(loop.parameter_values)[1]
    second = c.full().ravel()
    second[list(loop.switches[:2])] = 0, 1
    plain = build_closed_loop(phased(kp=3))
    told = [one.dynamics(0.3, x, second).full() for one in (loop, plain)]
    assert np.abs(told[0] - told[1]).max() > 1e-3
    np.testing.assert_array_equal(loop.dynamics(0.3, x, c), plain.dynamics(0.3, x, c))
