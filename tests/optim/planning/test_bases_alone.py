"""Robots without joints: turns from rest to rest, and wheels that take what a body turns with."""

import dataclasses
import json

import numpy as np
import pinocchio as pin
import pytest
import yaml
from scipy import sparse
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from optim.planning.output.plan_folder import dataset, read, summary
from optim.planning.search.make_plan import make_plan
from optim.planning.search.plan_solver import PlanSolver, SolveResult
from optim.planning.search.solve_request import solve_request
from optim.planning.solver.ipopt import solve
from optim.planning.transcription.drive_jumps import find_jumps, split_at_jumps
from optim.planning.transcription.initial_guess import initial_guess
from optim.planning.transcription.lobatto import Lobatto
from optim.planning.transcription.motion import PhasedMotion
from optim.planning.verification.mesh_refinement import local_errors, refined_meshes
from optim.planning.verification.replay import tip_errors
from optim.planning.verification.second_order_conditions import descent_direction
from optim.planning.verification.verify import RELATIVE, VerificationResult, verify
from spacerobot.api.results import PlanResult
from spacerobot.cli.app import app
from spacerobot.cli.output import show
from spacerobot.common.errors import ScenarioError
from spacerobot.result import Result
from spacerobot.scene import load_scene
from viz.figures.plan import base_motion, plan_bases

UNIT = """<robot name="unit"><link name="body"><inertial><mass value="10"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="sensor"/>
<joint name="mount" type="fixed"><parent link="body"/><child link="sensor"/></joint></robot>"""
TURN = {
    "name": "turn",
    "robots": {"sat": {"urdf": "unit.urdf", "base": {"joint": "free_flyer"}, "tips": {"sensor": {}}}},
    "plan": {
        "duration": 4,
        "goals": {"turn": {"attitude": "sat", "rotation_deg": [0, 0, 120]}, "rest": {"still": "sat"}},
        "costs": {"base_wrench": 1},
        "limits": {"base_torque": 2},
        "intervals": 4,
    },
}
WHEELS = {"kind": "reaction_wheels", "pyramid": {"wheels": 4}, "inertia": 0.01, "torque_limit": 0.05}
DETUMBLED = [
    ("robots.sat.base.spin_deg", [3, -2, 1]),
    ("robots.sat.actuators", {"wheels": WHEELS | {"speed_limit": 600}}),
    ("plan.goals", {"rest": {"still": "sat"}}),
    ("plan.costs", {"base_wrench": 1}),
    ("plan.limits", {}),
    ("plan.duration", 2),
]


@pytest.fixture(scope="module")
def turning(tmp_path_factory):
    """Function of changes that gives the scene."""
    folder = tmp_path_factory.mktemp("turn")
    (folder / "unit.urdf").write_text(UNIT)
    (folder / "turn.yaml").write_text(yaml.safe_dump(TURN))
    return lambda *changes: load_scene(folder / "turn.yaml", list(changes))


def test_least_energy_of_a_turn_about_a_principal_axis(turning):
    """12 J^2 theta^2 / T^3, along the eigenaxis."""
    found = make_plan(turning(), backend="interpreted")
    assert found.cost == pytest.approx(12 * np.radians(120) ** 2 / 4**3, rel=1e-4)
    ended = Rotation.from_quat(found.motion.q[-1, 3:]).as_rotvec(degrees=True)
    np.testing.assert_allclose(ended, [0, 0, 120], atol=1e-4)


def test_a_base_without_joints_is_replayed_by_its_attitude_also_where_it_has_a_tip(turning):
    motion = make_plan(turning(), backend="interpreted").motion
    states = np.repeat(np.concatenate([motion.q[0], motion.v[0]])[None], motion.intervals + 1, axis=0)
    assert tip_errors(motion, states)["sat"][-1] == pytest.approx(np.radians(120), rel=1e-6)


@pytest.mark.parametrize("changes", [[], DETUMBLED])
def test_plans_of_bases_alone_are_written_drawn_flown_and_played(turning, tmp_path, changes):
    named = [f"--set={path}={json.dumps(value)}" for path, value in changes]
    scenario, plan, flown = turning().source, tmp_path / "plan", tmp_path / "flown"
    run = CliRunner().invoke

    def ran(*arguments):
        found = run(app, [str(one) for one in arguments])
        assert found.exit_code == 0, found.output
        return found.output

    ran("plan", scenario, *named, "--out", plan, "--backend", "interpreted")
    assert (plan / "figures" / "plan_bases.png").is_file()
    ran("run", plan / "followed.yaml", "--out", flown, "--backend", "interpreted")
    ran("figures", plan, "--compare", flown)
    ran("animate", flown, plan, "--html", tmp_path / "page.html")
    stored, _ = read(plan)
    assert stored.sizes["joint"] == 0
    ends = {}
    for name, data in (("planned", stored), ("flown", Result.load(flown).data)):
        ends[name] = base_motion(data, "sat")[1][-1]
        np.testing.assert_allclose(data.v.values[-1], 0, atol=1e-5)
    np.testing.assert_allclose(ends["flown"], ends["planned"], atol=1e-5)


def test_plans_name_the_plugins_that_they_were_made_with(turning, tmp_path, monkeypatch):
    made = make_plan(turning(), backend="interpreted")
    assert "plugins" not in summary(made)
    monkeypatch.setattr("spacerobot.elements.core.registry._PLUGINS", {tmp_path / "mine.py": b""})
    assert [record["file"] for record in summary(made)["plugins"]] == [str(tmp_path / "mine.py")]


def test_a_turn_is_drawn_beyond_half_a_turn_with_the_limits_it_reaches(turning):
    plan = dataset(make_plan(turning(), backend="interpreted"))
    angles = np.linspace(0, 500, len(plan.time))
    plan.q[:, 3:] = Rotation.from_rotvec(np.outer(angles, [0, 0, 1]), degrees=True).as_quat()
    np.testing.assert_allclose(np.degrees(base_motion(plan, "sat")[1][:, 2]), angles, atol=1e-9)
    greatest = float(np.abs(plan.base_wrench).max())
    plan.base_wrench_limit[:] = [-greatest, greatest]
    torque = plan_bases(plan).axes[2]
    marked = [curve.get_ydata() for curve in torque.lines if curve.get_marker() == "s"]
    np.testing.assert_allclose(np.abs(np.concatenate(marked)), greatest)


def test_an_attitude_of_a_base_that_is_fixed_is_refused(tmp_path):
    (tmp_path / "unit.urdf").write_text(UNIT)
    robots = {"sat": {"urdf": "unit.urdf", "base": {"joint": "fixed"}}}
    target = {"urdf": "unit.urdf", "base": {"joint": "free_flyer", "position": [1, 0, 0]}}
    plan = TURN["plan"] | {"goals": {"turn": TURN["plan"]["goals"]["turn"]}}
    (tmp_path / "fixed.yaml").write_text(yaml.safe_dump({"robots": robots, "target": target, "plan": plan}))
    with pytest.raises(ScenarioError, match="so its attitude never changes; give it `joint: free_flyer`"):
        PlanSolver.of(load_scene(tmp_path / "fixed.yaml"), "interpreted")


FASTER = [
    ("plan.goals.turn.rotation_deg", [0, 0, 180]),
    ("plan.costs", {"time": 1, "base_wrench": 0.03}),
    ("plan.duration", {"lower": 1, "upper": 10}),
    ("plan.limits.base_torque", 1),
    ("plan.intervals", 12),
    ("plan.starts", 4),
]
"""By half a turn, with torques that end at their limits: the eigenaxis turn, 3.6492, is a saddle point."""


@pytest.mark.parametrize("start", [1, 2, 3])
def test_further_starts_turn_about_other_axes_than_the_eigenaxis(turning, start):
    solver = PlanSolver.of(turning(*FASTER), "interpreted")
    assert solve_request(solver, solver.request(start=start, refine=False)).cost == pytest.approx(
        3.5050, abs=2e-4
    )


@pytest.mark.parametrize("flat", [True, False])
def test_guesses_of_bases_begin_as_given_and_wind_to_their_attitude_in_three_ways(turning, flat):
    turn = 120.0
    base = {"joint": "planar" if flat else "free_flyer", "spin_deg": [0, 0, 5], "velocity": [0.1, 0.2, 0]}
    goal = {"tip": "sat/sensor", "position": [1, 2, 0], "rotation_deg": [0, 0, turn]}
    changes = [("robots.sat.base", base), ("plan.goals", {"turn": goal}), ("plan.limits.base_force", 1)]
    problem = PlanSolver.of(turning(*changes), "interpreted").problem
    ends, lobatto = [], Lobatto.of_order(6)
    for start in (1, 2, 3):
        motion = initial_guess(problem, lobatto, 40, np.random.default_rng(start), start)
        np.testing.assert_allclose(motion.z[0, : problem.fixed.size], problem.fixed)
        q, v, a = motion.q, motion.v, motion.a
        np.testing.assert_allclose(q[-1, :2], [1, 2], atol=1e-5)
        np.testing.assert_allclose(v[-1], 0, atol=1e-4)
        model, step = problem.stage.scene.model, 4 / 40
        for n in range(40):  # velocities and accelerations are those of the configurations
            inside = slice(3 * n, 3 * n + 4)
            moved = pin.difference(model, q[3 * n], q[3 * n + 3])
            np.testing.assert_allclose(step * lobatto.weights @ v[inside], moved, atol=5e-2 * step)
            np.testing.assert_allclose(step * lobatto.weights @ a[inside], v[3 * n + 3] - v[3 * n], atol=1e-3)
        ends.append(np.degrees(np.unwrap(np.arctan2(q[:, 3], q[:, 2]))[-1]) if flat else q[-1, 6])
    # a unit quaternion and its negative are one attitude: which of them tells the winding
    half = np.cos(np.radians(turn / 2))
    np.testing.assert_allclose(
        ends, [turn - 360, turn + 360, turn] if flat else [-half, -half, half], atol=1e-3
    )


def test_several_starts_find_the_better_winding_of_a_body_that_turns_already(turning):
    """Of theta'' = u from a rate w to rest by an angle A: 12 A^2 / T^3 - 12 A w / T^2 + 4 w^2 / T."""
    spin, turn, duration = np.radians(150), np.radians(-30), 4.0
    costs = {
        winding: 12 * angle**2 / duration**3 - 12 * angle * spin / duration**2 + 4 * spin**2 / duration
        for winding in range(-2, 4)
        for angle in [turn + 2 * np.pi * winding]
    }
    assert min(costs, key=costs.__getitem__) == 1
    changes = [
        ("robots.sat.base", {"joint": "planar", "spin_deg": [0, 0, 150]}),
        ("plan.goals.turn.rotation_deg", [0, 0, -30]),
        ("plan.limits.base_torque", 5),
    ]
    one, four = (make_plan(turning(*changes, ("plan.starts", n)), backend="interpreted") for n in (1, 4))
    assert one.cost == pytest.approx(costs[2], rel=1e-4)  # the first guess goes on with the spin too far
    assert four.cost == pytest.approx(costs[1], rel=1e-4)


def test_the_eigenaxis_turn_is_a_saddle_point_that_a_search_leaves(turning):
    solver = PlanSolver.of(turning(*FASTER), "interpreted")
    program, problem = solver.program(solver.request(), solver.meshes(12)), solver.problem
    turned = solve(program, initial_guess(problem, solver.lobatto, 12).unknowns, scale=3.0)
    cost = program.objective(turned.w)
    assert cost == pytest.approx(3.6494, abs=1e-3)
    along, slopes = descent_direction(program, turned, cost), program.jacobian_pattern.copy()
    slopes.data, upper = program.jacobian(turned.w), program.hessian_pattern.copy()
    upper.data = program.hessian(turned.w, 1.0, turned.multipliers)
    assert along @ (upper + sparse.triu(upper, 1).T) @ along < -1e-3 * cost
    equal = np.equal(*program.limits())
    assert np.abs(slopes @ along)[equal].max() < 1e-5
    judged = verify(
        PhasedMotion(
            (solver.motion(solver.request(), SolveResult((), turned, solver.meshes(12), cost, None, "")),)
        ),
        program,
        turned,
        cost,
        "interpreted",
    )
    assert judged.status == "saddle point"
    found = solve_request(solver, solver.request(refine=False))
    assert found.cost == pytest.approx(3.5050, abs=2e-4)
    left = solver.program(solver.request(), found.meshes)
    assert descent_direction(left, found.solution, found.cost) is None


def test_a_plan_that_is_a_saddle_point_says_so(turning, capsys):
    found = make_plan(turning(), backend="interpreted")
    assert summary(found)["verification"]["second_order"] == "minimum"
    saddle = dataclasses.replace(found, verification=dataclasses.replace(found.verification, saddle=True))
    assert summary(saddle)["verification"]["second_order"] == dataset(saddle).status == "saddle point"
    show(PlanResult.of(saddle))
    assert "saddle point: nearby motions cost less" in " ".join(capsys.readouterr().err.split())


def test_the_least_time_of_half_a_turn_is_that_of_bilimoria_and_wie(turning):
    """3.243 s with unit inertia and torques up to 1 N m about each axis; 3.545 s about the eigenaxis."""
    solver = PlanSolver.of(turning(*FASTER, ("plan.costs", {"time": 1})), "interpreted")
    found = solve_request(solver, solver.request(start=1))
    assert found.cost == pytest.approx(3.243, abs=5e-4)
    assert not found.verification.failures()
    phased_motion = solver.phased_motion(solver.request(), found)
    torques = np.concatenate([motion.u for motion in phased_motion.motions if motion.duration_s > 0.1])
    assert np.abs(torques).min() > 0.99


WHEELED = [
    *FASTER,
    ("plan.costs", {"time": 1}),
    ("plan.limits", {}),
    ("plan.intervals", 16),
    ("plan.order", 4),
    ("robots.sat.actuators", {"wheels": WHEELS | {"axes": np.eye(3).tolist(), "pyramid": None}}),
    ("robots.sat.actuators.wheels.torque_limit", 1),
    ("plan.duration", {"lower": 1, "upper": 15}),
    ("plan.starts", 1),
    ("robots.sat.links.body.inertia", [2, 2, 2, 0, 0, 0]),
]
"""Half a turn in least time by three wheels of 1 N m and an inertia of 2 kg m²: in sqrt(2) times 3.2431 s."""


def test_segments_between_jumps_begin_near_the_equations_of_motion(turning):
    solver = PlanSolver.of(turning(*WHEELED), "interpreted")
    found = solve_request(solver, solver.request(refine=False))
    pieces = split_at_jumps(solver.phased_motion(solver.request(), found), solver.problem)
    assert len(pieces.motions) == 6
    program = solver.program(solver.request(), pieces.meshes)
    values, (least, greatest) = program.constraints(pieces.unknowns), program.limits()
    assert np.maximum(least - values, values - greatest).max() < 0.1


def test_a_turn_by_wheels_in_least_time_keeps_the_optimum_when_it_is_solved_in_segments(turning):
    """Bilimoria and Wie's optimum; 65 iterations, where a search with a large barrier parameter took 521."""
    solver = PlanSolver.of(turning(*WHEELED), "interpreted")
    found = solve_request(solver, solver.request())
    assert not found.verification.failures()
    assert found.cost == pytest.approx(4.5864, abs=1e-4)
    assert sum(run.iterations for run in found.runs) < 300


@pytest.mark.parametrize("intervals", [4, 7, 13])
def test_coarse_first_meshes_of_a_turn_by_wheels_end_at_the_optimum(turning, intervals):
    changes = [change for change in WHEELED if change[0] != "plan.intervals"]
    solver = PlanSolver.of(turning(*changes, ("plan.intervals", intervals)), "interpreted")
    found = solve_request(solver, solver.request())
    assert not found.verification.failures()
    assert found.cost == pytest.approx(4.5864, abs=1e-4)


@pytest.mark.parametrize("change", ["cost", "residual"])
def test_refinement_returns_the_best_plan_that_passed(turning, monkeypatch, change):
    """After the first plan passes, the next mesh costs more, or its plan fails."""
    module = "optim.planning.search.solve_request"
    solver = PlanSolver.of(turning(), "interpreted")
    expected = solve_request(solver, solver.request())
    assert not expected.verification.failures()
    results = []

    def finer(run, meshes):
        run.cost *= 1.01 if change == "cost" else 0.9995
        return True

    def changed(*arguments):
        results.append(verify(*arguments))
        is_bad = change == "residual" and len(results) > 1
        return dataclasses.replace(results[-1], residual=1.0) if is_bad else results[-1]

    monkeypatch.setattr(f"{module}._SolverRuns._finer", finer)
    monkeypatch.setattr(f"{module}.sharper_meshes", lambda motion, _: motion.meshes)
    monkeypatch.setattr(f"{module}.verify", changed)
    found = solve_request(solver, solver.request())
    assert len(results) > 1
    assert not found.verification.failures()
    assert (found.cost, found.cause) == (expected.cost, "")


def test_an_interval_is_wrong_by_where_its_error_in_velocity_leads_by_the_end(turning):
    """A spin that is off by 1 mrad/s at 2 s of 4 s is an error of the intervals before and after."""
    motion = make_plan(turning(), backend="interpreted").motion
    z, middle = motion.z.copy(), 2 * (motion.lobatto.points - 1)
    z[middle, 7 + 5] += 1e-3  # about z, behind the pose and the velocity
    off = dataclasses.replace(motion, z=z)
    (errors,), (before,) = (local_errors(PhasedMotion((one,)), "interpreted") for one in (off, motion))
    # 2 s are left where the first ends; the second begins with the error, for 1 s, and leaves it for 1 s more
    np.testing.assert_allclose(errors - before, [0, 2e-3, 2e-3, 0], atol=2e-5)


def test_an_interval_is_split_only_where_a_limit_is_passed_by_more_than_allowed(turning):
    motion = make_plan(turning(), backend="interpreted").motion
    problem, good = motion.problem, VerificationResult(0.0, (), {}, {}, 1.0)
    column = 7 + 6 + 6 + int(np.argmax(np.abs(motion.u).max(axis=0)))
    places = np.append(np.arange(10) / 10, 1)
    greatest = np.abs(motion.at(motion.mesh, places)[:, column]).max()
    for part, split in ((0.5, False), (2.0, True)):
        upper, lower = problem.upper.copy(), problem.lower.copy()
        upper[column] = greatest / (1 + part * RELATIVE)
        lower[column] = -upper[column]
        tight = dataclasses.replace(motion, problem=dataclasses.replace(problem, upper=upper, lower=lower))
        assert (refined_meshes(PhasedMotion((tight,)), good, 100, "interpreted") is not None) == split


def test_a_motion_is_cut_where_drives_jump_which_then_keep_their_levels_up_to_there(turning):
    """Two torques change sign, each within an interval, an interval and a half after one another."""
    solver = PlanSolver.of(turning(*FASTER), "interpreted")
    guess = initial_guess(solver.problem, solver.lobatto, 12)
    share, jumps = guess.lobatto.times(guess.mesh, 1.0), (0.3, 0.3 + 1.5 / 12)
    drives = guess.parts(guess.z)[3]  # a view
    drives[:] = 0.0
    for k, jump in enumerate(jumps):
        drives[:, k] = np.clip(-(share - jump) * 2 * 12, -1, 1)  # ramps over an interval
    found = [(jump.share, jump.drive, jump.before, jump.after) for jump in find_jumps(guess, np.ones(3))]
    np.testing.assert_allclose(found, [(jumps[0], 0, 1, -1), (jumps[1], 1, 1, -1)], atol=0.25 / 12)
    cut = split_at_jumps(PhasedMotion((guess,)), solver.problem)
    ends = np.cumsum([motion.duration_s for motion in cut.motions]) / guess.duration_s
    np.testing.assert_allclose(ends, [found[0][0], found[1][0], 1])
    first, second, third = (motion.u for motion in cut.motions)
    for levels, wanted in ((first[-3:, 0], 1), (second[:3, 0], -1), (second[-3:, 1], 1), (third[:3, 1], -1)):
        np.testing.assert_allclose(levels, wanted, atol=1e-12)
