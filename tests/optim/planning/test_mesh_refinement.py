"""Meshes that are refined where a motion is wrong, and nowhere else."""

import dataclasses

import numpy as np
import pytest

from optim.planning.formulation.formulate import formulate
from optim.planning.search.make_plan import make_plan
from optim.planning.search.plan_solver import PlanSolver
from optim.planning.search.solve_request import solve_request
from optim.planning.solver.ipopt import solve
from optim.planning.transcription.collocation_program import CollocationProgram
from optim.planning.transcription.instant_functions import build_instants
from optim.planning.transcription.lobatto import Lobatto
from optim.planning.transcription.mesh import Mesh
from optim.planning.transcription.mesh_transfer import transfer_remaining
from optim.planning.transcription.motion import PhasedMotion
from optim.planning.verification.mesh_refinement import local_errors, refined_meshes
from optim.planning.verification.verify import VerificationResult

UNEVEN = Mesh((0.0, 0.1, 0.25, 0.3, 0.7, 1.0))


def test_a_mesh_finds_the_interval_of_each_part_and_is_split():
    intervals, places = UNEVEN.located(np.array([0.0, 0.1, 0.5, 1.0]))
    assert intervals.tolist() == [0, 1, 3, 4]
    np.testing.assert_allclose(places, [0, 0, 0.5, 1])
    split = UNEVEN.split([1, 3, 1, 1, 2])
    assert split.intervals == 8
    np.testing.assert_allclose(split.widths, [0.1, 0.05, 0.05, 0.05, 0.05, 0.4, 0.15, 0.15])
    assert Mesh.of(4).knots == (0, 0.25, 0.5, 0.75, 1)


@pytest.mark.parametrize("order", [4, 6, 8])
def test_quadrature_of_uneven_intervals_is_exact_for_polynomials(order):
    lobatto = Lobatto.of_order(order)
    times, weights = lobatto.times(UNEVEN, 1.0), lobatto.quadrature(UNEVEN)
    for power in range(order):
        assert weights @ times**power == pytest.approx(1 / (power + 1), abs=1e-14)


@pytest.fixture(scope="module")
def coarse(reach):
    """A motion on eight intervals that are too long at its end alone."""
    scene = reach(("plan.tolerance", 1e-6))
    problem, lobatto = formulate(scene), Lobatto.of_order(6)
    instants = build_instants(problem, "interpreted")
    solver = PlanSolver.of(scene, "interpreted")
    mesh = Mesh((0.0, 0.08, 0.16, 0.24, 0.32, 0.4, 0.48, 1.0))
    program = CollocationProgram(problem, instants, lobatto, mesh)
    motion = solver.motion(solver.request(), solve_request(solver, solver.request(refine=False))).on(
        lobatto, mesh
    )
    solution = solve(program, motion.unknowns)
    z, _ = program.split(solution.w)
    return program, solution, dataclasses.replace(motion, z=z)


def test_errors_stand_where_the_intervals_are_too_long(coarse):
    program, _, motion = coarse
    (errors,) = local_errors(PhasedMotion((motion,)), "interpreted")
    assert errors[-1] > 10 * errors[:-1].max()
    # the error of an interval falls by 2^p where it is halved
    halved = CollocationProgram(
        program.problem, program.instants, program.lobatto, motion.mesh.split([1] * 6 + [2])
    )
    found = solve(halved, motion.on(program.lobatto, halved.mesh).unknowns)
    z, _ = halved.split(found.w)
    (after,) = local_errors(
        PhasedMotion((dataclasses.replace(motion, mesh=halved.mesh, z=z),)), "interpreted"
    )
    assert after[-2:].sum() < errors[-1] / 2**4


def test_only_intervals_that_are_wrong_are_split(coarse):
    _, _, motion = coarse
    phased_motion = PhasedMotion((motion,))
    (errors,) = local_errors(phased_motion, "interpreted")
    seen = {"one/tip": float(errors.sum())}
    verification = VerificationResult(0.0, (), seen, seen, errors.sum() / 10)
    (mesh,) = refined_meshes(phased_motion, verification, 100, "interpreted")
    assert mesh.knots[:7] == motion.mesh.knots[:7]
    assert mesh.intervals > motion.intervals
    assert refined_meshes(phased_motion, verification, motion.intervals, "interpreted") is None


def test_intervals_where_a_limit_is_passed_are_split(coarse):
    _, _, motion = coarse
    problem = motion.problem
    torque = motion.problem.stage.z.numel() - 3  # of the first joint
    fine = np.abs(motion.at(motion.mesh, np.arange(50) / 50)[:, torque].reshape(-1, 50))
    upper = problem.upper.copy()
    upper[torque] = np.sort(fine.max(axis=1))[-2] * 0.99  # passed inside two intervals
    tight = dataclasses.replace(motion, problem=dataclasses.replace(problem, upper=upper, lower=-upper))
    good = VerificationResult(0.0, (), {}, {}, 1.0)
    (mesh,) = refined_meshes(PhasedMotion((tight,)), good, 100)
    passed = fine.max(axis=1) > upper[torque] * (1 + 1e-3)
    assert 1 <= passed.sum() <= 3
    assert mesh == motion.mesh.split((1 + passed).tolist())


def test_multipliers_go_to_a_mesh_that_is_split_in_places(coarse):
    program, solution, motion = coarse
    finer = CollocationProgram(
        program.problem, program.instants, program.lobatto, motion.mesh.split([1] * 6 + [3])
    )
    first = motion.on(program.lobatto, finer.mesh).unknowns
    without, warm = (
        solve(finer, first, scale=solution.scale),
        solve(finer, first, transfer_remaining(solution, program, finer)),
    )
    assert warm.converged
    assert warm.iterations < without.iterations
    np.testing.assert_allclose(warm.w, without.w, atol=1e-5)


def test_a_plan_is_refined_locally_and_kept_with_its_mesh(reach, tmp_path):
    changes = [("plan.intervals", 6), ("plan.tolerance", 1e-6)]
    found = make_plan(reach(*changes), backend="interpreted", folder=tmp_path)
    assert found.runs[0].intervals == 6
    assert found.verification.fine_enough
    widths = found.motion.mesh.widths
    assert widths.max() > 1.9 * widths.min()
    same = make_plan(reach(*changes), backend="interpreted", folder=tmp_path)
    assert same.motion.mesh == found.motion.mesh
    np.testing.assert_array_equal(same.motion.z, found.motion.z)
