"""Plans in orbit, and approaches to tumbling targets: a closed form, and a flight by other equations."""

import itertools
from unittest.mock import patch

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
import yaml
from scipy.integrate import quad_vec
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from benchmarks.arm_flight import Chain, read_arm
from benchmarks.soft_capture import (
    ARM,
    CHASER,
    MASS,
    Draw,
    arm_violations,
    draws,
    flown,
    missing_draws,
    symmetric,
    violations,
    wrench_of,
)
from optim.planning.formulation.formulate import formulate_phases
from optim.planning.formulation.rows import functions_of, implicit_values
from optim.planning.search.held_joints import scene_with_joints_held, solver_with_joints_held
from optim.planning.search.make_plan import arrival_requests, make_plan
from optim.planning.search.plan_solver import PlanSolver, with_margins
from optim.planning.search.reachability import check_posture
from optim.planning.transcription.initial_guess import initial_guess, is_guided
from optim.planning.transcription.instant_functions import _caller
from optim.planning.transcription.lobatto import Lobatto
from optim.planning.transcription.mesh import Mesh
from optim.planning.transcription.motion import Motion
from optim.planning.verification.verify import FINER, between_points
from spacerobot.common.errors import ScenarioError
from spacerobot.compiled import compile_functions
from spacerobot.scene import load_scene
from spacerobot.shapes import Shape, held_gap

UNIT = """<robot name="unit"><link name="body"><inertial><mass value="10"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""
PLACE, SPEED, DURATION, AXIS = [20.0, -30.0, 10.0], [0.02, -0.01, 0.03], 900.0, 7e6
ORBIT = {"kind": "orbit", "semi_major_axis": AXIS, "model": "linear", "axes": "rotating"}


@pytest.fixture
def transfer(tmp_path):
    """Function of an orbit's keys: a unit body comes to rest at the origin of Hill axes."""
    (tmp_path / "unit.urdf").write_text(UNIT)

    def scene(**orbit):
        base = {"joint": "free_flyer", "position": PLACE, "velocity": SPEED}
        document = {
            "environment": {"leo": ORBIT | orbit},
            "robots": {"sat": {"urdf": "unit.urdf", "base": base, "tips": {"body": {}}}},
            "plan": {
                "duration": DURATION,
                "goals": {"there": {"tip": "sat/body", "position": [0, 0, 0]}, "rest": {"still": "sat"}},
                "costs": {"base_force": 1, "base_torque": 1000},  # a sphere needs no torque
                "limits": {"base_force": 5, "base_torque": 5},
                "intervals": 8,
            },
        }
        (tmp_path / "transfer.yaml").write_text(yaml.safe_dump(document))
        return load_scene(tmp_path / "transfer.yaml")

    return scene


def test_least_energy_of_a_transfer_in_orbit_is_that_of_the_controllability_gramian(transfer):
    """d' W^-1 d, with W the Gramian of Clohessy and Wiltshire's equations and d what drift leaves open."""
    n = np.sqrt(3.986004418e14 / AXIS**3)
    a, b = np.zeros((6, 6)), np.vstack([np.zeros((3, 3)), np.eye(3) / 10])
    a[:3, 3:], a[3, 0], a[3, 4], a[4, 3], a[5, 2] = np.eye(3), 3 * n**2, 2 * n, -2 * n, -(n**2)
    gramian = quad_vec(lambda t: expm(a * t) @ b @ b.T @ expm(a.T * t), 0, DURATION)[0]
    left = expm(a * DURATION) @ np.array([*PLACE, *SPEED])
    plan = make_plan(transfer(), backend="interpreted")
    assert plan.terms["base_force"] == pytest.approx(left @ np.linalg.solve(gramian, left), rel=1e-5)
    assert plan.verification.replay_error_m < 1e-5


def test_forces_that_depend_on_time_are_refused(transfer):
    with pytest.raises(ScenarioError, match=r"forces that depend on time.*axes: rotating"):
        make_plan(transfer(axes="inertial"), backend="interpreted")


@pytest.fixture(scope="module")
def solver():
    """Solver of a draw without hulls, whose iteration would take most of the time."""
    return PlanSolver.of(
        load_scene("soft-capture", draws(2)[1].changes() | {"plan.keep_out": {}}), "interpreted"
    )


def test_the_guess_of_an_approach_arrives_with_the_target_and_sees_it_all_the_way(solver):
    problem = solver.problem
    assert is_guided(problem)
    guess = initial_guess(problem, solver.lobatto, 16)
    goal = ca.Function("goal", [problem.stage.z], [ca.vertcat(*(row.value for row in problem.goal))])
    upper = np.array([row.upper for row in problem.goal])
    assert (goal(guess.z[-1]).full().ravel() < 0.01 * upper).all()
    sight = next(row for row in problem.path if row.form == "cosine")
    cosines = ca.Function("sight", [problem.stage.z], [sight.value])
    assert min(float(cosines(z)) for z in guess.z) > sight.lower


def test_speed_and_spin_of_a_base_are_bounded(solver):
    stage, rng = solver.problem.stage, np.random.default_rng(0)
    z, nq = rng.normal(size=stage.z.numel()), stage.q.numel()
    z[3:7] /= np.linalg.norm(z[3:7])
    rows = {
        row.name: float(ca.Function("row", [stage.z], [row.value])(z))
        for row in solver.problem.path
        if row.about is None
    }
    speed, spin = np.linalg.norm(z[nq : nq + 3]), np.linalg.norm(z[nq + 3 : nq + 6])
    assert rows["base speed of chaser"] == pytest.approx((speed / 1.5) ** 2)
    assert rows["base spin of chaser"] == pytest.approx((spin / np.radians(11.459)) ** 2)


def test_matched_axes_leave_the_rotation_about_them_free(solver):
    problem = solver.problem
    stage, guess = problem.stage, initial_guess(problem, solver.lobatto, 8)
    rows = [row for row in problem.goal if "orientation" in row.name or "spin" in row.name]
    function = ca.Function("goal", [stage.z], [ca.vertcat(*(row.value for row in rows))])

    def values(turn, spin):
        z, nq = guess.z[-1].copy(), stage.q.numel()
        z[3:7] = (Rotation.from_quat(z[3:7]) * Rotation.from_rotvec(turn)).as_quat()
        z[nq + 3 : nq + 6] += spin
        return function(z).full().ravel()

    # the port is on the body's z axis; limits are 5 deg and 1 deg/s
    tilted = np.array([np.tan(np.radians(5)) / np.tan(np.radians(2.5)), np.radians(2) / np.radians(1)]) ** 2
    np.testing.assert_allclose(values([0, 0, 1.0], [0, 0, 0.1])[0], 0, atol=1e-2)
    assert values([np.radians(10), 0, 0], [0, 0, 0])[0] == pytest.approx(tilted[0], rel=0.02)
    still = values([0, 0, 0], [0, 0, 0.1])
    np.testing.assert_allclose(still, values([0, 0, 0], [0, 0, 0]), atol=1e-2)
    assert values([0, 0, 0], [np.radians(2), 0, 0])[1] == pytest.approx(tilted[1], rel=0.1)


def test_arrivals_are_tried_in_turn_each_with_its_fixed_duration(solver):
    requests = [*arrival_requests(solver, solver.request()).values()]
    durations = [one.duration[0] for one in requests]
    assert len(durations) == 6
    assert all(40 <= a < b <= 350 for a, b in itertools.pairwise(durations))
    assert [one.explain for one in requests] == [False] * 5 + [True]
    for one in requests:
        assert one.duration == (one.duration[0],) * 3
        assert initial_guess(solver.problem_of(one), solver.lobatto, 4).duration_s == one.duration[0]


def test_an_approach_holds_its_limits_in_a_flight_by_other_equations():
    draw = draws(2)[1]
    assert isinstance(draw, Draw)
    changes = draw.changes() | {"plan.keep_out": {}, "plan.tolerance": 1e-5}
    plan = make_plan(load_scene("soft-capture", changes), backend="interpreted")
    motion = plan.motion
    wrench = wrench_of(motion)
    times, chaser, target = flown(draw, wrench, np.array(motion.mesh.knots) * motion.duration_s)
    excess = violations(times, chaser, target, np.array([wrench(t) for t in times]))
    del excess["hulls"]
    assert max(excess.values()) < 1e-3
    assert max(excess.values()) > -0.2  # and some of them are active
    states = motion.q[:, :3]
    assert np.abs(states[-1] - chaser[-1, :3]).max() < 1e-5


def test_an_approach_is_found_from_one_that_ignores_the_hulls():
    # from the guess, which passes through the hulls, 150 iterations diverge at this arrival
    changes = draws(9)[8].changes() | {"plan.duration.arrivals": 1}
    plan = make_plan(load_scene("soft-capture", changes), backend="interpreted")
    assert plan.runs[0].converged
    assert plan.runs[1].converged
    assert plan.motion.duration_s == pytest.approx(103.6, abs=0.1)
    assert not plan.verification.failures()


def test_an_arm_grasps_in_a_flight_by_other_equations():
    draw = draws(4)[3]
    changes = draw.changes() | {"plan.keep_out": {}, "plan.intervals": 8, "plan.duration.arrivals": 1}
    plan = make_plan(load_scene(ARM, changes), backend="interpreted")
    held, moving = plan.runs[:2]
    assert held.converged
    assert moving.converged
    assert moving.cost < held.cost  # the arm saves propellant
    excess, numbers = arm_violations(draw, plan.motion)
    about_keep_out = {"hulls", "arm to chaser", "arm to target"}
    assert max(value for name, value in excess.items() if name not in about_keep_out) < 1e-3
    assert numbers["tip_error_m"] < 1e-3
    assert numbers["joint_motion_deg"] > 5
    assert numbers["joint_torque_Nm"] < 12


def test_the_plan_with_joints_held_locks_them_and_keeps_zones_between_bodies(solver):
    assert solver_with_joints_held(solver) is None  # of a base without an arm
    (phase,) = formulate_phases(load_scene(ARM))
    held = formulate_phases(scene_with_joints_held(phase.problem.stage.scene))[0]
    assert not held.problem.stage.driven.joints
    assert list(held.plan.keep_out) == ["hulls"]
    assert held.plan.costs["joint_acceleration"].weight == 0
    assert held.plan.costs["propellant"].weight == 1


def test_kanes_equations_of_the_flight_agree_with_pinocchio():
    scene, rng = load_scene(ARM), np.random.default_rng(0)
    model, q, v = scene.model, scene.q.copy(), np.zeros(scene.model.nv)
    mount = scene.scenario.robots["chaser"].mounts["arm"]
    path = ARM.parents[1] / "urdf" / mount.urdf
    chain = Chain(
        MASS, symmetric(CHASER), read_arm(path, *map(np.array, (mount.position, mount.rotation_deg)))
    )
    q[:7], v[:13] = [0, 0, 0, 0, 0, 0, 1], rng.normal(size=13)
    q[7:14] += 0.3 * rng.normal(size=7)
    motion = chain.motion(q[7:14], v[6:13], v[3:6], v[:3])
    matrix, bias = chain.equations(motion)
    upper = np.triu(pin.crba(model, model.createData(), q))[:13, :13]
    np.testing.assert_allclose(matrix, upper + np.triu(upper, 1).T, atol=1e-9)
    # the model of a scene in rotating axes has no gravity of its own
    np.testing.assert_allclose(bias, pin.nle(model, model.createData(), q, v)[:13], atol=1e-9)


def test_an_interrupted_run_of_draws_resumes(tmp_path):
    path = tmp_path / "results.jsonl"
    assert missing_draws(path, 1, 4) == [1, 2, 3]
    path.write_text('{"draw": 2}\n{"draw": 7}\n')
    assert missing_draws(path, 1, 4) == [1, 3]


def test_few_steps_find_the_direction_between_hulls_that_all_steps_find():
    pads = load_scene("soft-capture").scenario.pads
    turn, place = ca.SX.sym("turn", 3, 3), ca.SX.sym("place", 3)
    one = Shape(type(pads["chaser"]), ca.SX.eye(3), ca.SX(3, 1), pads["chaser"].measures())
    other = Shape(type(pads["target"]), turn, place, pads["target"].measures())
    _, about = held_gap(one, other)
    given = ca.Function("given", [turn, place], [about.arguments])
    rng, columns = np.random.default_rng(0), []
    for distance in np.linspace(1, 25, 12):  # the first ones overlap
        direction = rng.normal(size=3)
        place_here = distance * direction / np.linalg.norm(direction)
        rotation = Rotation.random(random_state=rng).as_matrix()
        columns.append(given(rotation, place_here).full().ravel())
    functions, calls = functions_of([about]), []

    def call(name, *arguments):
        calls.append((name, arguments[0].shape[1]))
        return np.array(functions[name](*arguments).full())

    found = implicit_values([about], np.array(columns).T, call)
    np.testing.assert_allclose(found, np.array(about.function(np.array(columns).T).full()), atol=1e-8)
    most = sum(count for name, count in calls if name == about.function.name())
    assert 0 < most < 6  # of the overlapping ones alone
    apart, first = np.array(columns).T[:, 6:], len(calls)
    near = implicit_values([about], apart, call, found[:, 6:])
    np.testing.assert_allclose(near, found[:, 6:], atol=1e-8)
    assert len(calls) - first == 1  # one step confirms each


@pytest.mark.parametrize(("aside", "depth"), [(0.0, 1.0), (6.3, None)])
def test_hulls_that_cross_between_two_checked_instants_are_seen(aside, depth):
    (phase,) = formulate_phases(load_scene("soft-capture"))
    stage, lobatto = phase.problem.stage, Lobatto.of_order(phase.plan.order)
    model, duration, speed = stage.scene.model, 1000.0, 3.0
    q, v = pin.neutral(model), np.zeros(model.nv)
    chaser = model.joints[model.getJointId("chaser/root")]
    v[chaser.idx_v] = speed
    times = lobatto.times(Mesh.of(12), duration)
    z = np.zeros((len(times), stage.z.numel()))
    z[:, : model.nq], z[:, model.nq : model.nq + model.nv] = q, v
    z[:, chaser.idx_q] = speed * (times - 0.504 * duration)
    z[:, chaser.idx_q + 1] = aside
    motion = Motion(phase.problem, lobatto, Mesh.of(12), duration, z)
    hulls = next(one for one in between_points(motion) if one.name.startswith("hulls"))
    steps = hulls.time_s / duration * 12 * FINER
    grid = np.abs(steps - np.round(steps)) < 1e-9
    assert np.count_nonzero(grid) == 12 * FINER + 1
    assert hulls.excess[grid].max() < -5  # far apart at the instants of the grid
    assert hulls.time_s.size < 500
    if depth is not None:
        assert hulls.excess.max() > depth
        assert hulls.worst_s == pytest.approx(0.504 * duration, abs=2)
    else:
        assert hulls.excess.max() < 0


def test_margins_tighten_rows_in_their_units_and_drives(solver):
    problem = solver.problem
    sight = next(row for row in problem.path if row.form == "cosine")
    force = next(name for name in problem.stage.driven.names if name.endswith("fx"))
    tight = with_margins(problem, {sight.name: 0.01, f"torque of {force}": 2.0})
    new = next(row for row in tight.path if row.name == sight.name)
    assert np.arccos(sight.lower) - np.arccos(new.lower) == pytest.approx(0.01, rel=0.05)
    changed = np.flatnonzero(tight.upper != problem.upper)
    assert problem.upper[changed] - tight.upper[changed] == pytest.approx([2.0])
    assert tight.lower[changed] - problem.lower[changed] == pytest.approx([2.0])
    others = [(a, b) for a, b in zip(problem.path, tight.path, strict=True) if a.name != sight.name]
    assert all(a.lower == b.lower and a.upper == b.upper for a, b in others)


@pytest.mark.compiler
def test_a_rare_function_is_interpreted_where_others_are_compiled():
    x, calls = ca.SX.sym("x", 2), []
    functions = {name: ca.Function(name, [x], [factor * x]) for name, factor in (("often", 2), ("rare", 3))}

    def compiled(used, **options):
        calls.append(set(used))
        return compile_functions(used, **options)

    with patch("optim.planning.transcription.instant_functions.compile_functions", compiled):
        call, backend = _caller(functions, "compiled", {"rare"})
    columns = np.arange(6.0).reshape(2, 3)
    assert (backend, calls) == ("compiled", [{"often"}])
    np.testing.assert_allclose(call("often", columns), 2 * columns)
    np.testing.assert_allclose(call("rare", columns), 3 * columns)


@pytest.mark.parametrize("draw", [48, 109])
def test_a_place_at_a_tumbling_target_far_away_is_within_reach(draw):
    # steps from the start alone ended elsewhere for the one, and at a singular matrix for the other
    changes = draws(draw + 1)[draw].changes() | {"plan.keep_out": {}}
    (phase,) = formulate_phases(load_scene("soft-capture", changes))
    check_posture(phase.problem)
