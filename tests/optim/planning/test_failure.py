"""A search that finds no plan names the cause and what to try; each cause has a message of its own."""

import dataclasses

import numpy as np
import pytest
import scipy.sparse as sp

from optim.planning.formulation.formulate import formulate
from optim.planning.search.failure_messages import bad_guess_message, soft_rows
from optim.planning.search.make_plan import failure_message, make_plan
from optim.planning.search.plan_solver import PlanSolver
from optim.planning.search.solve_request import solve_request
from optim.planning.solver.elastic import ElasticProgram
from optim.planning.transcription.collocation_program import CollocationProgram
from optim.planning.transcription.instant_functions import build_instants
from optim.planning.transcription.lobatto import Lobatto
from optim.planning.transcription.phase_chain import PhaseChain
from spacerobot.common.errors import NoPlanError

QUICK = [("plan.intervals", 4), ("plan.tolerance", 1.0)]


def fault(scene):
    with pytest.raises(NoPlanError) as found:
        make_plan(scene, backend="interpreted")
    assert found.value.exit_code == 4
    assert found.value.where == "plan"
    return found.value.message


def test_what_is_infeasible_names_what_is_missed_and_the_limits_that_hold_it_back(reach):
    message = fault(reach(*QUICK, ("plan.limits.torque", 1e-3), ("plan.duration", 2)))
    assert message.startswith("no plan was found: infeasible, as far as can be seen from this first guess")
    missed, held = message.split("held back by")
    assert "mate: position" in missed
    assert "torque of one/joint_" in held
    assert "starts: 5" in held


def test_a_duration_that_is_too_short_is_named(reach):
    message = fault(reach(*QUICK, ("plan.limits.joint_rate_deg", 20), ("plan.duration", 1)))
    assert "rate of one/joint_" in message
    assert "the duration (at most 1 s)" in message


def test_iterations_exhausted(reach):
    message = fault(reach(*QUICK, ("plan.iterations", 2)))
    assert "iterations exhausted: 2 of `plan.iterations` were not enough" in message
    assert "violated most: " in message
    assert "infeasible" not in message


def test_time_exhausted_and_not_kept(reach, tmp_path):
    scene = reach(*QUICK, ("plan.time_limit", 1e-9))
    with pytest.raises(NoPlanError, match=r"time exhausted: `plan.time_limit`, 1e-09 s of processor time"):
        make_plan(scene, backend="interpreted", folder=tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_time_limit_that_is_not_reached_changes_nothing(reach):
    scenes = reach(*QUICK), reach(*QUICK, ("plan.time_limit", 1e5))
    plans = [make_plan(scene, backend="interpreted") for scene in scenes]
    np.testing.assert_array_equal(*(plan.motion.z for plan in plans))


def test_a_bad_start_names_what_is_no_number(reach):
    solver = PlanSolver.of(reach(*QUICK), "interpreted")
    row = solver.problem.goal[0]
    bad = (dataclasses.replace(row, value=row.value / 0), *solver.problem.goal[1:])
    problem = dataclasses.replace(solver.problem, goal=bad)
    wrong = solver.with_first(problem=problem, instants=build_instants(problem, "interpreted"))
    result = solve_request(wrong, wrong.request())
    assert result.solution is None
    message = failure_message(result)
    assert "bad start: the first guess cannot be evaluated, for these are no numbers: " in message
    assert "mate: position x" in message
    assert "starts: 5" in message
    assert "found: the solver ended with" not in message
    unexplained = failure_message(dataclasses.replace(result, cause=""))
    assert unexplained.startswith("no plan was found: ")
    assert not unexplained.endswith(": ")


def test_a_mesh_that_may_not_be_finer_is_named(reach):
    message = fault(reach(("plan.intervals", 2), ("plan.max_intervals", 2), ("plan.tolerance", 1e-9)))
    assert "the plan is refused: " in message
    assert "raise `max_intervals`, 2" in message


def test_derivatives_of_the_elastic_program_equal_central_differences(reach):
    problem = formulate(
        reach(("plan.approach_cones.mate", {"tip": "one/tip", "frame": "mate_1", "half_angle_deg": 20}))
    )
    one = CollocationProgram(problem, build_instants(problem, "interpreted"), Lobatto.of_order(4), 2)
    program = PhaseChain([one], [])
    elastic, rng = ElasticProgram(program, soft_rows(program), 0.5), np.random.default_rng(0)
    w, along = 0.3 * rng.normal(size=elastic.size), rng.normal(size=elastic.size)
    w[program.size - 1] = 5.0
    multipliers, step = rng.normal(size=elastic.rows), 1e-6

    def jacobian(at):
        pattern = elastic.jacobian_pattern
        return sp.csc_matrix((elastic.jacobian(at), pattern.indices, pattern.indptr), shape=pattern.shape)

    def lagrangian(at):
        return 0.7 * elastic.gradient(at) + jacobian(at).T @ multipliers

    def difference(function):
        return (function(w + step * along) - function(w - step * along)) / (2 * step)

    np.testing.assert_allclose(elastic.gradient(w) @ along, difference(elastic.objective), rtol=1e-6)
    np.testing.assert_allclose(jacobian(w) @ along, difference(elastic.constraints), rtol=1e-6, atol=1e-6)
    pattern = elastic.hessian_pattern
    upper = sp.csc_matrix(
        (elastic.hessian(w, 0.7, multipliers), pattern.indices, pattern.indptr), shape=pattern.shape
    )
    whole = upper + sp.triu(upper, 1).T
    np.testing.assert_allclose(whole @ along, difference(lagrangian), rtol=1e-5, atol=1e-5)
    assert bad_guess_message(program, w[: program.size]) is None


def test_the_elastic_program_begins_feasible_in_what_is_soft(reach):
    problem = formulate(reach())
    one = CollocationProgram(problem, build_instants(problem, "interpreted"), Lobatto.of_order(4), 2)
    program = PhaseChain([one], [])
    soft = soft_rows(program)
    elastic, rng = ElasticProgram(program, soft, 1.0), np.random.default_rng(1)
    w = 0.3 * rng.normal(size=program.size)
    g, (least, greatest) = elastic.constraints(elastic.started(w)), elastic.limits()
    assert (np.maximum(least - g, g - greatest)[soft] < 1e-12).all()
    assert len(soft) == len(problem.goal)
