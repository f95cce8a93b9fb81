"""The cost unit of a comparison: number of operations, in units of one plain rollout.

An operation is one instruction of a CasADi function: an addition, a product, a sine. The count does not
depend on the load of the machine, its compiler or its number of lanes.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import casadi as ca

from optim.problem.problem import EvaluationCost
from optim.problem.tuning_problem import TuningProblem
from optim.problem.worker_operations import sampled_outputs
from spacerobot.rollout.adjoint import SEGMENT_BYTES, WHOLE_BYTES, adjoint_kernel
from spacerobot.rollout.kernel import Kernel
from spacerobot.rollout.sensitivity import sensitivity_kernel
from spacerobot.rollout.time_grid import TimeGrid

LANES = 8  # of the adjoint whose tape is priced: the same everywhere, whatever the machine has
MOVES = {ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST}  # instructions that compute nothing


@dataclass(frozen=True)
class CostUnit:
    """Cost of each kind of evaluation.

    Attributes:
        operations: Number of operations of one plain rollout.
        gradient: Cost of a rollout with one gradient by the adjoint, for any number of variables [rollouts].
        slope: Cost of a rollout with its derivative along one direction [rollouts].
        sample: Cost of a rollout that samples its outputs [rollouts].
    """

    operations: int
    gradient: float
    slope: float
    sample: float

    def rollouts(self, cost: EvaluationCost) -> float:
        """A cost, in plain rollouts."""
        prices = {"rollouts": 1.0, "gradients": self.gradient, "slopes": self.slope, "samples": self.sample}
        return float(sum(prices[kind] * count for kind, count in asdict(cost).items()))


def cost_unit_of(problem: TuningProblem) -> CostUnit:
    """Cost of a problem's evaluations, from the operations of the functions that its rollouts evaluate.

    A plain rollout evaluates the dynamics once in each stage of each step. The adjoint does so too and then
    evaluates their reverse as often; if its tape is too short for all steps, it integrates all but the last
    segment twice. A slope is a rollout of the dynamics with their derivative, with samples of the outputs
    that a minimax objective or a sum of squares needs. Empty lanes do not count.

    Args:
        problem: The problem; of several plants the nominal one, since the cost is the same for each.
    """
    rollout = problem.rollout
    kernel, grid, wrt = rollout.kernel, rollout.grid, rollout.indices(problem.names)
    plain = _rollout(kernel, grid)
    adjoint = adjoint_kernel(kernel, wrt)
    sensitivity = sensitivity_kernel(kernel, wrt, sampled_outputs(problem))
    samples = grid.intervals + 1
    slope, sample = (
        _rollout(k, grid) + samples * operations(k.functions["outputs"]) for k in (sensitivity, kernel)
    )
    # operations of the adjoint beyond those of its rollout
    f = adjoint.functions
    ends = sum(operations(f[f"{name}_reverse"]) for name in ("setup", "final", "objective"))
    peaks = adjoint.peaks * operations(f["peaks_reverse"])  # at most one step for each
    step = adjoint.method.stages * operations(f["dynamics_reverse"]) + operations(f["normalise_reverse"])
    # steps that the adjoint integrates a second time, its tape being too short for all of them
    per_step = (adjoint.method.stages + 1) * adjoint.scale.size * 8 * LANES
    if grid.steps * per_step <= WHOLE_BYTES // LANES:
        integrated_again = 0
    else:
        segment = min(grid.steps, max(1, SEGMENT_BYTES // per_step))
        integrated_again = (grid.steps - 1) // segment * segment
    sweep_back = ends + peaks + grid.steps * step + integrated_again * _step(adjoint)
    return CostUnit(plain, 1 + sweep_back / plain, slope / plain, sample / plain)


def operations(function: ca.Function) -> int:
    """Number of operations of one evaluation of an SX function, without inputs, outputs and constants."""
    return sum(function.instruction_id(i) not in MOVES for i in range(function.n_instructions()))


def _step(kernel: Kernel) -> int:
    f = kernel.functions
    return kernel.method.stages * operations(f["dynamics"]) + operations(f["normalise"])


def _rollout(kernel: Kernel, grid: TimeGrid) -> int:
    f = kernel.functions
    ends = sum(operations(f[name]) for name in ("setup", "final", "objective"))
    return ends + grid.steps * _step(kernel) + bool(kernel.peaks) * operations(f["dynamics"])
