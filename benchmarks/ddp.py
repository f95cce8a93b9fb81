"""Planned reach of the free-floating arm: our transcription against crocoddyl's feasible DDP."""

from __future__ import annotations

import dataclasses
import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from benchmarks.table_row import Row
from benchmarks.timing import paired
from optim.planning.formulation.formulate import formulate
from optim.planning.formulation.stage import PlanningProblem
from optim.planning.transcription.collocation_program import CollocationProgram
from optim.planning.transcription.initial_guess import initial_guess
from optim.planning.transcription.instant_functions import build_instants
from optim.planning.transcription.lobatto import Lobatto
from optim.planning.transcription.mesh_transfer import solve_from
from spacerobot.common.arrays import Array
from spacerobot.scene import load_scene

REACH = Path(__file__).resolve().parents[1] / "examples" / "reach.yaml"
ORDER, INTERVALS, COARSE, KNOTS = 6, 16, 5, 50
PENALTY = 1e6
"""Weight of the goal's squared error in DDP, which has no terminal constraints."""
SAME_COST = 1e-3
"""Largest relative difference of the costs of two solutions that count as the same optimum."""
TURNS = 3


def measured() -> Row:
    """Row measured in a separate process, since a crocoddyl that was built for another Pinocchio crashes."""
    here = "a reach planned", "crocoddyl, feasible DDP", ""
    if importlib.util.find_spec("crocoddyl") is None:
        return Row(*here, note="not measured: `pip install crocoddyl` (its wheel 3.2.1 wants pin 4.0)")
    command = [sys.executable, "-m", "benchmarks.ddp"]
    process = subprocess.run(command, check=False, capture_output=True, text=True)
    if process.returncode:
        return Row(*here, note=f"not measured: crocoddyl failed with pin {pin.__version__}")
    return Row(**json.loads(process.stdout.splitlines()[-1]))


def row() -> Row:
    """Row: the cost has squares of torques and of the base's motion; the tip ends in a pose, at rest.

    Joints are without damping, which crocoddyl's dynamics do not have.
    """
    import crocoddyl

    problem = formulate(load_scene(REACH, {"robots.arm.joints.*.damping": 0.0}))
    instants, lobatto = build_instants(problem), Lobatto.of_order(ORDER)
    program, first = (
        CollocationProgram(problem, instants, lobatto, INTERVALS),
        initial_guess(problem, lobatto, COARSE),
    )
    scale = CollocationProgram(problem, instants, lobatto, COARSE).objective(first.unknowns)
    baseline = Baseline(crocoddyl, problem, KNOTS)
    results: dict[str, Any] = {}

    def ours() -> None:
        results["ours"] = solve_from(first, program, scale=scale)

    times = paired(ours, baseline.solve, turns=TURNS)
    coarse, fine = results["ours"]
    cost = program.objective(fine.w)
    difference = abs(cost - baseline.cost) / cost
    same = fine.converged and baseline.converged and difference <= SAME_COST
    note = (
        f"first on {COARSE} intervals; {coarse.iterations} + {fine.iterations} and {baseline.iterations} "
        f"iterations; costs {cost:.7f} and {baseline.cost:.7f}; "
        f"theirs {baseline.miss:.1e} m or rad off its goal"
    )
    return Row(
        f"a reach planned, {INTERVALS} intervals of order {ORDER}, {program.size} unknowns",
        f"crocoddyl {crocoddyl.__version__}, feasible DDP over {KNOTS} steps of RK4",
        f"{times.first_s:.3f} s",
        f"{times.second_s:.3f} s",
        times.ratio,
        note=note if same else f"not the same optimum; {note}",
        numbers={"costs": (cost, baseline.cost)},
    )


class Baseline:
    """The same problem for crocoddyl, with torques linear within each step and penalties for the goal.

    The first guess has no torque. From our guess it has not converged after 300 iterations.

    Args:
        crocoddyl: The module.
        problem: Planning problem, whose base floats on a planar joint.
        intervals: Number of steps.
    """

    def __init__(self, crocoddyl: Any, problem: PlanningProblem, intervals: int) -> None:
        self.crocoddyl, self._problem = crocoddyl, problem
        model = pin.Model(problem.stage.scene.model)
        model.names[1] = "root_joint"  # crocoddyl's name of an unactuated base
        self._model = model
        self._state = crocoddyl.StateMultibody(model)
        self._actuation = crocoddyl.ActuationModelFloatingBase(self._state)
        self._tip = problem.stage.scene.tips[0].frame
        length = problem.duration[2] / intervals
        control = crocoddyl.ControlParametrizationModelPolyOne(self._actuation.nu)
        step = crocoddyl.IntegratedActionModelRK(
            self._running_model(), control, crocoddyl.RKType.four, length
        )
        end = crocoddyl.IntegratedActionModelEuler(self._terminal_model(), 0.0)
        shooting = crocoddyl.ShootingProblem(problem.fixed, [step] * intervals, end)
        self._solver = crocoddyl.SolverFDDP(shooting)
        self._solver.th_stop = 1e-10
        still = [np.zeros(step.nu)] * intervals
        self._first = (list(shooting.rollout(still)), still)

    def solve(self) -> None:
        """Solve the problem from the first guess."""
        self.converged = bool(self._solver.solve(*self._first, 1000, True))

    @property
    def iterations(self) -> int:
        """Number of iterations."""
        return int(self._solver.iter)

    @property
    def cost(self) -> float:
        """Cost without the penalties."""
        return float(sum(data.cost for data in self._solver.problem.runningDatas))

    @property
    def miss(self) -> float:
        """Largest error of the tip's final pose [m or rad] or velocity [m/s or rad/s]."""
        costs = self._solver.problem.terminalData.differential.costs.costs
        residuals = costs["pose"].residual.r, costs["rest"].residual.r[self._state.nv :]
        return max(float(np.abs(residual).max()) for residual in residuals)

    def _running_model(self) -> Any:
        """Action model of the dynamics and the running cost."""
        crocoddyl, problem, state, nu = self.crocoddyl, self._problem, self._state, self._actuation.nu
        costs, model = crocoddyl.CostModelSum(state, nu), state.pinocchio
        base = model.getFrameId(problem.stage.scene.model.names[1])
        data = model.createData()
        pin.framesForwardKinematics(model, data, problem.fixed[: model.nq])
        place = data.oMf[base]
        terms = {
            "torque": crocoddyl.ResidualModelControl(state, nu),
            "base_rotation": crocoddyl.ResidualModelFrameRotation(state, base, place.rotation, nu),
            "base_translation": crocoddyl.ResidualModelFrameTranslation(state, base, place.translation, nu),
        }
        for name, weight in problem.weights.items():
            if weight:  # crocoddyl halves the squares
                costs.addCost(name, crocoddyl.CostModelResidual(state, terms[name]), 2 * weight)
        return crocoddyl.DifferentialActionModelFreeFwdDynamics(state, self._actuation, costs)

    def _terminal_model(self) -> Any:
        """Action model of the goal's penalties."""
        crocoddyl, state, nu = self.crocoddyl, self._state, self._actuation.nu
        goal = self._problem.stage.scene.scenario.plan.goals["there"]
        pose = pin.SE3(np.eye(3), np.array(goal.position, dtype=float))
        costs = crocoddyl.CostModelSum(state, nu)
        pose_error = crocoddyl.ResidualModelFramePlacement(state, self._tip, pose, nu)
        still: Array = np.zeros(state.nx)
        still[: state.nq] = self._problem.fixed[: state.nq]
        weights = np.repeat([0.0, 1.0], state.nv)
        rest_cost = crocoddyl.CostModelResidual(
            state,
            crocoddyl.ActivationModelWeightedQuad(weights),
            crocoddyl.ResidualModelState(state, still, nu),
        )
        costs.addCost("pose", crocoddyl.CostModelResidual(state, pose_error), PENALTY)
        costs.addCost("rest", rest_cost, PENALTY)
        return crocoddyl.DifferentialActionModelFreeFwdDynamics(state, self._actuation, costs)


if __name__ == "__main__":
    print(json.dumps(dataclasses.asdict(row())))
