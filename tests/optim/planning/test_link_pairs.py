"""Links that touch nothing on purpose are kept apart by plans without being named."""

import dataclasses

import numpy as np
import pytest
from scipy import sparse

from optim.planning.formulation.formulate import formulate_phases
from optim.planning.formulation.link_pairs import Collision, collisions, link_pairs, unseen_steps
from optim.planning.mpc.horizon import Horizon
from optim.planning.output.plan_folder import summary
from optim.planning.search.make_plan import make_plan
from optim.planning.search.plan_solver import PlanSolver
from optim.planning.studies.pareto_front import FrontRequest, make_front
from optim.planning.transcription.instant_functions import build_instants
from optim.planning.transcription.lobatto import Lobatto
from optim.planning.transcription.mesh import Mesh
from optim.planning.transcription.motion import Motion, PhasedMotion
from optim.planning.verification.verify import FINER, course_collisions
from spacerobot.cli.commands.check import command as check

LOOK = {"look": {"tip": "one/tip", "position": [1.2, 0.15, 0]}}
CROSSED = [
    ("plan.goals", LOOK),
    ("plan.costs", {"torque": 0.01, "joint_acceleration": 1}),
    ("plan.tolerance", 1.0),
    ("plan.intervals", 8),
    ("robots.one.joints.joint_2.angle_deg", -20),
    ("robots.one.joints.joint_3.angle_deg", -20),
    ("target.base", {"joint": "planar", "position": [0.75, 0.2, 0]}),
]
"""The shortest way of the last link ends inside the target."""


def names(scene):
    return {(pair.first.removeprefix("one/"), pair.second.removeprefix("one/")) for pair in link_pairs(scene)}


def test_a_link_that_would_enter_the_target_stays_outside(reach):
    scene = reach(*CROSSED)
    without = make_plan(reach(*CROSSED, ("plan.collision_avoidance", False)), backend="interpreted")
    (entered,) = course_collisions(without.phased_motion, link_pairs(scene))
    assert (entered.first, entered.second) == ("one/link_3", "target/body")
    assert entered.depth_m > 0.02
    planned = make_plan(scene, backend="interpreted")
    assert course_collisions(planned.phased_motion, link_pairs(scene)) == []
    assert planned.cost > without.cost
    assert summary(planned)["collision_avoidance"] == {
        "pairs": len(link_pairs(scene)),
        "kept_apart": [["one/link_3", "target/body"]],
    }
    cold, warm = planned.runs
    assert cold.cost == pytest.approx(without.cost)
    assert warm.iterations < 30


def test_links_that_collide_on_a_coarse_mesh_are_kept_apart_before_a_finer_one_is_begun(reach):
    planned = make_plan(reach(*CROSSED, ("plan.intervals", 16)), backend="interpreted")
    assert [run.intervals for run in planned.runs] == [4, 4, 16]
    assert planned.kept_apart == (("one/link_3", "target/body"),)
    assert course_collisions(planned.phased_motion, link_pairs(planned.scene)) == []


@pytest.mark.parametrize(
    ("changes", "there", "missing"),
    [
        # links that a joint joins are left out, and the tip's link with that of its mating frame
        ([], ("base", "link_2"), ("link_1", "link_2")),
        ([], ("link_2", "target/body"), ("link_3", "target/body")),
        # a target that no link reaches, and one that comes nearer
        (
            [("target.base.position.1", 9.0), ("plan.goals", LOOK)],
            ("base", "link_3"),
            ("link_3", "target/body"),
        ),
        (
            [("target.base.position.1", 9.0), ("target.base.velocity.1", -1.5), ("plan.goals", LOOK)],
            ("link_3", "target/body"),
            None,
        ),
        # links that begin inside each other
        ([("robots.one.joints.joint_2.angle_deg", 170), ("plan.goals", LOOK)], None, ("base", "link_2")),
    ],
)
def test_pairs_that_may_come_near(reach, changes, there, missing):
    found = names(reach(*changes))
    assert there is None or there in found
    assert missing not in found
    assert names(reach(*changes, ("plan.collision_avoidance", False))) == set()


def test_the_depth_of_an_overlap_is_the_deepest_of_the_motion(reach):
    scene = reach(*CROSSED)
    pairs, path = link_pairs(scene), np.tile(scene.q, (11, 1))
    joint = scene.model.joints[scene.model.getJointId("one/joint_1")].idx_q
    path[:, joint] -= np.linspace(0.0, 0.6, 11)
    found = collisions(pairs, scene.model, path, np.arange(11.0))
    assert ("one/link_2", "target/body") in {(one.first, one.second) for one in found}
    assert [one.depth_m for one in found] == sorted((one.depth_m for one in found), reverse=True)


def test_links_that_pass_each_other_between_two_instants_are_seen(reach):
    """The last link swings past the target in a step: apart before it and behind it."""
    scene = reach(*CROSSED)
    model, pairs = scene.model, link_pairs(scene)
    joint = model.joints[model.getJointId("one/joint_1")]
    duration, turn = 10.0, 2 * np.pi
    time = np.linspace(0, duration, 7)
    path, rates = np.tile(scene.q, (7, 1)), np.zeros((7, model.nv))
    path[:, joint.idx_q] += turn * time / duration
    rates[:, joint.idx_v] = turn / duration
    coarse = {one.second for one in collisions(pairs, model, path, time)}
    steps = unseen_steps(pairs, model, path, rates, time, 1e-3)
    fine = np.tile(scene.q, (601, 1))
    fine[:, joint.idx_q] += np.linspace(0, turn, 601)
    passed = collisions(pairs, model, fine, np.linspace(0, duration, 601))
    assert "target/body" not in coarse
    entered = [one for one in passed if one.second == "target/body"]
    assert entered
    assert {int(one.time_s / duration * 6) for one in entered} <= set(steps.tolist())
    still = unseen_steps(pairs, model, path[:2], 0 * rates[:2], time[:2], 1e-3)
    assert still.size == 0
    (phase,) = formulate_phases(scene)
    stage, lobatto, mesh = phase.problem.stage, Lobatto.of_order(phase.plan.order), Mesh.of(1)
    turning = duration * FINER / 6  # the same angles at the instants of the check
    times = lobatto.times(mesh, turning)
    z = np.zeros((len(times), stage.z.numel()))
    z[:, : model.nq], z[:, model.nq : model.nq + model.nv] = scene.q, rates[0]
    z[:, joint.idx_q] += turn / duration * times
    course = PhasedMotion((Motion(phase.problem, lobatto, mesh, turning, z),))
    assert "target/body" not in {one.second for one in course_collisions(course, pairs)}
    assert "target/body" in {one.second for one in course_collisions(course, pairs, between=True)}


def test_check_reports_them(reach, capsys):
    check(str(reach().source))
    printed = " ".join(capsys.readouterr().out.split())
    assert f"plans keep {len(link_pairs(reach()))} pairs of links apart" in printed


def test_added_rows_have_the_derivatives_of_the_whole_problem(reach):
    """Only they are differentiated, and put between the path and the cost of what was there."""
    solver = PlanSolver.of(reach(*CROSSED), "interpreted")
    apart = [Collision("one/link_3", "target/body", 0.1, 1.0, (0,))]
    added = solver.keeping_apart(apart)
    assert len(added.problem.path) == len(solver.problem.path) + 1
    whole, rng = build_instants(added.problem, "interpreted"), np.random.default_rng(0)
    z = rng.normal(size=(added.problem.stage.z.numel(), 3))
    rows = whole.call("values", z).shape[0]
    np.testing.assert_allclose(added.instants.call("values", z), whole.call("values", z), rtol=1e-12)
    weights = rng.normal(size=(rows, 3))
    for name, others, shape in (("jacobian", (), (rows, len(z))), ("hessian", (weights,), (len(z), len(z)))):
        found = [
            sparse.coo_matrix((one.call(name, z, *others)[:, 1], getattr(one, name)), shape).toarray()
            for one in (added.instants, whole)
        ]
        assert np.abs(found[1]).max() > 0.1
        np.testing.assert_allclose(*found, atol=1e-9 * np.abs(found[1]).max())
    again = solver.keeping_apart(apart)
    assert again.instants is added.instants
    assert added.keeping_apart(apart) is added


def test_pairs_that_are_added_together_or_in_turn_make_the_same_problem(reach):
    """Each of the two keeps its own functions, whichever was made first."""
    solver = PlanSolver.of(reach(*CROSSED), "interpreted")
    apart = [Collision(f"one/link_{k}", "target/body", 0.1, 1.0, (0,)) for k in (2, 3)]
    one_by_one = solver.keeping_apart(apart[:1]).keeping_apart(apart[1:])
    at_once = solver.keeping_apart(apart)
    z = np.random.default_rng(0).normal(size=(at_once.problem.stage.z.numel(), 2))
    for own in (one_by_one, at_once):
        assert len(own.problem.path) == len(solver.problem.path) + 2
        whole = build_instants(own.problem, "interpreted")
        np.testing.assert_allclose(own.instants.call("values", z), whole.call("values", z), rtol=1e-12)


def test_points_of_a_front_are_kept_apart(reach):
    scene = reach(*CROSSED, ("plan.costs.time", 0.01), ("plan.duration", {"lower": 5, "upper": 7}))
    front = make_front(scene, FrontRequest(("time", "torque"), 2), backend="interpreted")
    for point in front.points:
        assert course_collisions(point.plan.phased_motion, link_pairs(scene)) == []
        assert point.plan.kept_apart == (("one/link_3", "target/body"),)
        assert point.plan.scene.scenario.plan.keep_out


def test_plans_of_mpc_are_kept_apart(reach):
    """Also where the plan before it, from which it begins, led through the target."""
    solver = PlanSolver.of(reach(*CROSSED), "interpreted")
    seen = np.concatenate([solver.scene.q, solver.scene.v])
    first = Horizon.of(solver, seen, 1.0)
    assert course_collisions(PhasedMotion((first.motion,)), solver.pairs) == []
    through = Horizon.of(dataclasses.replace(solver, pairs=()), seen, 1.0)
    assert course_collisions(PhasedMotion((through.motion,)), solver.pairs)
    through.solver = solver
    q, v, *_ = through.at(np.array([0.75]))
    through.replan(0.75, np.concatenate([q[0], v[0]]), 200)
    assert (through.missed, through.begin_s) == (0, 0.75)
    assert course_collisions(PhasedMotion((through.motion,)), solver.pairs) == []
