"""Bases that are driven by what the scenario has on them: wheels with their momentum, thrusters, a wrench."""

import itertools

import casadi as ca
import numpy as np
import pytest
import yaml

from optim.planning.formulation.reaction_wheels import wheel_driven_bases
from optim.planning.output.plan_folder import FOLLOWED, summary, write
from optim.planning.search.make_plan import make_plan
from optim.planning.search.plan_solver import PlanSolver
from spacerobot.common.errors import ScenarioError
from spacerobot.elements.actuators.thrusters import Thrusters
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate

WHEELS = {
    "kind": "reaction_wheels",
    "pyramid": {"wheels": 4, "tilt_deg": 35.26},
    "inertia": 0.002,
    "torque_limit": 0.05,
    "speeds": [40, 0, 0, 0],
}
BODY = {
    "name": "spin",
    "robots": {
        "body": {
            "urdf": "rectangle.urdf",
            "base": {"joint": "free_flyer", "spin_deg": [1, 5, 2]},
            "actuators": {"wheels": WHEELS},
        }
    },
    "plan": {
        "duration": {"lower": 1, "upper": 60, "guess": 15},
        "goals": {"rest": {"still": "body"}},
        "costs": {"time": 0.01, "base_wrench": 100},
        "limits": {"wheel_momentum": 0.13},
        "intervals": 6,
        "tolerance": 1e-4,
    },
    "simulation": {"duration": 5, "step": 0.01, "output_step": 0.1},
}
"""A body that turns about no principal axis of its wheels, one of which runs."""
PLANAR = [
    ("robots.body.base", {"joint": "planar", "spin_deg": [0, 0, 10]}),
    ("plan.costs", {"time": 1}),
    ("plan.limits", {}),
]
JETS = {
    f"jet_{k}": {"position": [0, side, 0], "direction": [way, 0, 0]}
    for k, (way, side) in enumerate(itertools.product((1, -1), (0.5, -0.5)))
}


@pytest.fixture(scope="module")
def spinning(tmp_path_factory):
    """Function of changes that gives the scene."""
    file = tmp_path_factory.mktemp("wheels") / "wheels.yaml"
    file.write_text(yaml.safe_dump(BODY))
    return lambda *changes: load_scene(file, list(changes))


def flown(found, robot, folder):
    """Momenta of wheels relative to the base: planned, and in flight by the plan's formula and really."""
    write(found, folder)
    result = simulate(load_scene(folder / FOLLOWED), backend="interpreted").data
    stage = found.motion.problem.stage
    turned = wheel_driven_bases(stage)[robot]
    inertia = turned.wheels.inertia
    formula = ca.Function("speeds", [stage.q, stage.v], [ca.densify(turned.speeds)])
    speeds = np.array(formula(result.q.values.T, result.v.values.T)).T
    momenta = ca.Function("momenta", [stage.z], [ca.densify(inertia * turned.speeds)])
    planned = np.array(momenta(found.motion.z.T).full()).T
    return planned, inertia * speeds, inertia * result.wheel_speed.values, result


def test_wheels_detumble_a_body_within_their_momentum_and_the_real_ones_fly_it(spinning, tmp_path):
    found = make_plan(spinning(), backend="interpreted")
    planned, formula, real, result = flown(found, "body", tmp_path)
    whole = found.motion.problem.path
    held = [row for row in whole if row.name.startswith("wheel momentum")]
    values = ca.Function("held", [found.motion.problem.stage.z], [ca.vertcat(*(row.value for row in held))])
    assert np.abs(values(found.motion.z.T).full()).max() == pytest.approx(0.13, abs=1e-6)
    np.testing.assert_allclose(formula, real, atol=1e-9)
    np.testing.assert_allclose(real[-1], planned[-1], atol=1e-6)
    np.testing.assert_allclose(result.v.values[-1], 0, atol=1e-6)
    assert summary(found)["base_limits"] == {"body": "wheels"}
    loose = make_plan(spinning(("plan.limits.wheel_momentum", 1)), backend="interpreted")
    assert loose.cost < found.cost - 1e-3


def test_wheels_take_what_an_arm_and_the_object_it_holds_lose(reach, tmp_path):
    changes = [
        ("robots.one.base.spin_deg", [0, 0, 3]),
        (
            "robots.one.actuators",
            {"wheels": {"kind": "reaction_wheels", "axes": [[0, 0, 1]], "inertia": 0.1}},
        ),
        ("grasps", {"left": {"tip": "one/tip", "frame": "mate_1", "kind": "weld"}}),
        ("plan.goals", {"end": {"robot": "one", "joints": {"joint_1": {"angle_deg": 50}}}}),
        ("plan.duration", 3),
        ("plan.intervals", 6),
        ("plan.costs", {"torque": 0.01, "joint_acceleration": 1, "base_rotation": 9, "wheel_momentum": 0.01}),
    ]
    found = make_plan(reach(*changes), backend="interpreted")
    planned, formula, real, _ = flown(found, "one", tmp_path)
    assert found.terms["wheel_momentum"] > 0
    assert np.ptp(planned) > 0.02
    np.testing.assert_allclose(formula, real, atol=1e-8)
    np.testing.assert_allclose(real[-1], planned[-1], atol=1e-5)


def test_limits_not_given_are_those_of_the_actuators(spinning):
    ideal = {"ideal": {"kind": "base_wrench", "force": 1, "torque": 0.1}}
    found = make_plan(spinning(*PLANAR, ("robots.body.actuators", ideal)), backend="interpreted")
    moment = found.scene.model.inertias[1].inertia[2, 2] * np.radians(10)
    assert found.motion.duration_s == pytest.approx(moment / 0.1, rel=1e-6)
    jets = {"jets": {"kind": "thrusters", "nozzles": JETS}}
    pushed = PlanSolver.of(spinning(*PLANAR, ("robots.body.actuators", jets)), "interpreted").problem
    assert pushed.stage.driven.of_base("body") == ["fx", "tz"]
    np.testing.assert_allclose(pushed.stage.driven.limits, [1, 0.5], rtol=1e-6)
    free = [("robots.body.base.spin_deg", [0, 0, 0]), ("plan.limits.base_torque", 0)]
    free += [("robots.body.actuators", ideal), ("plan.limits.base_force", 0)]
    still = PlanSolver.of(spinning(*PLANAR, *free), "interpreted").problem
    assert not still.stage.driven.drives_bases


def test_the_box_of_thrusters_is_one_whose_corners_they_reach():
    """Force u + w and torque (w - u) / 2 of two pairs, each between -1 and 1."""
    box = Thrusters(nozzles=JETS).wrench_limits(planar=True)
    np.testing.assert_allclose([box["force"], box["torque"]], [[1, 0, 0], [0, 0, 0.5]], atol=1e-9)


@pytest.mark.parametrize(
    ("first", "limits"),
    [
        ("jets", [3, 2, 1.2]),  # what thrusters leave goes to the wrench
        ("ideal", [1, 0.5]),  # the wrench bounds what is asked of thrusters
    ],
)
def test_thrusters_and_a_wrench_on_one_base_both_count(spinning, first, limits):
    both = {
        "jets": {"kind": "thrusters", "nozzles": JETS},
        "ideal": {"kind": "base_wrench", "force": 2, "torque": 0.7},
    }
    own = {name: both[name] for name in sorted(both, key=lambda name: name != first)}
    problem = PlanSolver.of(spinning(*PLANAR, ("robots.body.actuators", own)), "interpreted").problem
    np.testing.assert_allclose(problem.stage.driven.limits, limits, rtol=1e-6)


def test_pulses_leave_nothing_to_the_next_actuator(spinning):
    jets = {"kind": "thrusters", "mode": "pulsed", "nozzles": JETS}
    own = ("robots.body.actuators", {"jets": jets, "ideal": {"kind": "base_wrench", "force": 2}})
    problem = PlanSolver.of(spinning(*PLANAR, own), "interpreted").problem
    np.testing.assert_allclose(problem.stage.driven.limits, [1, 0.5], rtol=1e-6)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            [("robots.body.actuators", {}), ("plan.limits.base_torque", 1)],
            "no robot's base is turned by one set",
        ),
        ([("plan.limits.base_force", 1)], "no robot's base is turned by one set of `reaction_wheels` alone"),
        (
            [("plan.costs.wheel_momentum", 1), ("robots.body.actuators.more", {"kind": "base_wrench"})],
            "no robot's base is turned by one set of `reaction_wheels` alone",
        ),
        (
            [("plan.start", {"body": {"position": [0.1, 0, 0]}})],
            "momentum of body's wheels counts from where it begins",
        ),
    ],
)
def test_momentum_of_wheels_that_is_not_known_is_refused(spinning, changes, message):
    with pytest.raises(ScenarioError, match=message) as fault:
        PlanSolver.of(spinning(*changes), "interpreted")
    assert fault.value.exit_code == 2
