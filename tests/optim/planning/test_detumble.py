"""Bodies that come to rest, by a wrench on their base."""

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
import yaml

from optim.planning.formulation.formulate import formulate
from optim.planning.formulation.grasps import tip_slip
from optim.planning.output.plan_folder import FOLLOWED, dataset, write
from optim.planning.search.make_plan import make_plan
from optim.planning.search.plan_solver import PlanSolver
from spacerobot.common.errors import ScenarioError
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate

BODY = {
    "name": "spin",
    "robots": {"body": {"urdf": "rectangle.urdf", "base": {"joint": "planar", "spin_deg": [0, 0, 10]}}},
    "plan": {
        "duration": {"lower": 1, "upper": 60},
        "goals": {"rest": {"still": "body"}},
        "costs": {"time": 1},
        "limits": {"base_torque": 0.1, "base_force": 1},
        "order": 4,
        "intervals": 4,
    },
    "simulation": {"duration": 5, "step": 0.02},
}
"""A single body that turns about a principal axis."""
FIXED = [("robots.body.urdf", "short_arm.urdf"), ("robots.body.base", {"joint": "fixed"})]


@pytest.fixture(scope="module")
def spinning(tmp_path_factory):
    """Function of changes that gives the scene."""
    file = tmp_path_factory.mktemp("spin") / "spin.yaml"
    file.write_text(yaml.safe_dump(BODY))
    return lambda *changes: load_scene(file, list(changes))


def angular_momentum(scene):
    return scene.model.inertias[1].inertia[2, 2] * np.radians(10)


def test_least_time_about_a_principal_axis_is_momentum_over_torque(spinning):
    found = make_plan(spinning(), backend="interpreted")
    assert found.motion.duration_s == pytest.approx(angular_momentum(found.scene) / 0.1, rel=1e-6)
    np.testing.assert_allclose(found.motion.u[:, 2], -0.1, rtol=1e-5)
    np.testing.assert_allclose(found.motion.v[-1], 0, atol=1e-9)


def test_planned_wrenches_on_a_base_are_flown(spinning, tmp_path):
    found = make_plan(spinning(), backend="interpreted")
    write(found, tmp_path)
    scene = load_scene(tmp_path / FOLLOWED)
    flown = simulate(scene, backend="interpreted").data
    rates = flown.v.values[:, 2]
    np.testing.assert_allclose(rates, np.radians(10) * (1 - flown.time / flown.time[-1]), atol=1e-6)


def test_time_and_effort_are_traded_by_their_weights(spinning):
    """a T + b L^2 / T is least at T = L sqrt(b / a)."""
    changes = [("plan.costs", {"time": 2.0, "base_wrench": 3e3}), ("plan.limits.base_torque", 1)]
    found = make_plan(spinning(*changes), backend="interpreted")
    momentum = angular_momentum(found.scene)
    assert found.motion.duration_s == pytest.approx(momentum * np.sqrt(3e3 / 2), rel=1e-5)
    assert found.cost == pytest.approx(2 * momentum * np.sqrt(6e3), rel=1e-6)


HOLDING = [
    ("robots.one.base.spin_deg", [0, 0, 3]),
    ("robots.one.base.velocity", [0.01, 0, 0]),
    ("grasps", {"left": {"tip": "one/tip", "frame": "mate_1", "kind": "weld"}}),
    ("plan.goals", {"rest": {"still": "one"}}),
    ("plan.costs", {"time": 0.1, "torque": 0.01, "base_wrench": 1e-4}),
    ("plan.duration", {"lower": 2, "upper": 40, "guess": 8}),
    ("plan.intervals", 6),
    ("plan.tolerance", 1e-4),
    ("plan.limits", {"base_torque": 20, "base_force": 20}),
]
"""An arm that holds a rectangle by a weld, all turning together."""


@pytest.fixture(scope="module")
def holding(reach):
    return [
        make_plan(reach(*HOLDING, ("plan.limits.grip_force", limit)), backend="interpreted")
        for limit in (None, 0.8)
    ]


def test_an_arm_brings_what_it_holds_to_rest_within_what_its_grip_bears(holding):
    strong, weak = ([plan.motion, np.linalg.norm(plan.motion.w[:, :2], axis=1).max()] for plan in holding)
    assert strong[1] > 1.5
    assert weak[1] == pytest.approx(0.8, abs=1e-4)
    assert weak[0].duration_s > strong[0].duration_s + 0.1
    for motion, _ in (strong, weak):
        assert np.abs(motion.v[0]).max() > 0.05
        np.testing.assert_allclose(motion.v[-1], 0, atol=1e-6)


@pytest.mark.parametrize("still", ["one", "target"])
def test_a_held_target_and_its_holder_come_to_rest_together(reach, still):
    motion = make_plan(
        reach(*HOLDING, ("plan.goals", {"rest": {"still": still}})), backend="interpreted"
    ).motion
    assert np.abs(motion.v[0]).max() > 0.05
    np.testing.assert_allclose(motion.v[-1], 0, atol=1e-6)


FREE, BOLTED = {"joint": "planar", "spin_deg": [0, 0, 3]}, {"joint": "fixed"}
SOFT = {"kind": "compliant", "stiffness": 40, "damping": 20}


@pytest.mark.parametrize(
    ("still", "base", "grasp", "count"),
    [
        ("one", FREE, {"kind": "weld"}, 6),
        ("one", FREE, {"kind": "point"}, 7),
        ("one", FREE, SOFT, 9),
        ("target", FREE, {"kind": "weld"}, 6),
        ("target", FREE, {"kind": "point"}, 7),
        ("target", FREE, SOFT, 9),
        ("target", BOLTED, {"kind": "weld"}, 3),
        ("target", BOLTED, {"kind": "point"}, 4),
    ],
)
def test_rest_of_what_a_grasp_joins_has_one_equation_for_each_free_velocity(reach, still, base, grasp, count):
    """Of three joints, a base and a target in the plane; those that follow from the grasp are left out."""
    changes = [
        ("robots.one.base", base),
        ("grasps", {"left": {"tip": "one/tip", "frame": "mate_1"} | grasp}),
        ("target.base", {"joint": "planar", "close_grasp": "left"}),
        ("plan.goals", {"rest": {"still": still}}),
        ("plan.limits", {"base_torque": 20, "base_force": 20} if base is FREE else {}),
    ]
    problem = formulate(reach(*changes))
    stage, rows = problem.stage, problem.goal
    held = tip_slip(stage.scene, stage.kinematics, stage.grips)
    slopes = ca.densify(ca.jacobian(ca.vertcat(held, *(row.value for row in rows)), stage.v))
    matrix = ca.Function("slopes", [stage.q], [slopes])(stage.scene.q).full()
    assert len(rows) == count
    assert np.linalg.matrix_rank(matrix) == stage.scene.model.nv == held.numel() + count


def test_only_the_named_body_comes_to_rest_where_joints_need_not(reach):
    goals = {"rest": {"still": "target", "rest": False}}
    names = [row.name for row in formulate(reach(*HOLDING, ("plan.goals", goals))).goal]
    assert names == ["rest: velocity x", "rest: velocity y", "rest: spin z"]


def test_what_is_held_moves_with_the_tip_by_the_grips_wrench_alone(holding):
    motion, scene = holding[1].motion, holding[1].scene
    model, data = scene.model, scene.model.createData()
    tip, mate = scene.tips[0].frame, model.getFrameId("target/mate_1")
    columns = [model.idx_vs[scene.target.root_joint] + k for k in range(3)]
    world, relative = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED, []
    for q, v, a, w in zip(motion.q, motion.v, motion.a, motion.w, strict=True):
        force = pin.rnea(model, data, q, v, a)
        pin.framesForwardKinematics(model, data, q)
        relative.append((data.oMf[tip].inverse() * data.oMf[mate]).homogeneous)
        pin.computeJointJacobians(model, data, q)
        jacobian = pin.getFrameJacobian(model, data, mate, world)[[0, 1, 5]][:, columns]
        np.testing.assert_allclose(jacobian.T @ -w, force[columns], atol=1e-6)
    np.testing.assert_allclose(relative, np.broadcast_to(relative[0], np.shape(relative)), atol=1e-6)


def test_what_a_weld_holds_is_told_to_rest_once_and_needs_what_takes_its_momentum(reach):
    both = {"object": {"still": "target"}, "robot": {"still": "one"}}
    with pytest.raises(ScenarioError, match=r"goals.robot: one comes to rest by goal 'object' already"):
        make_plan(reach(*HOLDING, ("plan.goals", both)), backend="interpreted")
    with pytest.raises(ScenarioError, match="one cannot come to rest, for nothing takes its momentum"):
        make_plan(reach(*HOLDING, ("plan.limits", {})), backend="interpreted")
    with pytest.raises(ScenarioError, match="target moves on as it does, for nothing holds it"):
        make_plan(reach(("plan.goals", {"object": {"still": "target"}})), backend="interpreted")


def test_what_is_held_by_springs_is_planned_and_flown(reach, tmp_path):
    soft = {"tip": "one/tip", "frame": "mate_1", "kind": "compliant", "stiffness": 40, "damping": 20}
    changes = [
        ("robots.one.base.spin_deg", [0, 0, 3]),
        ("target.base", {"joint": "planar", "close_grasp": "left", "rotation_deg": [0, 0, 20]}),
        ("grasps", {"left": soft | {"rotational_stiffness": 4, "rotational_damping": 2}}),
        ("plan.goals", {"end": {"robot": "one", "joints": {"joint_1": {"angle_deg": 50}}}}),
        ("plan.duration", 3),
        ("plan.costs", {"torque": 0.01, "joint_acceleration": 1}),
        ("plan.limits", {"grip_force": 3}),
    ]
    found = make_plan(reach(*changes), backend="interpreted")
    torque = dataset(found).grip_wrench.sel(grip="left.tz").values
    assert torque[0] == pytest.approx(-2 * np.radians(3), abs=1e-9)  # the damper alone, the spring is at rest
    assert np.abs(torque).max() > 0.01
    write(found, tmp_path)
    flown = simulate(load_scene(tmp_path / FOLLOWED), backend="interpreted").data
    wanted = found.motion.q[-1]
    np.testing.assert_allclose(flown.q.values[-1], wanted, atol=1e-5)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ([("plan.limits", {})], "takes its momentum of 0.3927 N m s; give `limits.base_torque`"),
        ([("plan.goals.rest.still", "bode")], "no body 'bode'"),
        ([("plan.limits.base_torque", 0)], "takes its momentum of 0.3927 N m s; give `limits.base_torque`"),
        (
            [("plan.duration.upper", 3)],
            "momentum is 0.3927 N m s, of which 3 s take no more than 0.3 N m s; raise `limits.base_torque`",
        ),
        (FIXED, "is fixed, so it is always at rest"),
        ([("plan.goals.rest.tip", "body/tip")], "unknown key 'tip'; allowed: kind, rate_within"),
    ],
)
def test_what_cannot_come_to_rest_is_refused(spinning, changes, message):
    with pytest.raises(ScenarioError, match=message) as fault:
        make_plan(spinning(*changes), backend="interpreted")
    assert fault.value.exit_code == 2


def test_a_robot_cannot_come_to_rest_relative_to_what_moves_otherwise(reach):
    rest = ("plan.goals.mate.rest", True)
    with pytest.raises(ScenarioError, match="its angular momentum stays 0 N m s, so it cannot turn likewise"):
        PlanSolver.of(reach(rest), "interpreted")
    drifting = ("target.base.spin_deg", [0, 0, 0])
    with pytest.raises(ScenarioError, match="continues at 0 m/s, another velocity than that") as fault:
        PlanSolver.of(reach(rest, drifting), "interpreted")
    assert fault.value.where == "plan.goals.mate"
    same = ("robots.one.base.velocity", [0.01, 0.02, 0])
    for changes in (
        [drifting, same],
        [("plan.limits", {"base_force": 1})],
        [("plan.goals.mate.orientation", False)],
    ):
        PlanSolver.of(reach(rest, *changes), "interpreted")
