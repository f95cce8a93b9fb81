"""Costs and limits of plans as kinds: their sections, factors by joint and by axis, and a user's own."""

import json
from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
import xarray as xr
import yaml

from optim.planning.formulation.formulate import formulate
from optim.planning.search.make_plan import make_plan
from optim.planning.search.plan_solver import PlanSolver
from spacerobot.common.errors import ScenarioError
from spacerobot.scenario.load import to_document
from spacerobot.scenario.plan import PlanSection
from tests import forks
from tests.optim.planning.conftest import REACH

ROOT = Path(__file__).parents[3]
DRIVEN = ("plan.limits", {"base_force": 3, "base_torque": 2})


def values(scene):
    """Each term, and the parts of an instant that was drawn."""
    problem = formulate(scene)
    stage = problem.stage
    z = np.random.default_rng(0).uniform(-1, 1, stage.z.numel())
    found = {name: float(ca.Function("f", [stage.z], [one])(z)) for name, one in problem.terms.items()}
    first = stage.q.numel()
    v, a, u = np.split(z[first:], [stage.v.numel(), 2 * stage.v.numel()])
    return found, v, a, u


def test_squares_have_factors_by_joint_and_by_axis(reach):
    costs = {
        "torque": {"weight": 2, "factors": {"one/*": 3, "one/joint_2": 0}},
        "elbow": {"kind": "joint_rate", "weight": 1, "factors": {"*": 0, "*joint_3": 1}},
        "joint_acceleration": 1,
        "base_force": {"weight": 1, "factors": {"* y": 5}},
        "base_torque": 4,
        "base_wrench": 1,
    }
    found, v, a, u = values(reach(("plan.costs", costs), DRIVEN))
    assert found == pytest.approx(
        {
            "torque": 3 * u[0] ** 2 + 3 * u[2] ** 2,
            "elbow": v[5] ** 2,
            "joint_acceleration": (a[3:6] ** 2).sum(),
            "base_force": u[3] ** 2 + 5 * u[4] ** 2,
            "base_torque": u[5] ** 2,
            "base_wrench": (u[3:] ** 2).sum(),
        }
    )


def test_sections_are_as_short_in_results_as_users_write_them(reach):
    plan = {
        "costs": {"torque": 0.5, "wrist": {"kind": "torque", "weight": 1.0}, "time": 0.0},
        "limits": {"torque": 3.0, "urdf": ["rate"], "eye": {"kind": "joint_rate_deg", "upper": 9.0}},
    }
    scene = reach(*((f"plan.{key}", one) for key, one in plan.items()), ("plan.limits.joint_speed", None))
    document = to_document(scene.scenario)["plan"]
    assert document["costs"]["torque"] == 0.5
    assert document["costs"]["wrist"] == {"kind": "torque", "weight": 1.0, "factors": {}}
    assert document["limits"] == plan["limits"]
    assert PlanSection.model_validate(document) == scene.scenario.plan


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ([("plan.costs.torqe", 1)], "plan.costs.torqe: found 'torqe', allowed: .* did you mean torque"),
        ([("plan.costs.torque", -1)], "plan.costs.torque: found -1, allowed: at least 0"),
        ([("plan.costs.torque", "much")], "plan.costs.torque: found 'much', allowed: a section"),
        ([("plan.costs.torque", {})], "plan.costs.torque.weight: missing"),
        ([("plan.limits.torque", {"lower": 1})], "plan.limits.torque: unknown key 'lower'"),
        ([("plan.limits.sight", 3)], "plan.limits.sight"),
        (
            [("plan.costs.torque", {"weight": 1, "factors": {"joint_1": 2}})],
            "plan.costs.torque.factors: no component 'joint_1'; did you",
        ),
        ([("plan.costs.time", {"kind": "torque", "weight": 1})], "plan.costs.time: found kind 'torque'"),
        (
            [("plan.costs.base_wrench", 1)],
            "plan.costs.base_wrench: found a weight of 1, but there are no",
        ),
        ([("plan.costs.propellant", 1)], "no forces on bases: give `limits.base_force`"),
        ([("plan.costs.base_torque", 1), ("plan.limits.base_force", 2)], "there are no torques on bases"),
        ([("plan.costs.grip_force", 1)], "this scene has no grasp that holds"),
        (
            [
                ("plan.costs.impact_speed", 1),
                ("plan.goals", {"o": {"tip": "one/tip", "position": [0, 0, 0]}}),
            ],
            "there are no tips that reach mating frames",
        ),
        (
            [("plan.costs.base_rotation", 1), ("robots.one.base.joint", "fixed")],
            "no floating bases of",
        ),
    ],
)
def test_what_is_not_there_is_refused(reach, changes, message):
    with pytest.raises(ScenarioError, match=message):
        PlanSolver.of(reach(*changes), "interpreted")


def test_a_cost_and_a_limit_of_ones_own_come_from_one_file(tmp_path):
    """In a process of its own, so that kinds stay out of other tests."""
    file, plugin = tmp_path / "reach.yaml", ROOT / "examples" / "plugins" / "tip_speed.py"
    plan = REACH["plan"] | {
        "costs": {"torque": 0.01, "tip_speed": 1.0},
        "limits": {"tip_speed": {"tip": "one/tip", "upper": 0.16}},
        "tolerance": 1e-3,
        "order": 4,
    }
    file.write_text(yaml.safe_dump(REACH | {"plan": plan}))
    done = forks.command("plan", file, "--plugin", plugin, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stdout + done.stderr
    told = json.loads((tmp_path / "out" / "plan.json").read_text())
    assert told["terms"]["tip_speed"] > 0.01
    assert "tip speed" in done.stdout
    without = forks.command("check", file)
    assert without.returncode == 2
    assert "your own come with --plugin FILE" in without.stderr.replace("\n", " ")


TIP_SPEED = """
import spacerobot as sr

sr.register_quantity(
    sr.Quantity(
        name="tip_speed_rms", label="RMS tip speed", description="root mean square of the speed of a tip",
        unit="m/s", reducer="rms", expression="tip_velocity",
        bounds=(sr.PlanBound("tip_speed", "m/s", "maximum speed of any tip"),),
    )
)
"""


def test_a_registered_quantity_of_ones_own_is_a_limit_of_plans(tmp_path):
    """The plan's fastest tip is as fast as the limit, and not without it."""
    plan = REACH["plan"] | {"costs": {"torque": 1}, "tolerance": 1e-3, "order": 4}
    (tmp_path / "fast.py").write_text(TIP_SPEED)
    peaks = []
    for name, limits in (("free", {}), ("slow", {"tip_speed": 0.06})):
        file = tmp_path / f"{name}.yaml"
        file.write_text(yaml.safe_dump(REACH | {"plan": plan | {"limits": limits}}))
        done = forks.command("plan", file, "--plugin", tmp_path / "fast.py", "--out", tmp_path / name)
        assert done.returncode == 0, done.stdout + done.stderr
        with xr.open_dataset(tmp_path / name / "plan.nc") as data:
            peaks.append(float(np.linalg.norm(data.tip_velocity.values, axis=-1).max()))
    assert peaks[0] > 0.07
    assert peaks[1] == pytest.approx(0.06, abs=1e-3)


def test_goals_have_tolerances_and_cost_less_with_them(reach):
    """Each tolerance is used up, and what is saved is of first order."""
    posture = {"robot": "one", "joints": {"joint_1": {"angle_deg": 60}, "joint_3": {"angle_deg": -50}}}
    short = [
        ("plan.duration", 3),
        ("plan.intervals", 4),
        ("plan.tolerance", 1e-3),
        ("plan.costs", {"torque": 1}),
    ]
    exact, loose = (
        make_plan(reach(*short, ("plan.goals", {"turn": posture | more})), backend="interpreted")
        for more in ({}, {"within_deg": 1, "rate_within": 0.01})
    )
    assert loose.cost < 0.9 * exact.cost
    columns = list(loose.motion.problem.stage.driven.columns)
    assert np.abs(loose.motion.v[-1, columns]).max() == pytest.approx(0.01, rel=1e-4)
    assert np.degrees(loose.motion.q[-1, 4]) == pytest.approx(59, abs=1e-4)
    assert np.degrees(exact.motion.q[-1, 4]) == pytest.approx(60, abs=1e-6)


@pytest.mark.parametrize(
    ("goal", "rows"),
    [
        ({"still": "one", "speed_within": 0.2, "spin_within_deg": 3}, {"velocity", "spin"}),
        ({"still": "one", "speed_within": 0.2}, {"velocity", "spin z"}),
        ({"tip": "one/tip", "position": [0, 0, 0], "position_within": 0.1}, {"position"}),
        (
            {"tip": "one/tip", "position": [0, 0, 0], "rotation_deg": [0, 0, 9], "rotation_within_deg": 2},
            {"position x", "position y", "orientation"},
        ),
        ({"attitude": "one", "rotation_deg": [0, 0, 9], "rotation_within_deg": 2}, {"attitude"}),
        (
            {"tip": "one/tip", "frame": "mate_1", "position_within": 0.1, "orientation_within_deg": 2},
            {"position", "orientation", "velocity x", "velocity y", "spin z"},
        ),
    ],
)
def test_tolerances_of_goals_are_bounds_of_sizes(reach, goal, rows):
    found = [row for row in formulate(reach(("plan.goals", {"end": goal}))).goal if "rate" not in row.name]
    assert {row.name.removeprefix("end: ") for row in found} == rows


def test_a_mated_pose_is_met_within_its_tolerances(reach):
    """Both are used up: what a nearer pose would cost is saved."""
    goal = {"tip": "one/tip", "frame": "mate_1", "position_within": 0.05, "orientation_within_deg": 1}
    short = [("plan.intervals", 4), ("plan.tolerance", 1e-2), ("plan.duration", 3)]
    loose = make_plan(reach(*short, ("plan.goals", {"mate": goal})), backend="interpreted")
    exact = make_plan(reach(*short), backend="interpreted")
    assert loose.cost < 0.97 * exact.cost
    scene, off = loose.scene, list[float]()
    for plan in (loose, exact):
        data = scene.model.createData()
        pin.framesForwardKinematics(scene.model, data, plan.motion.q[-1])
        mate = data.oMf[scene.model.getFrameId("target/mate_1", pin.FrameType.BODY)]
        seen = mate.inverse() * data.oMf[scene.tips[0].frame]
        off += [
            float(np.linalg.norm(seen.translation)),
            float(np.degrees(np.linalg.norm(pin.log3(seen.rotation)))),
        ]
    np.testing.assert_allclose(off, [0.05, 1.0, 0.0, 0.0], atol=2e-5)


def test_a_posture_outside_a_range_is_refused(reach):
    goal = {"robot": "one", "joints": {"joint_1": {"angle_deg": 400}}}
    with pytest.raises(
        ScenarioError, match=r"goals.end.joints.joint_1: found 400, allowed: the joint's range of"
    ):
        formulate(reach(("plan.goals", {"end": goal})))
