"""Searches that go on from a solution and its multipliers."""

import dataclasses

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import sparse
from scipy.sparse.csgraph import structural_rank
from typer.testing import CliRunner

from optim.planning.formulation.formulate import formulate
from optim.planning.output.plan_folder import write
from optim.planning.search import solve_request as searching
from optim.planning.search.make_plan import make_plan
from optim.planning.solver import ipopt as solving
from optim.planning.solver.ipopt import solve
from optim.planning.solver.presolve import PresolvedProgram, determined
from optim.planning.transcription.collocation_program import CollocationProgram
from optim.planning.transcription.initial_guess import initial_guess
from optim.planning.transcription.instant_functions import build_instants
from optim.planning.transcription.lobatto import Lobatto
from optim.planning.transcription.mesh_transfer import solve_from, transfer_remaining
from optim.planning.transcription.motion import Motion
from optim.planning.verification.verify import first_order_residual
from spacerobot.cli.app import app
from spacerobot.common.errors import ScenarioError


@pytest.fixture(scope="module")
def cold(reach):
    """A program whose torque limit is active, and its solution."""
    problem = formulate(reach(("plan.limits.torque", 0.13)))
    lobatto = Lobatto.of_order(6)
    program = CollocationProgram(problem, build_instants(problem, "interpreted"), lobatto, 4)
    first = initial_guess(problem, lobatto, 4).unknowns
    return program, solve(program, first, scale=program.objective(first))


def test_a_free_target_is_no_unknown_and_all_multipliers_are_found(cold):
    program, solution = cold
    left = PresolvedProgram(program, solution.w)
    known = np.setdiff1d(np.arange(program.size), left.free)
    assert program.size - left.size == program.rows - left.rows == known.size
    of_target = [k for k in range(program.nz) if (known % program.nz == k).sum() >= program.points - 1]
    assert len(of_target) == 4 + 3 + 3
    assert first_order_residual(program, solution, solution.scale) < 1e-7
    dropped = np.setdiff1d(np.arange(program.rows), left.held)
    assert np.abs(solution.multipliers[dropped]).max() > 1e-3
    np.testing.assert_allclose(left.unknowns(solution.w[left.free]), solution.w, atol=1e-12)


@pytest.mark.parametrize(
    ("rows", "square"),
    [
        (["x", "xx", "__xx"], [0, 1]),  # the third equation has two unknowns of its own
        (["x", "x", "_x"], [1]),  # two equations for one unknown: neither is taken out
        (["x", "x", "xx"], []),  # the third equation needs what the first two contradict each other about
        (["xx", "xx", "__x"], [0, 1, 2]),
        (["xx_", "_xx"], []),
    ],
)
def test_equations_determine_unknowns(rows, square):
    pattern = sparse.csc_matrix([[float(c == "x") for c in row.ljust(4, "_")] for row in rows])
    found, unknowns = determined(pattern, np.ones(len(rows), bool), np.ones(4, bool))
    assert sorted(unknowns) == square
    assert len(found) == len(square)


@settings(deadline=None, derandomize=True)
@given(st.data())
def test_equations_determine_what_the_structural_rank_says(data):
    """A row or column may be left unmatched where the rank is the same without it; the rest is square."""
    rows, columns = data.draw(st.integers(1, 7)), data.draw(st.integers(1, 7))
    dense = data.draw(arrays(float, (rows, columns), elements=st.sampled_from([0.0, 0.0, 1.0])))

    def spare(matrix):
        rank = structural_rank(sparse.csr_matrix(matrix))
        without = (np.delete(matrix, k, axis=0) for k in range(len(matrix)))
        return np.array([structural_rank(sparse.csr_matrix(one)) == rank for one in without])

    unknown = spare(dense.T) | (dense[spare(dense)] > 0).any(axis=0)
    while True:  # an equation with an unknown that is not determined determines none
        kept = ~(dense[:, unknown] > 0).any(axis=1) & ~spare(dense)
        lost = ~(dense[kept] > 0).any(axis=0)
        if (lost <= unknown).all():
            break
        unknown |= lost
    equations, unknowns = determined(sparse.csc_matrix(dense), np.ones(rows, bool), np.ones(columns, bool))
    assert set(unknowns) == set(np.flatnonzero(~unknown))
    assert set(equations) == set(np.flatnonzero(kept))
    assert dense[equations, unknowns].all()


def test_a_solution_is_found_again_at_once(cold):
    program, solution = cold
    assert solution.converged
    assert np.abs(solution.bound_multipliers).max() > 1e-3
    again = solve(program, solution.w, solution)
    assert again.converged
    assert again.iterations <= 3
    assert again.scale == solution.scale
    np.testing.assert_allclose(again.w, solution.w, atol=1e-6)
    np.testing.assert_allclose(again.multipliers, solution.multipliers, atol=1e-5)


def test_another_start_takes_fewer_iterations_with_multipliers(cold):
    program, solution = cold
    start = program.problem.fixed.copy()
    start[-program.nv :] += 1e-4
    moved = CollocationProgram(
        dataclasses.replace(program.problem, fixed=start),
        program.instants,
        program.lobatto,
        program.intervals,
    )
    without = solve(moved, solution.w, scale=solution.scale)
    warm = solve(moved, solution.w, solution)
    assert warm.converged
    assert warm.iterations < without.iterations
    assert moved.objective(warm.w) == pytest.approx(moved.objective(without.w), rel=1e-6)


def test_multipliers_go_to_a_finer_mesh(cold):
    program, solution = cold
    same = transfer_remaining(solution, program, program)
    np.testing.assert_allclose(same.multipliers, solution.multipliers, atol=1e-9)
    z, duration = program.split(solution.w)
    motion = Motion(program.problem, program.lobatto, program.mesh, duration, z)
    finer = CollocationProgram(program.problem, program.instants, program.lobatto, 2 * program.intervals)
    first = motion.on(program.lobatto, finer.mesh).unknowns
    without = solve(finer, first, scale=solution.scale)
    warm = solve(finer, first, transfer_remaining(solution, program, finer))
    assert warm.converged
    assert warm.iterations < without.iterations
    np.testing.assert_allclose(warm.w, without.w, atol=1e-6)


def test_a_search_that_leads_nowhere_begins_anew(cold, monkeypatch):
    program, solution = cold
    monkeypatch.setattr(solving, "PATIENCE", 1)
    wrong = dataclasses.replace(solution, multipliers=1e3 * np.ones_like(solution.multipliers))
    first = initial_guess(program.problem, program.lobatto, program.intervals).unknowns
    found = solve(program, first, wrong)
    assert found.converged
    assert found.iterations > 1
    assert program.objective(found.w) == pytest.approx(program.objective(solution.w), rel=1e-6)


def test_a_search_that_begins_on_a_coarse_mesh_ends_at_the_same_motion(cold):
    program, solution = cold
    motion = initial_guess(program.problem, program.lobatto, 2)
    _, found = solve_from(motion, program, scale=solution.scale)
    assert found.converged
    assert found.iterations < solution.iterations
    np.testing.assert_allclose(found.w, solution.w, atol=1e-6)


def test_a_fine_first_mesh_is_solved_from_a_coarse_one(reach, monkeypatch):
    changes = [("plan.intervals", 8), ("plan.tolerance", 1.0)]
    (direct,) = make_plan(reach(*changes), backend="interpreted").runs
    monkeypatch.setattr(searching, "MANY", 8)
    coarse, fine = make_plan(reach(*changes), backend="interpreted").runs
    assert (coarse.intervals, fine.intervals) == (8 // searching.COARSER, 8)
    assert fine.cost == pytest.approx(direct.cost, rel=1e-6)
    assert fine.iterations < direct.iterations


LIMITED = ("plan.limits.torque", 0.13)


@pytest.fixture(scope="module")
def stored(reach, tmp_path_factory):
    """A plan, and its folder."""
    folder = tmp_path_factory.mktemp("stored")
    planned = make_plan(reach(LIMITED, ("plan.tolerance", 1e-3)), backend="interpreted")
    write(planned, folder)
    return planned, folder


@pytest.mark.parametrize(
    ("changes", "file", "most"),
    [
        ([], "", 2),
        ([], "plan.nc", 2),
        ([], "bare.nc", 9),
        ([("plan.order", 4)], "", 8),  # another mesh: interpolated, without multipliers
        ([("plan.intervals", 24)], "", 9),
    ],
)
def test_a_warm_start_from_a_file_takes_fewer_iterations_to_the_same_plan(reach, stored, changes, file, most):
    _, folder = stored
    with xr.open_dataset(folder / "plan.nc") as plan:
        plan.load().drop_vars(["multiplier", "bound_multiplier"]).to_netcdf(folder / "bare.nc")
    scene = reach(LIMITED, ("plan.tolerance", 1e-3), *changes)
    cold = make_plan(scene, backend="interpreted")
    warm = make_plan(scene, backend="interpreted", warm_start=folder / file)
    assert warm.cost == pytest.approx(cold.cost, rel=1e-6)
    assert warm.runs[0].iterations <= most < sum(run.iterations for run in cold.runs)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ([("robots.one.joints.joint_3.locked", True)], "its joints differ, one/joint_3 only in the file"),
        ([("target", None)], "its bodies differ, target only in the file"),
    ],
)
def test_a_plan_of_another_scene_is_refused(reach, stored, changes, told):
    changes += [("plan.goals", {"look": {"tip": "one/tip", "position": [0.5, 0.5, 0]}})]
    with pytest.raises(ScenarioError, match=f"a plan of another scene: {told}"):
        make_plan(reach(*changes), backend="interpreted", warm_start=stored[1])


def test_a_file_that_is_no_plan_is_refused_in_one_line(reach, tmp_path):
    file = tmp_path / "other.nc"
    xr.Dataset({"q": 1.0}).to_netcdf(file)
    for path, told in ((file, "not a plan: no time"), (tmp_path / "none.nc", "no plan at")):
        given = ["plan", str(reach().source), "--from", str(path)]
        found = CliRunner().invoke(app, given)
        assert isinstance(found.exception, ScenarioError)
        assert told in str(found.exception)
