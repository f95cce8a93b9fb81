"""Plans that are made anew in flight, from what sensors show; rollouts that go on from where they were."""

import gc

import numpy as np
import pinocchio as pin
import pytest

from optim.planning.formulation.formulate import formulate
from optim.planning.mpc.flown_scene import FlownScene, mpc_settings
from optim.planning.mpc.horizon import Horizon, without_garbage_collection
from optim.planning.mpc.measured_state import measured_state, readings_of
from optim.planning.search.plan_solver import PlanSolver
from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.rollout import build_rollout
from spacerobot.rollout.resumable_loop import end_of, joined, resumed, start_of
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from tests.oracles.small_scenes import PLANAR, small_scene

LEAD = {"kind": "mpc", "period": 0.5, "min_horizon": 1.0, "kp": 2, "kd": 1}
FLIGHT = [
    ("robots.one.controllers", {"lead": LEAD}),
    ("robots.one.sensors.target_velocity", {"scale": 0.5, "offset": 0.01}),
    ("plan.intervals", 4),
    ("plan.duration", 3),
]

TWO_PHASES = [
    ("plan.duration", None),
    ("plan.goals", {}),
    ("robots.one.tips.tip.pid", {"kp": 20, "kd": 10}),
    (
        "phases",
        {
            "come": {"robots": {"one": {"tips": {"tip": {"pid": None}}}}, "until": {"time": 2}},
            "wait": {"robots": {"one": {"controllers": {"lead": None}}}, "until": {"time": 0.5}},
        },
    ),
    (
        "plan.phases",
        {
            "come": {"duration": 2, "goals": {"mate": {"tip": "one/tip", "frame": "mate_1"}}},
            "wait": {"duration": 1, "goals": {"end": {"still": "one"}}},
        },
    ),
]
"""Comes to the target by plans that end with the arm at rest a second later."""


FILTERED = [
    ("robots.one.controllers", {"lead": LEAD}),
    (
        "robots.one.sensors",
        {
            name: {"errors": {"period": 0.5, "noise": 1e-3}}
            for name in ("target_position", "target_orientation")
        },
    ),
    ("robots.one.estimators", {"seen": {"kind": "target_filter", "tip": "tip", "frame": "mate_1"}}),
    ("plan.intervals", 4),
    ("plan.duration", 3),
]


def test_plans_begin_with_the_velocity_and_spin_that_a_filter_estimates(reach):
    """Sensors of velocity and spin are ideal, and are not read."""
    loop = build_closed_loop(FlownScene.of(reach(*FILTERED)).scene)
    x0, c = (value.full().ravel() for value in loop.setup(loop.parameters({})))
    place = loop.state_names.index("one/seen.now[2]")  # of x, y, then the velocity
    shifted = x0.copy()
    shifted[place] += 0.02
    shifted[place + 4] += 0.1  # and cosine and sine, then the spin
    found = []
    for x in (x0, shifted):
        values = loop.outputs(0, x, loop.at(0, x, c))
        found.append({n: v.full().ravel() for n, v in zip(loop.outputs.name_out(), values, strict=True)})
    known, moved = found
    velocity, spin = (
        moved[f"mpc_input_target_{key}"] - known[f"mpc_input_target_{key}"] for key in ("velocity", "spin")
    )
    lever = known["mpc_input_target_position"] - known["body_position"][3:6]
    np.testing.assert_allclose(spin, [0, 0, 0.1], atol=1e-12)
    np.testing.assert_allclose(velocity, [0.02 - 0.1 * lever[1], 0.1 * lever[0], 0], atol=1e-12)


@pytest.mark.parametrize("filtered", [False, True])
def test_mpc_inputs_and_measurements_are_separate_outputs(reach, filtered):
    """Each is declared once; with a filter plans begin with the estimate, and the sensor is still shown."""
    changes = FILTERED if filtered else [one for one in FILTERED if not one[0].endswith("estimators")]
    loop = build_closed_loop(FlownScene.of(reach(*changes)).scene)
    x0, c = (value.full().ravel() for value in loop.setup(loop.parameters({})))
    x = x0.copy()
    place = next(
        i for i, name in enumerate(loop.state_names) if ".target_position" in name and "measured" in name
    )
    x[place] += 0.25
    values = loop.outputs(0, x, loop.at(0, x, c))
    seen = {n: v.full().ravel() for n, v in zip(loop.outputs.name_out(), values, strict=True)}
    shown, taken = seen["measured_target_position"], seen["mpc_input_target_position"]
    frame = next(one for one in loop.variables if one.name == "measured_target_position")
    assert frame.labels == ("one/tip",)
    np.testing.assert_allclose(shown[0] - x0[place], 0.25, atol=1e-12)
    assert np.ptp(shown - taken) == pytest.approx(0.25 if filtered else 0)


def test_resolution_and_range_of_mpc_act_on_the_pose_from_the_tip(reach):
    """Errors of the rotation vector from the tip are those of the rotation vector since the start."""
    step, reach_m = 0.04, 0.3
    errors = {"period": 0.1, "noise": 1e-16, "resolution": step, "range": reach_m}
    sensors = {f"target_{name}": {"errors": errors} for name in ("position", "orientation")}
    scene = FlownScene.of(
        reach(
            *[one for one in FILTERED if one[0] == "robots.one.controllers"], ("robots.one.sensors", sensors)
        )
    ).scene
    loop = build_closed_loop(scene)
    run = build_rollout(loop, duration_s=0.15, step_s=0.01, output_step_s=0.05, backend="interpreted").run()
    data = scene.model.createData()
    pin.framesForwardKinematics(scene.model, data, run.state[2, : scene.model.nq])  # at 0.1 s, as they sample
    tip = data.oMf[scene.tips[0].frame]
    mate = data.oMf[scene.model.getFrameId("target/mate_1", pin.FrameType.BODY)]
    turned = run.outputs["body_rotation"][2].reshape(-1, 3)[
        [body.name for body in scene.bodies].index("target")
    ]
    away = mate.translation - tip.translation
    turn = pin.log3(mate.rotation @ tip.rotation.T)

    def coarse(value):
        return np.clip(step * np.round(value / step), -reach_m, reach_m)

    shown = {
        name: run.outputs[f"measured_target_{name}"][3].reshape(-1, 3)[0]
        for name in ("position", "orientation")
    }
    np.testing.assert_allclose(shown["position"][:2], (tip.translation + coarse(away))[:2], atol=1e-9)
    np.testing.assert_allclose(shown["orientation"][2], (turned + coarse(turn) - turn)[2], atol=1e-9)
    assert np.abs(away).max() > reach_m


def seen_state(scene, state):
    """Measured state of a scene, by the outputs of its closed loop."""
    loop = build_closed_loop(FlownScene.of(scene).scene)
    x0, c = loop.setup(loop.parameter_values)
    x = np.concatenate([state, x0.full().ravel()[len(state) :]])
    values = dict(zip(loop.outputs.name_out(), loop.outputs(0, x, c), strict=True))
    read = readings_of(loop.variables, {name: value.full().ravel() for name, value in values.items()})
    return measured_state(scene, scene.scenario.plan, read, state, scene.q)


def miss(result, scene):
    """Distance of the tip from its mating frame at the end [m]."""
    data = scene.model.createData()
    pin.framesForwardKinematics(scene.model, data, result.data.q.values[-1])
    mate = scene.model.getFrameId("target/mate_1", pin.FrameType.BODY)
    return float(np.linalg.norm(data.oMf[scene.tips[0].frame].translation - data.oMf[mate].translation))


def test_plans_made_anew_take_back_what_sensors_misread(reach):
    scene = reach(*FLIGHT)
    flown = simulate(scene, backend="interpreted")
    once = simulate(reach(*FLIGHT, ("robots.one.controllers.lead.min_horizon", 100)), backend="interpreted")
    assert miss(once, scene) > 0.015
    assert miss(flown, scene) < 0.45 * miss(once, scene)  # the last plan is one second old of three
    told = flown.summary["mpc"]
    assert (told["plans"], told["missed"], once.summary["mpc"]["plans"]) == (5, 0, 1)
    assert flown.completed
    np.testing.assert_allclose(flown.data.time.values, np.linspace(0, 3, 31), atol=1e-12)
    assert np.abs(np.diff(flown.data.momentum_linear.values, axis=0)).max() < 1e-12
    again = simulate(scene, backend="interpreted")
    np.testing.assert_array_equal(again.data.q.values, flown.data.q.values)
    assert again.summary["mpc"]["iterations"] == told["iterations"]


def test_where_no_plan_is_found_the_last_one_is_flown_on(reach, monkeypatch):
    from optim.planning.mpc import horizon

    whole = simulate(reach(*FLIGHT, ("robots.one.controllers.lead.min_horizon", 100)), backend="interpreted")
    real = horizon.solve
    monkeypatch.setattr(horizon, "solve", lambda *a, **k: real(*a, **(k | {"iterations": 1})))
    lost = simulate(reach(*FLIGHT), backend="interpreted")
    assert lost.summary["mpc"]["missed"] == 4
    np.testing.assert_allclose(lost.data.q.values, whole.data.q.values, atol=1e-9)


def test_a_rollout_in_pieces_is_the_whole_one():
    changes = {
        "robots.one.sensors.target_position": {"kind": "sampled", "period": 0.13, "offset": 0.02},
        "robots.one.tips.tip.reference": {
            "kind": "rendezvous",
            "frame": "mate_2",
            "standoff": 0.3,
            "approach_time": 0.7,
        },
        "robots.one.tips.tip.pid": {"kp": 20, "ki": 5, "kd": 3},
    }
    loop = build_closed_loop(small_scene(PLANAR, changes))
    assert loop.events
    assert loop.jumps or loop.switches
    options = {"step_s": 0.02, "output_step_s": 0.1, "backend": "interpreted"}
    whole = build_rollout(loop, duration_s=1.2, **options).run()
    half, start, pieces = build_rollout(resumed(loop), duration_s=0.6, **options), start_of(loop), []
    for begin in (0.0, 0.6):
        pieces.append((begin, half.run(np.concatenate([loop.parameter_values, start]))))
        start = end_of(pieces[-1][1], start)
    found = joined(pieces)
    np.testing.assert_allclose(found.time, whole.time, atol=1e-12)
    np.testing.assert_allclose(found.state, whole.state, atol=1e-7)
    assert [e.event for e in found.events] == [e.event for e in whole.events]
    np.testing.assert_allclose([e.time_s for e in found.events], [e.time_s for e in whole.events], atol=1e-9)


def test_the_target_is_where_sensors_show_it(reach):
    scene = reach(
        FLIGHT[0],
        FLIGHT[3],
        ("robots.one.sensors.target_position.offset", 0.1),
        ("robots.one.sensors.target_spin.scale", 2.0),
    )
    state = np.concatenate([scene.q, scene.v])
    seen = seen_state(scene, state)
    joint = scene.model.joints[scene.target.root_joint]
    shift = np.zeros(len(state))
    shift[joint.idx_q : joint.idx_q + 2] = 0.1
    np.testing.assert_allclose((seen - state)[: scene.model.nq], shift[: scene.model.nq], atol=1e-12)
    spin = scene.model.nq + joint.idx_v + 2
    assert seen[spin] == pytest.approx(2 * state[spin])


def test_the_target_is_turned_as_its_sensor_shows_about_the_mating_frame(reach):
    scene = reach(
        FLIGHT[0],
        FLIGHT[3],
        ("robots.one.sensors.target_orientation.offset", 0.1),
        ("robots.one.sensors.joint_position.offset", 0.02),
    )
    model, state = scene.model, np.concatenate([scene.q, scene.v])
    tip, mate = scene.tips[0].frame, model.getFrameId("target/mate_1", pin.FrameType.BODY)
    away, angle, velocity = [], [], []
    for q in (state, seen_state(scene, state)):
        data = model.createData()
        pin.forwardKinematics(model, data, q[: model.nq], q[model.nq :])
        pin.updateFramePlacements(model, data)
        away.append(data.oMf[mate].translation - data.oMf[tip].translation)
        angle.append(pin.log3(data.oMf[mate].rotation @ data.oMf[tip].rotation.T)[2])
        velocity.append(
            pin.getFrameVelocity(model, data, mate, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED).vector
        )
    np.testing.assert_allclose(away[1], away[0], atol=1e-12)  # relative to where the tip seems to be
    assert angle[1] - angle[0] == pytest.approx(0.1)
    np.testing.assert_allclose(velocity[1], velocity[0], atol=1e-12)


def test_the_base_is_where_its_sensors_show_it(reach):
    errors = {"position": 0.01, "orientation": 0.02, "velocity": 0.03, "spin": 0.04}
    scene = reach(
        FLIGHT[0],
        FLIGHT[3],
        *((f"robots.one.sensors.base_{key}.offset", error) for key, error in errors.items()),
    )
    nq, joint = scene.model.nq, scene.model.joints[scene.robots[0].root_joint]
    q, v = np.split(seen_state(scene, np.append(scene.q, scene.v)), [nq])
    x, y, cos, sin = q[joint.idx_q : joint.idx_q + 4]
    np.testing.assert_allclose([x, y, np.arctan2(sin, cos)], [-0.49, 0.01, 0.02], atol=1e-12)
    turned = np.array([[cos, sin], [-sin, cos]]) @ [0.03, 0.03]  # own axes
    np.testing.assert_allclose(v[joint.idx_v : joint.idx_v + 3], [*turned, 0.04], atol=1e-12)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ([("plan.duration", {"lower": 2, "upper": 3})], "found 2 to 3 s, allowed with kind mpc"),
        ([("plan.duration", 3.2)], "so many periods of 0.5 s"),
        ([("plan.start", {"one": {"position": [0.1, 0, 0]}})], "found a free start"),
        (
            [("phases", {"come": {"until": {"time": 3}}, "wait": {}})],
            "phases.wait.robots.one.controllers: plans are made in one phase alone, found them in 'come' too",
        ),
        ([("phases", {"wait": {"robots": {"one": {"controllers": {"lead": None}}}}})], "rest in all of them"),
        ([("robots.one.controllers.lead.delay", 0.6)], "delay: found 0.6 s, allowed: at most the period"),
        (
            [("plan.limits.base_force", 1.0)],
            "controllers.lead: commands a force on the base, which no actuator of the robot delivers",
        ),
        (
            [
                ("robots.one.actuators", {"jets": {"kind": "base_wrench", "force": 1.0}}),
                ("robots.one.controllers.hold", {"kind": "base_attitude", "kp": 1, "kd": 1}),
            ],
            "controllers.hold: acts on the base, which plans drive; write `hold: null`",
        ),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(reach, changes, message):
    with pytest.raises(ScenarioError, match=message):
        simulate(reach(*FLIGHT, *changes), backend="interpreted")


def test_a_robot_without_such_a_controller_is_refused(reach):
    with pytest.raises(ScenarioError, match="has no controller of kind mpc"):
        mpc_settings(reach(*FLIGHT, ("robots.one.controllers", {})))


def test_what_cannot_plan_in_flight_says_so(reach):
    with pytest.raises(ScenarioError, match=r"robots.one.controllers.lead: kind mpc solves") as fault:
        build_closed_loop(reach(*FLIGHT))
    assert fault.value.exit_code == 2


@pytest.mark.parametrize(
    "name",
    [
        *(f"examples/{name}.yaml" for name in ("receding", "docking-receding", "wrong-model")),
        "docking-as-flown",
        "capture-as-flown",
    ],
)
def test_the_examples_are_read(name):
    scene = load_scene(name)
    assert not scene.warnings
    assert mpc_settings(scene).period > 0


SLOW = [
    ("plan.duration", 2),
    ("robots.one.controllers.lead.iterations", 30),
    ("target.base.velocity", [0.002, 0.004, 0]),
    ("target.base.spin_deg", [0, 0, 0.5]),
    ("robots.one.tips.tip.pid", {"kp": 20, "kd": 10}),
    (
        "grasps",
        {
            "grip": {
                "tip": "one/tip",
                "frame": "mate_1",
                "kind": "compliant",
                "begins": "open",
                "stiffness": 20,
                "damping": 4,
                "capture": {"distance": 0.02, "closing_speed": 0.05, "lateral_speed": 0.05, "dwell": 0.1},
            }
        },
    ),
    (
        "phases",
        {
            "come": {
                "robots": {"one": {"tips": {"tip": {"pid": None}}}},
                "until": {"captured": ["grip"]},
                "timeout": 4,
                "on_timeout": "end",
            },
            "hold": {"robots": {"one": {"controllers": {"lead": None}}}, "until": {"time": 0.5}},
        },
    ),
]
"""Comes to the target by plans, is captured, and holds it by its own controllers."""


@pytest.mark.parametrize("delay", [0.0, 0.3])
def test_plans_lead_in_the_first_phase_until_the_capture(reach, delay):
    lead = ("robots.one.controllers.lead.delay", delay)
    flown = simulate(reach(*FLIGHT, *SLOW, lead), backend="interpreted")
    kinds = [event["kind"] for event in flown.summary["events"]]
    assert kinds[-3:] == ["captured", "phase", "end"]
    captured = next(event["time_s"] for event in flown.summary["events"] if event["kind"] == "captured")
    assert 1.5 < captured < 3
    assert flown.summary["status"]["reached_s"] == pytest.approx(captured + 0.5)
    told = flown.summary["mpc"]
    assert (told["delay_s"], told["missed"]) == (delay, 0)


def test_behind_the_delay_a_plan_begins_where_the_model_comes_to(reach, monkeypatch):
    real, begun = Horizon.replan, []
    monkeypatch.setattr(
        Horizon,
        "replan",
        lambda self, *given: (begun.append(given[:2]), real(self, *given)),
    )
    scene = reach(*FLIGHT[:1], *FLIGHT[2:], ("plan.duration", 2), ("robots.one.controllers.lead.delay", 0.3))
    flown = simulate(scene, backend="interpreted")
    assert [begin for begin, _ in begun] == pytest.approx([0.8])
    there = flown.data.sel(time=0.8, method="nearest")
    np.testing.assert_allclose(begun[0][1], np.append(there.q.values, there.v.values), atol=1e-9)


def test_filters_assume_the_noise_of_their_sensors_where_plans_predict(reach):
    """The model's sensors show no noise; filters would divide by covariances of zero."""
    given = {"errors": {"period": 0.05, "noise": 1e-3, "bias": 1e-3}}
    scene = reach(
        *FLIGHT[:1],
        *FLIGHT[2:],
        ("plan.duration", 2),
        ("robots.one.controllers.lead.delay", 0.3),
        ("robots.one.sensors", {"base_spin": given, "base_orientation": given}),
        ("robots.one.estimators", {"own": {"kind": "attitude_filter"}}),
    )
    flown = simulate(scene, backend="interpreted")
    assert flown.summary["mpc"]["plans"] == 2
    assert np.isfinite(flown.data.q.values).all()


def test_a_limit_that_is_violated_already_is_not_to_be_violated_more(reach):
    scene = reach(*FLIGHT, ("plan.limits.base_rotation_deg", 5))
    solver = PlanSolver.of(scene, "interpreted")
    state = np.concatenate([scene.q, scene.v])
    horizon = Horizon.of(solver, state, 1.0)
    joint = scene.model.joints[scene.robots[0].root_joint]
    angle = np.radians(-5.1)
    state[joint.idx_q + 2 : joint.idx_q + 4] = np.cos(angle), np.sin(angle)
    horizon.replan(0.5, state, 60)
    assert horizon.missed == 0
    wider = [
        (old.upper, new.upper)
        for old, new in zip(solver.problem.path, horizon.motion.problem.path, strict=True)
        if old.upper != new.upper
    ]
    assert len(wider) == 1
    assert wider[0][0] < wider[0][1] < 1.1 * wider[0][0]


def test_what_is_left_of_a_plan_is_the_next_one(reach):
    scene = reach(*FLIGHT, ("plan.intervals", 6))
    horizon = Horizon.of(PlanSolver.of(scene, "interpreted"), np.concatenate([scene.q, scene.v]), 0.5)
    times = np.linspace(1, 3, 9)
    whole = horizon.at(times)
    horizon.replan(1.0, np.concatenate([whole[0][0], whole[1][0]]), 60)
    assert horizon.motion.intervals == 4
    assert horizon.iterations[-1] <= 2  # multipliers and unknowns are nearly those of the solution
    for new, old in zip(horizon.at(times)[:2], whole[:2], strict=True):
        np.testing.assert_allclose(new, old, atol=2e-4)


def test_plans_are_made_with_a_model_of_their_own(reach):
    """A base taken for 30 % lighter, with a wrong inertia: plans made again arrive, one plan does not."""
    base = reach().scenario.robots["one"].links["base"]
    wrong = {"mass": 0.7 * base.mass, "inertia.2": 1.5 * base.inertia[2]}
    model = ("plan.model", {f"robots.one.links.base.{key}": value for key, value in wrong.items()})
    scene = reach(FLIGHT[0], *FLIGHT[2:], model)
    base = scene.robots[0].root_joint
    assumed, true = (each.model.inertias[base] for each in (formulate(scene).stage.scene, scene))
    assert assumed.mass < 0.8 * true.mass
    assert assumed.inertia[2, 2] > 1.1 * true.inertia[2, 2]
    exact, flown, once = (
        simulate(reach(FLIGHT[0], *FLIGHT[2:], *more), backend="interpreted")
        for more in ((), (model,), (model, ("robots.one.controllers.lead.min_horizon", 100)))
    )
    misses = [miss(one, scene) for one in (exact, flown, once)]
    assert misses[0] < misses[1] < 0.6 * misses[2]


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("robots.one.links.bass.mass", "plan.model: change robots.one.links"),
        ("simulation.duration", "allowed: paths in robots, target"),
        ("robots.one.base.position", "changes where or with what the motion begins"),
    ],
)
def test_a_model_that_is_no_model_of_the_plant_is_refused(reach, path, message):
    with pytest.raises(ScenarioError, match=message):
        formulate(reach(("plan.model", {path: [0, 1, 0] if "position" in path else 1.0})))


def test_both_engines_fly_the_same_plans(reach):
    noisy = {
        "target_position": {"errors": {"period": 0.1, "delay": 0.1, "noise": 1e-3}},
        "joint_rate": {"errors": {"period": 0.05, "noise": 1e-4}},
    }
    lead = LEAD | {"delay": 0.3, "sampled": {"period": 0.05, "delay": 0.01}}
    changes = [*FLIGHT, *SLOW, ("robots.one.controllers.lead", lead), ("robots.one.sensors", noisy)]
    changes += [("simulation.step", 0.005), ("simulation.tolerance", 1e-7)]
    first = simulate(reach(*changes), backend="interpreted")
    second = simulate(reach(*changes, ("simulation.engine", "pinocchio")), backend="interpreted")
    times = [[e["time_s"] for e in each.summary["events"]] for each in (first, second)]
    np.testing.assert_allclose(times[0], times[1], atol=1e-6)
    kept = min(first.data.sizes["time"], second.data.sizes["time"])
    for name in ("q", "measured_target_position"):
        np.testing.assert_allclose(first.data[name].values[:kept], second.data[name].values[:kept], atol=1e-6)
    assert first.summary["mpc"]["plans"] == second.summary["mpc"]["plans"]


def test_a_plan_of_several_phases_is_flown_in_its_first_one(reach):
    """The arm comes to the target slower than by a plan that ends there: it is to rest a second later."""
    ends, goes_on = (
        simulate(reach(FLIGHT[0], FLIGHT[2], *more), backend="interpreted")
        for more in ([*SLOW[:1], *TWO_PHASES[2:4]], TWO_PHASES)
    )
    told = goes_on.summary["mpc"]
    assert (told["plans"], told["missed"]) == (3, 0)
    scene, at_goal = reach(), []
    for result in (ends, goes_on):
        there = result.data.sel(time=2, method="nearest")
        data = scene.model.createData()
        pin.framesForwardKinematics(scene.model, data, there.q.values)
        mate = scene.model.getFrameId("target/mate_1", pin.FrameType.BODY)
        at_goal.append(np.linalg.norm(data.oMf[scene.tips[0].frame].translation - data.oMf[mate].translation))
    assert max(at_goal) < 1e-3
    assert np.abs(ends.data.q.values[:21] - goes_on.data.q.values[:21]).max() > 1e-3


def test_no_garbage_is_collected_during_a_replan_and_afterwards_it_is():
    with without_garbage_collection():
        assert not gc.isenabled()
    assert gc.isenabled()
    gc.disable()
    try:
        with without_garbage_collection():
            pass
        assert not gc.isenabled()  # as before
    finally:
        gc.enable()
