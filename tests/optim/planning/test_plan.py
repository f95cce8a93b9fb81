"""Plans from a scenario to a motion that is flown."""

import dataclasses
import json

import numpy as np
import pinocchio as pin
import pytest
import scipy.sparse as sp
import xarray as xr

from optim.planning.formulation.formulate import formulate
from optim.planning.output.following_scenario import PLAN
from optim.planning.output.plan_folder import FOLLOWED, SUMMARY, write
from optim.planning.search import plan_solver as solvers
from optim.planning.search.make_plan import make_plan
from optim.planning.transcription.collocation_program import CollocationProgram
from optim.planning.transcription.instant_functions import build_instants
from optim.planning.transcription.lobatto import Lobatto
from optim.planning.transcription.mesh import Mesh
from optim.planning.transcription.motion import Motion, PhasedMotion
from optim.planning.verification.replay import fastest_rate, replay_motion, tip_errors
from spacerobot.common.errors import NoPlanError, ScenarioError
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate

FREE = ("plan.duration", {"lower": 3, "upper": 9})


@pytest.fixture(scope="module")
def planned(reach):
    return make_plan(reach(), backend="interpreted")


@pytest.mark.parametrize(("order", "points"), [(2, 2), (4, 3), (6, 4), (8, 5)])
def test_collocation_integrates_as_high_polynomials_as_its_order_says(order, points):
    lobatto = Lobatto.of_order(order)
    assert lobatto.points == points
    for power in range(order):
        assert lobatto.weights @ lobatto.nodes**power == pytest.approx(1 / (power + 1), abs=1e-14)
    for power in range(points):
        exact = lobatto.nodes ** (power + 1) / (power + 1)
        np.testing.assert_allclose(lobatto.integral @ lobatto.nodes**power, exact, atol=1e-14)


def test_order_four_is_hermite_and_simpsons():
    np.testing.assert_allclose(Lobatto.of_order(4).weights, [1 / 6, 2 / 3, 1 / 6])


@pytest.mark.parametrize("changes", [(), (FREE, ("plan.costs.time", 0.1))])
def test_derivatives_of_the_program_equal_central_differences(reach, changes):
    held = [
        ("plan.limits", {"base_rotation_deg": 20, "base_translation": 0.5, "base_torque": 3}),
        ("pads.ball", {"link": "target/body", "kind": "sphere", "radius": 0.2}),
        ("pads.end", {"link": "one/link_3", "kind": "sphere", "radius": 0.05}),
        ("plan.keep_out.apart", {"between": ["end", "ball"], "distance": 0.02}),
        (
            "plan.approach_cones.mate",
            {"tip": "one/tip", "frame": "mate_1", "half_angle_deg": 20, "final_fraction": 0.5},
        ),
    ]
    problem = formulate(reach(*held, *changes))
    mesh = Mesh((0.0, 0.2, 0.35, 1.0))
    program = CollocationProgram(problem, build_instants(problem, "interpreted"), Lobatto.of_order(6), mesh)
    rng = np.random.default_rng(1)
    w, along = 0.3 * rng.normal(size=program.size), rng.normal(size=program.size)
    w[-1], multipliers, step = 5.0, rng.normal(size=program.rows), 1e-6

    def jacobian(at):
        return sp.csc_matrix(
            (program.jacobian(at), program.jacobian_pattern.indices, program.jacobian_pattern.indptr),
            shape=program.jacobian_pattern.shape,
        )

    def lagrangian(at):
        return 0.7 * program.gradient(at) + jacobian(at).T @ multipliers

    def difference(function):
        return (function(w + step * along) - function(w - step * along)) / (2 * step)

    assert program.gradient(w) @ along == pytest.approx(difference(program.objective), rel=1e-7)
    found, wanted = jacobian(w) @ along, difference(program.constraints)
    np.testing.assert_allclose(found, wanted, atol=1e-8 * np.abs(wanted).max())
    pattern = program.hessian_pattern
    half = sp.csc_matrix(
        (program.hessian(w, 0.7, multipliers), pattern.indices, pattern.indptr), pattern.shape
    )
    found, wanted = (half + sp.triu(half, 1).T) @ along, difference(lagrangian)
    np.testing.assert_allclose(found, wanted, atol=1e-7 * np.abs(wanted).max())


def test_a_plan_meets_its_goal_and_its_verdict(planned):
    motion, scene = planned.motion, planned.scene
    assert planned.verification.residual < 1e-6
    assert planned.verification.replay_error_m < 1e-5
    assert not planned.verification.failures()
    model, data = scene.model, scene.model.createData()
    pin.forwardKinematics(model, data, motion.q[-1], motion.v[-1])
    pin.updateFramePlacements(model, data)
    tip, mate = scene.tips[0].frame, model.getFrameId("target/mate_1")
    np.testing.assert_allclose(data.oMf[tip].homogeneous, data.oMf[mate].homogeneous, atol=1e-8)
    world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    speeds = [pin.getFrameVelocity(model, data, frame, world).vector for frame in (tip, mate)]
    np.testing.assert_allclose(speeds[0], speeds[1], atol=1e-8)


def test_pinocchio_finds_the_same_torques_and_no_wrench_on_the_base(planned):
    motion, model = planned.motion, planned.scene.model
    driven = list(motion.problem.stage.driven.columns)
    for q, v, a, u in zip(motion.q, motion.v, motion.a, motion.u, strict=True):
        force = pin.rnea(model, model.createData(), q, v, a) + np.array(model.damping) * v
        np.testing.assert_allclose(force[driven], u, atol=1e-6)
        np.testing.assert_allclose(np.delete(force, driven), 0, atol=1e-6)


def test_the_target_drifts_as_a_free_body(planned):
    motion, joint = planned.motion, planned.scene.model.joints[planned.scene.target.root_joint]
    place = motion.q[:, joint.idx_q : joint.idx_q + 2]
    along = np.array([0.8, 0.8]) + motion.time[:, None] * np.array([0.01, 0.02])
    np.testing.assert_allclose(place, along, atol=1e-9)


def test_what_is_written_is_flown(planned, tmp_path):
    write(planned, tmp_path / "out")
    plan = xr.load_dataset(tmp_path / "out" / PLAN)
    assert plan.sizes["time"] == planned.motion.intervals * 3 + 1
    assert list(plan.joint.values) == ["one/joint_1", "one/joint_2", "one/joint_3"]
    assert json.loads((tmp_path / "out" / SUMMARY).read_text())["verification"]["residual"] < 1e-6
    flown = simulate(load_scene(tmp_path / "out" / FOLLOWED), backend="interpreted")
    wanted = plan.tip_position.isel(time=-1).sel(tip="one/tip").values
    np.testing.assert_allclose(flown.data.tip_position.isel(time=-1, tip=0).values, wanted, atol=1e-5)


def test_feedback_takes_back_torques_that_are_wrong_as_the_follower_does(planned, tmp_path):
    z = planned.motion.z.copy()
    z[:, -3:] *= 1.2
    wrong = dataclasses.replace(
        planned, phased_motion=PhasedMotion((dataclasses.replace(planned.motion, z=z),))
    )
    alone, followed = replay_motion(wrong.motion, "interpreted")
    errors = [tip_errors(wrong.motion, states)["one/tip"][-1] for states in (alone, followed)]
    assert errors[0] > 0.02
    assert errors[1] < errors[0] / 4
    write(wrong, tmp_path / "out")
    flown = simulate(load_scene(tmp_path / "out" / FOLLOWED), backend="interpreted")
    np.testing.assert_allclose(np.linalg.norm(flown.data.tip_error.values[-1, 0]), errors[1], rtol=1e-4)


def test_a_damped_light_wrist_is_replayed_in_steps_that_stay_stable(reach):
    """Published URDFs damp light wrists by some N m s/rad, whose rates decay within 0.01 s."""
    light = ("robots.one.links.link_3", {"mass": 0.05, "inertia": [1e-4, 1e-4, 1e-4, 0, 0, 0]})
    damped = make_plan(reach(light, ("robots.one.joints.joint_3.damping", 5.0)), backend="interpreted")
    assert (
        fastest_rate(damped.motion, np.zeros(6)) > 280
    )  # above 2.8 / 0.01 s Runge's and Kutta's method diverges
    alone, _ = replay_motion(damped.motion, "interpreted")
    assert tip_errors(damped.motion, alone)["one/tip"].max() < 1e-5


def test_implicit_and_explicit_replays_agree(planned, monkeypatch):
    explicit = replay_motion(planned.motion, "interpreted")
    monkeypatch.setattr("optim.planning.verification.replay.STIFF", 0.0)
    for one, other in zip(explicit, replay_motion(planned.motion, "interpreted"), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-7)


def test_a_joint_whose_rate_decays_within_microseconds_is_replayed(reach):
    """Tiago's wrist moves 4e-6 kg m^2 against 1 N m s/rad: explicit steps would be ten microseconds long."""
    light = (
        "robots.one.links.link_3",
        {"mass": 1e-4, "com": [0, 0, 0], "inertia": [4e-6, 4e-6, 4e-6, 0, 0, 0]},
    )
    changes = light, ("robots.one.joints.joint_3.damping", 1.0), ("plan.costs", {"joint_acceleration": 1})
    damped = make_plan(reach(*changes), backend="interpreted")
    assert fastest_rate(damped.motion, np.zeros(6)) > 1e5
    assert not damped.verification.failures()
    # torques that are higher by 20 % turn the wrist by 20 % more: damping balances them
    z = damped.motion.z.copy()
    z[:, -1] *= 1.2
    alone, _ = replay_motion(dataclasses.replace(damped.motion, z=z), "interpreted")
    turned = alone[:, 6] - alone[0, 6]
    wanted = damped.motion.q[:: damped.motion.lobatto.points - 1, 6] - damped.motion.q[0, 6]
    np.testing.assert_allclose(turned, 1.2 * wanted, rtol=0.02, atol=1e-3)


def test_a_plan_goes_to_another_mesh_and_back(planned):
    motion = planned.motion
    finer = motion.on(motion.lobatto, 2 * motion.intervals)
    back = finer.on(motion.lobatto, motion.intervals)
    assert isinstance(back, Motion)
    np.testing.assert_allclose(back.z, motion.z, atol=1e-5)


def test_a_free_duration_with_weight_on_time_is_shorter_and_costs_less(reach, planned):
    cheap = make_plan(reach(FREE, ("plan.costs.time", 0.01)), backend="interpreted")
    assert 3 <= cheap.motion.duration_s < 6
    assert cheap.cost < planned.cost + 0.06
    assert cheap.verification.residual < 1e-6


def test_several_starts_are_the_same_each_time(reach):
    changes = [("plan.starts", 2), ("plan.intervals", 4), ("plan.tolerance", 1.0)]
    costs = [[one.cost for one in make_plan(reach(*changes), backend="interpreted").runs] for _ in range(2)]
    assert costs[0] == costs[1]
    assert len(costs[0]) == 2


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ([("plan", None)], "no such section"),
        ([("plan.goals.mate.tip", "one/tap")], "did you mean one/tip"),
        ([("plan.goals.mate.frame", "mate_3")], "did you mean mate_"),
        ([("target.base.position", [8, 8, 0])], "out of reach: at its nearest the goal is"),
        (
            [("robots.one.joints.joint_1.rate_deg", 30), ("plan.limits.joint_rate_deg", 10)],
            "the start violates",
        ),
        ([("plan.costs", {"torque": 0})], "nothing is to become small"),
        ([("plan.duration", {"lower": 4, "upper": 3})], "lower must not be above upper"),
    ],
)
def test_bad_input_is_refused_in_one_line(reach, changes, message):
    with pytest.raises(ScenarioError) as fault:
        make_plan(reach(*changes), backend="interpreted")
    assert message in str(fault.value)
    assert fault.value.exit_code == 2


def test_a_mesh_too_coarse_is_refused_by_its_replay(reach):
    changes = [("plan.intervals", 2), ("plan.max_intervals", 2), ("plan.tolerance", 1e-9)]
    with pytest.raises(NoPlanError, match="replayed, one/tip ends up to"):
        make_plan(reach(*changes), backend="interpreted")


def test_functions_are_compiled_only_where_so_much_is_solved_that_it_pays(reach, monkeypatch):
    asked = []
    monkeypatch.setattr(solvers, "build_instants", lambda _, backend: asked.append(backend))
    for motions in (1, 1000):
        solvers.PlanSolver.of(reach(), motions=motions)
    solvers.PlanSolver.of(reach(), "compiled")
    assert asked == ["interpreted", "auto", "compiled"]


def test_a_plan_of_nothing_to_do_costs_nothing_and_holds(reach):
    stay = {"stay": {"robot": "one", "joints": {"joint_1": {"angle_deg": 40}}}}
    found = make_plan(reach(("plan.goals", stay), ("plan.intervals", 4)), backend="interpreted")
    assert found.cost < 1e-12
    assert not found.verification.failures()
