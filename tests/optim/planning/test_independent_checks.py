"""Optima that are known: a mass on a rail, and a two-link arm that floats against Pontryagin's conditions."""

import numpy as np
import pytest
import yaml
from scipy.integrate import solve_bvp, trapezoid

from optim.planning.output.plan_folder import FOLLOWED, dataset, write
from optim.planning.search.make_plan import make_plan
from optim.planning.search.plan_solver import PlanSolver
from optim.planning.studies.cost_sensitivities import cost_sensitivities
from optim.planning.transcription.mesh import Mesh
from spacerobot import pinocchio_engine
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate

RAIL = """<robot name="rail"><link name="rail"/>
<link name="cart"><inertial><mass value="2"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="slide" type="prismatic"><parent link="rail"/><child link="cart"/><axis xyz="1 0 0"/>
<limit lower="-5" upper="5" effort="4" velocity="100"/></joint></robot>"""
LINK = """<link name="{0}"><inertial><origin xyz="{2} 0 0"/><mass value="{1}"/>
<inertia ixx="{3}" iyy="{3}" izz="{3}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
HINGE = """<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><origin xyz="{3} 0 0"/>
<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="100" velocity="10"/></joint>"""
TWO_LINKS = "\n".join(
    [
        '<robot name="two">',
        LINK.format("base", 10, 0, 1),
        LINK.format("upper", 2, 0.25, 0.1),
        LINK.format("lower", 2, 0.25, 0.1),
        HINGE.format("shoulder", "base", "upper", 0),
        HINGE.format("elbow", "upper", "lower", 0.5),
        "</robot>",
    ]
)


def scene(folder, urdf, base, plan):
    (folder / "robot.urdf").write_text(urdf)
    robot = {"urdf": "robot.urdf", "base": {"joint": base}}
    file = folder / "scene.yaml"
    file.write_text(yaml.safe_dump({"robots": {"one": robot}, "plan": plan}))
    return load_scene(file)


def to(**joints):
    return {"end": {"robot": "one", "joints": joints}}


def test_least_energy_of_a_mass_on_a_rail(tmp_path):
    """u = 6 m d / T^2 (1 - 2 t / T), and its square's integral is 12 m^2 d^2 / T^3."""
    plan = {"duration": 3, "goals": to(slide={"offset": 1.5}), "costs": {"torque": 1}, "intervals": 2}
    found = make_plan(scene(tmp_path, RAIL, "fixed", plan), backend="interpreted")
    share = found.motion.time / 3
    assert found.cost == pytest.approx(12 * 4 * 1.5**2 / 27, rel=1e-9)
    force = 6 * 2 * 1.5 / 9 * (1 - 2 * share)
    np.testing.assert_allclose(found.motion.u[:, 0], force, atol=1e-7)
    norms = dataset(found).multiplier_norm  # that of m a = u is 2 u
    np.testing.assert_allclose(norms, 2 * np.abs(force), atol=1e-6)


def test_least_time_of_a_mass_on_a_rail(tmp_path):
    """T = 2 sqrt(m d / F); a force that cannot jump at the middle takes longer, ever less on finer meshes."""
    plan = {
        "duration": {"lower": 0.5, "upper": 5},
        "goals": to(slide={"offset": 2}),
        "costs": {"time": 1},
        "order": 4,
        "limits": {"urdf": ["torque"]},
    }
    over = []
    for intervals in (9, 27):
        meshed = plan | {"intervals": intervals, "max_intervals": intervals}
        found = least_time(scene(tmp_path, RAIL, "fixed", meshed))
        over.append(found - 2.0)
    assert 0 < over[1] < over[0] < 0.1
    assert over[1] < over[0] / 2


def least_time(scene):
    """Duration of the solver's motion, whose force swings beyond its limits between the points."""
    from optim.planning.formulation.formulate import formulate
    from optim.planning.solver.ipopt import solve
    from optim.planning.transcription.collocation_program import CollocationProgram
    from optim.planning.transcription.initial_guess import initial_guess
    from optim.planning.transcription.instant_functions import build_instants
    from optim.planning.transcription.lobatto import Lobatto

    plan, problem = scene.scenario.plan, formulate(scene)
    lobatto = Lobatto.of_order(plan.order)
    program = CollocationProgram(problem, build_instants(problem, "interpreted"), lobatto, plan.intervals)
    solution = solve(program, initial_guess(problem, lobatto, plan.intervals).unknowns)
    assert solution.converged
    return solution.w[-1]


def reduced(elbow):
    """Inertia in the joints' rates and its derivative by the elbow, the base's momentum being zero, by hand.

    The shoulder is at the base's centre of mass; a, b and c are those of the links' absolute rotations
    without the motion of the common centre of mass, and the angular momentum gives the base's rotation.
    """
    m, whole, l1, lc = 2.0, 14.0, 0.5, 0.25
    first = m * lc + m * l1
    a = 0.1 + m * lc**2 + m * l1**2 - first**2 / whole
    b = m * l1 * lc - first * m * lc / whole
    c = 0.1 + m * lc**2 - (m * lc) ** 2 / whole
    e, f, de, df = (
        a + c + 2 * b * np.cos(elbow),
        c + b * np.cos(elbow),
        -2 * b * np.sin(elbow),
        -b * np.sin(elbow),
    )
    s = 1.0 + e
    matrix = (e - e * e / s, f - e * f / s, c - f * f / s)
    by = (
        de - 2 * e * de / s + e * e * de / s**2,
        df - (de * f + e * df) / s + e * f * de / s**2,
        -2 * f * df / s + f * f * de / s**2,
    )
    return matrix, by


def solution(matrix, one, two):
    (xx, xy, yy), size = matrix, matrix[0] * matrix[2] - matrix[1] ** 2
    return (yy * one - xy * two) / size, (xx * two - xy * one) / size


def hamiltonian(elbow, rates, torque, costates):
    """p . w + r . w', which the costates follow; the torque's square does not depend on the state."""
    matrix, by = reduced(elbow)
    (w1, w2), half = (
        rates,
        by[0] * rates[0] ** 2 / 2 + by[1] * rates[0] * rates[1] + by[2] * rates[1] ** 2 / 2,
    )
    bias = (w2 * (by[0] * w1 + by[1] * w2), w2 * (by[1] * w1 + by[2] * w2) - half)
    g1, g2 = solution(matrix, torque[0] - bias[0], torque[1] - bias[1])
    p1, p2, r1, r2 = costates
    return p1 * w1 + p2 * w2 + r1 * g1 + r2 * g2, (g1, g2)


def test_a_floating_arm_meets_pontryagins_conditions(tmp_path):
    """Least integral of tau^2 by the boundary value problem of states and costates, by hand and SciPy."""
    ends = {"shoulder": 0.8, "elbow": -1.2}
    goals = to(**{name: {"angle_deg": float(np.degrees(angle))} for name, angle in ends.items()})
    plan = {"duration": 2, "goals": goals, "costs": {"torque": 1}, "intervals": 16}
    found = make_plan(scene(tmp_path, TWO_LINKS, "planar", plan), backend="interpreted")

    def torques(elbow, r1, r2):
        one, two = solution(reduced(elbow)[0], r1, r2)
        return -one / 2, -two / 2

    def motion(_, y):
        elbow, rates, costates, tiny = y[1], y[2:4], y[4:], 1e-30j
        u = torques(elbow, *costates[2:])
        acceleration = hamiltonian(elbow, rates, u, costates)[1]
        pulls = [
            hamiltonian(elbow + tiny, rates, u, costates)[0],
            hamiltonian(elbow, (rates[0] + tiny, rates[1]), u, costates)[0],
            hamiltonian(elbow, (rates[0], rates[1] + tiny), u, costates)[0],
        ]
        slopes = [np.imag(pull) / 1e-30 for pull in pulls]
        return np.array([*rates, *acceleration, 0 * elbow, *(-slope for slope in slopes)])

    def sides(first, last):
        return np.concatenate([first[:4], last[:2] - list(ends.values()), last[2:4]])

    time, y = np.linspace(0, 2, 21), np.zeros((8, 21))
    y[:2] = np.outer(list(ends.values()), 3 * (time / 2) ** 2 - 2 * (time / 2) ** 3)
    exact = solve_bvp(motion, sides, time, y, tol=1e-7, max_nodes=2000)
    assert exact.success
    at = exact.sol(found.motion.time)
    u = np.transpose(torques(at[1], *at[6:]))
    np.testing.assert_allclose(found.motion.q[:, 4:], at[:2].T, atol=1e-6)
    np.testing.assert_allclose(found.motion.u, u, atol=1e-4 * np.abs(u).max())
    assert found.cost == pytest.approx(trapezoid((exact_square(exact, torques)), dx=2 / 4000), rel=1e-6)


def exact_square(exact, torques):
    at = exact.sol(np.linspace(0, 2, 4001))
    return np.square(torques(at[1], *at[6:])).sum(axis=0)


LEAST = {
    "duration": {"lower": 0.5, "upper": 5},
    "goals": to(slide={"offset": 2}),
    "costs": {"time": 1},
    "limits": {"urdf": ["torque"]},
}


@pytest.mark.parametrize("intervals", [9, 16])
def test_a_force_that_jumps_at_a_free_knot_takes_the_least_time(tmp_path, intervals):
    """T = 2 sqrt(m d / F) with one jump in the middle, planned, written and flown by both engines."""
    found = make_plan(scene(tmp_path, RAIL, "fixed", LEAST | {"intervals": intervals}), backend="interpreted")
    assert found.cost == pytest.approx(2.0, abs=1e-6)
    force = np.concatenate([motion.u[:, 0] for motion in found.phased_motion.motions])
    np.testing.assert_allclose(force, np.where(found.phased_motion.time <= 1 - 1e-9, 4, force), atol=1e-4)
    assert [motion.duration_s for motion in found.phased_motion.motions] == pytest.approx([1, 1], abs=1e-6)
    assert found.runs[-1].intervals <= intervals + 2
    paths = ["robots.one.links.cart.mass", "robots.one.joints.slide.torque_limit"]
    slopes = {paths[0]: 1 / 2, paths[1]: -1 / 4}  # T / (2 m) and -T / (2 F)
    assert cost_sensitivities(found, paths) == pytest.approx(slopes, rel=1e-4)
    write(found, tmp_path / "plan")
    followed = load_scene(tmp_path / "plan" / FOLLOWED)
    flown = simulate(followed, backend="interpreted").data
    checked = pinocchio_engine.simulate(followed)
    for q, v in ((flown.q.values, flown.v.values), (checked.state[:, :1], checked.state[:, 1:2])):
        assert q[-1, 0] == pytest.approx(2, abs=1e-6)
        assert v[-1, 0] == pytest.approx(0, abs=1e-6)


def test_a_given_duration_and_limits_of_a_free_one_hold_for_all_segments_together(tmp_path):
    limited = LEAST | {"duration": {"lower": 2.5, "upper": 5}, "costs": {"time": 1}, "intervals": 4}
    solver = PlanSolver.of(scene(tmp_path, RAIL, "fixed", limited), "interpreted")
    meshes = (Mesh.of(2), Mesh.of(3))
    program = solver.program(solver.request(), meshes)
    w = np.random.default_rng(0).uniform(0.5, 1, program.size)
    slopes, along = program.jacobian_pattern.copy(), np.random.default_rng(1).uniform(-1, 1, program.size)
    slopes.data = program.jacobian(w)
    change = (program.constraints(w + 1e-6 * along) - program.constraints(w - 1e-6 * along)) / 2e-6
    np.testing.assert_allclose(slopes @ along, change, atol=1e-7)
    first = program.programs[0].size
    durations = w[first - 1] + w[first + program.programs[1].size - 1]
    assert program.constraints(w)[-len(program.rest.least)] == pytest.approx(durations)
    assert (program.rest.least[0], program.rest.greatest[0]) == (2.5, 5)
