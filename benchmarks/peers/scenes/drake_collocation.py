"""The detumbling of Vyas et al. 2022 planned: Drake's direct collocation by Hermite and Simpson."""

from __future__ import annotations

import functools

import numpy as np

from benchmarks.peers.compare import Job, Outcome, PeerScene, Side, compare
from optim.planning.formulation.formulate import formulate
from optim.planning.solver.ipopt import solve
from optim.planning.transcription.collocation_program import CollocationProgram
from optim.planning.transcription.initial_guess import initial_guess
from optim.planning.transcription.instant_functions import build_instants
from optim.planning.transcription.lobatto import Lobatto
from spacerobot.common.arrays import Array
from spacerobot.exports.mjcf_bodies import coordinates, mjcf, motors
from spacerobot.scene import Scene, load_scene

SCENARIO, TOLERANCE = "detumble-published", 1e-5
FREE, PLANAR = (
    '<freejoint name="chaser/root"/>',
    (("x", "slide", "1 0 0"), ("z", "slide", "0 0 1"), ("r", "hinge", "0 1 0")),
)
ARM = ("chaser/joint_1", "chaser/joint_2", "chaser/joint_3")


def measure() -> Outcome:
    """Each level doubles the intervals; compared are cost and duration."""
    scene = load_scene(SCENARIO)
    problem, order = formulate(scene), Lobatto.of_order(6)
    instants = functools.cache(lambda: build_instants(problem))

    def ready(level: int) -> Job:
        intervals = 4 * 2**level
        first = initial_guess(problem, order, intervals)
        program = CollocationProgram(problem, instants(), order, intervals)
        scale = program.objective(first.unknowns)

        def run() -> Array:
            found = solve(program, first.unknowns, scale=scale)
            return np.array([program.objective(found.w), program.split(found.w)[1]])

        return run

    ours = Side(ready, lambda level: f"order 6, {4 * 2**level} intervals, exact second derivatives")
    theirs = Side(
        lambda level: drakes(scene, 8 * 2**level), lambda level: f"order 4, {8 * 2**level} intervals"
    )
    return compare(ours, theirs, TOLERANCE, "cost and duration")


def drakes(scene: Scene, intervals: int) -> Job:
    """The same limits and cost; the motion is planar, so the base has two slides and a hinge."""
    import pydrake.symbolic as sym
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.planning import DirectCollocation
    from pydrake.solvers import IpoptSolver
    from pydrake.trajectories import PiecewisePolynomial

    limits = {name: limit.upper for name, limit in scene.scenario.plan.limits.items()}
    names = [f"chaser/root.{name}" for name, _, _ in PLANAR] + list(ARM)
    base = "".join(f'<joint name="chaser/root.{n}" type="{t}" axis="{axis}"/>' for n, t, axis in PLANAR)
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModelsFromString(mjcf(scene, more=motors(names)).replace(FREE, base), "xml")
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    port = plant.get_actuation_input_port().get_index()
    low, high = (x / intervals for x in (1, 20))
    plan = DirectCollocation(plant, context, intervals + 1, low, high, port)
    program, x, u = plan.prog(), plan.state(), plan.input()
    plan.AddEqualTimeIntervalsConstraints()
    q, v = coordinates(scene, scene.q, scene.v)
    first = np.r_[q[[0, 2]], 0.0, q[7:10], v[[0, 2, 4]], v[6:9]]
    program.AddBoundingBoxConstraint(first, first, plan.initial_state())
    rest = np.r_[np.zeros(3), np.full(3, 1e-3)]
    program.AddBoundingBoxConstraint(-rest, rest, plan.final_state()[6:])
    most = np.r_[limits["base_torque"], np.full(3, limits["torque"])]
    for effort, limit in zip(u[2:], most, strict=True):
        plan.AddConstraintToAllKnotPoints(effort <= limit)
        plan.AddConstraintToAllKnotPoints(effort >= -limit)
    c, s = sym.cos(x[2]), sym.sin(x[2])
    for force in (c * u[0] - s * u[1], s * u[0] + c * u[1]):
        plan.AddConstraintToAllKnotPoints(force <= limits["base_force"])
        plan.AddConstraintToAllKnotPoints(force >= -limits["base_force"])
    plan.AddRunningCost(1 + 10 * (u[0] ** 2 + u[1] ** 2) + u[2:].dot(u[2:]))
    line = PiecewisePolynomial.FirstOrderHold([0.0, 4.0], np.c_[first, np.r_[first[:6], np.zeros(6)]])
    plan.SetInitialTrajectory(PiecewisePolynomial(), line)

    def run() -> Array:
        solver_result = IpoptSolver().Solve(program, None, None)
        times = plan.GetSampleTimes(solver_result)
        return np.array([solver_result.get_optimal_cost(), times[-1]])

    return run


SCENE = PeerScene(
    "Drake",
    "drake",
    "plan of `detumble-published` by IPOPT",
    "`DirectCollocation`; IPOPT by `limited-memory`, ends at its acceptable level",
    measure,
)
