"""Solution of a program by IPOPT, with exact first and second derivatives."""

from __future__ import annotations

import contextlib
import ctypes
import dataclasses
import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from scipy import sparse

from optim.planning.solver.casadi_messages import without_interrupts
from optim.planning.solver.nonlinear_program import NonlinearProgram
from optim.planning.solver.presolve import PresolvedProgram
from spacerobot.common.arrays import Array

PATIENCE = 30
"""Number of iterations after which a warm start is abandoned for a cold one."""
TOLERANCE = 1e-8
"""Largest residual of the first-order conditions at a solution."""
LEAST_BARRIER = 1e-8
"""Minimum barrier parameter of a warm start, relative to the cost."""

FROM_A_GUESS = {"mu_init": 1e-2, "constr_mult_init_max": 0.0}
"""Options without initial multipliers: least-squares estimates mislead the search more often than zeros."""

FROM_A_MOTION = {"constr_mult_init_max": 1e3}
"""Options near a solution with unknown multipliers: there the least-squares estimates are close to them."""

THROWN = "NonIpopt_Exception_Thrown"
"""IPOPT's status after an exception; errors of the program's functions are caught, so it means Ctrl-C."""

TIME_LIMIT = "Time_Limit"
"""Status of a search that its iteration callback stopped."""

OnIteration = Callable[[int, float, float], bool]
"""Called at each iteration with its number, the cost and the maximum violation; returns whether to stop."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Last iterate of IPOPT, with its multipliers.

    Attributes:
        w: Unknowns.
        multipliers, bound_multipliers: Multipliers of the constraints, and of the bounds of the unknowns;
            positive at an upper limit.
        status: Status message of IPOPT.
        converged: Whether IPOPT converged to a solution.
        iterations, evaluations_s, seconds: Number of iterations, time in the problem's functions [s] and in
            total [s].
        scale, barrier: Size of the cost used for scaling, and the final barrier parameter in units of it.
    """

    w: Array
    multipliers: Array
    bound_multipliers: Array
    status: str
    converged: bool
    iterations: int
    evaluations_s: float
    seconds: float
    scale: float
    barrier: float


def solve(
    program: NonlinearProgram,
    first: Array,
    warm: Solution | None = None,
    *,
    scale: float | None = None,
    iterations: int = 500,
    on_iteration: OnIteration | None = None,
) -> Solution:
    """Solve a program.

    Args:
        program: Program to be solved.
        first: Initial unknowns.
        warm: Solution of a program of the same shape for a warm start with its multipliers, barrier parameter
            and scale. If that fails, the search restarts cold. With multipliers of length zero it starts from
            their least-squares estimates.
        scale: Size of the cost, to which residuals are relative; that of ``warm``, or one, if None.
        iterations: Maximum number of iterations of each of the two searches.
        on_iteration: Called at each iteration.

    Raises:
        KeyboardInterrupt: If the user interrupts with Ctrl-C.
    """
    # if constraints may be dependent, their multipliers are kept small at every iteration
    always = {"perturb_always_cd": "yes"} if getattr(program, "is_redundant", False) else {}
    tolerance = getattr(program, "tolerance", TOLERANCE)
    if scale is None:
        scale = 1.0 if warm is None else warm.scale
    presolved = PresolvedProgram(program, first)
    if warm is None:
        return _solve(
            presolved, first, None, ipopt_options(iterations, scale, tolerance) | always, on_iteration
        )
    has_multipliers = warm.multipliers.size > 0
    options = ipopt_options(
        min(iterations, PATIENCE), scale, tolerance, warm.barrier, has_multipliers=has_multipliers
    )
    first_run = _solve(presolved, first, warm if has_multipliers else None, options | always, on_iteration)
    if first_run.converged or iterations <= PATIENCE or first_run.status == TIME_LIMIT:
        return first_run
    cold = ipopt_options(iterations, scale, tolerance) | always
    restart = _solve(presolved, first, None, cold, on_iteration)
    return dataclasses.replace(
        restart,
        iterations=first_run.iterations + restart.iterations,
        evaluations_s=first_run.evaluations_s + restart.evaluations_s,
        seconds=first_run.seconds + restart.seconds,
    )


def _solve(
    program: PresolvedProgram,
    first: Array,
    warm: Solution | None,
    ipopt: dict[str, Any],
    on_iteration: OnIteration | None,
) -> Solution:
    begin = time.perf_counter()
    bridge = _CasadiFunctions(program)
    watch = _IterationCallback(program, bridge, on_iteration)
    solver = ca.nlpsol("plan", "ipopt", bridge.problem, bridge.options(watch) | {"ipopt": ipopt})
    (low, high), (least, greatest) = program.bounds(), program.limits()
    arguments: dict[str, Any] = {
        "x0": first[program.free],
        "lbx": low,
        "ubx": high,
        "lbg": least,
        "ubg": greatest,
    }
    if warm is not None:
        arguments["lam_g0"] = warm.multipliers[program.held]
        arguments["lam_x0"] = warm.bound_multipliers[program.free]
    with one_thread(), without_interrupts():
        result = solver(**arguments)
    stats = solver.stats()
    if bridge.fault is not None:
        raise bridge.fault
    if bridge.interrupted or stats["return_status"] == THROWN:
        raise KeyboardInterrupt
    w, multipliers, of_bounds = (np.array(result[name]).ravel() for name in ("x", "lam_g", "lam_x"))
    return Solution(
        program.unknowns(w),
        program.multipliers(w, multipliers),
        program.spread(of_bounds),
        TIME_LIMIT if bridge.late else str(stats["return_status"]),
        bool(stats["success"]),
        int(stats["iter_count"]),
        bridge.seconds,
        time.perf_counter() - begin,
        1 / ipopt["obj_scaling_factor"],
        float(stats["iterations"]["mu"][-1]) if stats.get("iterations") else ipopt.get("mu_init", 0.1),
    )


def ipopt_options(
    iterations: int,
    scale: float,
    tolerance: float = TOLERANCE,
    barrier: float | None = None,
    *,
    has_multipliers: bool = True,
) -> dict[str, Any]:
    """IPOPT's options, with an initial barrier parameter if the search starts near a solution."""
    options: dict[str, Any] = {
        "print_level": 0,
        "sb": "yes",
        "linear_solver": "mumps",
        "mumps_mem_percent": 200,
        # without the permutation by large products, whose fill-in makes factorisations up to six times slower
        "mumps_permuting_scaling": 0,
        "max_iter": iterations,
        "tol": tolerance,
        "obj_scaling_factor": 1 / scale,
        "constr_viol_tol": 1e-9,
        "acceptable_iter": 0,
        "mu_strategy": "monotone",
        "honor_original_bounds": "yes",
    }
    if barrier is None:
        options |= FROM_A_GUESS
    elif not has_multipliers:
        options |= FROM_A_MOTION | {"mu_init": barrier}
    else:
        options |= {
            "warm_start_init_point": "yes",
            "mu_init": max(barrier, LEAST_BARRIER),
            "warm_start_bound_push": 1e-8,
            "warm_start_bound_frac": 1e-8,
            "warm_start_slack_bound_push": 1e-8,
            "warm_start_slack_bound_frac": 1e-8,
            "warm_start_mult_bound_push": 1e-8,
        }
    return options


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Context in which CasADi's own BLAS uses one thread, so that sums do not depend on the thread count."""
    with contextlib.ExitStack() as stack:
        for blas in loaded_blas():
            stack.callback(blas.openblas_set_num_threads, int(blas.openblas_get_num_threads()))
            blas.openblas_set_num_threads(1)
        yield


def loaded_blas() -> Iterator[ctypes.CDLL]:
    """CasADi's own BLAS: among several copies in its folder, the one to which the solver is linked."""
    if not hasattr(os, "RTLD_NOLOAD"):
        return
    for file in sorted(Path(ca.__file__).parent.glob("libcasadi-tp-openblas*")):
        with contextlib.suppress(OSError):
            yield ctypes.CDLL(str(file), mode=os.RTLD_NOW | os.RTLD_NOLOAD)


class _CasadiFunctions:
    """A program as the functions that CasADi's interface to IPOPT requires."""

    def __init__(self, program: NonlinearProgram) -> None:
        self.interrupted, self.late, self.seconds = False, False, 0.0
        self.fault: Exception | None = None
        n, m = program.size, program.rows
        x, p = ca.Sparsity.dense(n), ca.Sparsity(0, 0)
        one, g = ca.Sparsity.dense(1), ca.Sparsity.dense(m)
        jacobian, hessian = _sparsity(program.jacobian_pattern), _sparsity(program.hessian_pattern)

        def bends(w: Array, _: Array, factor: Array, multipliers: Array) -> Array:
            return program.hessian(w, float(factor[0]), multipliers)

        cost, constraints = (lambda w, _: program.objective(w)), (lambda w, _: program.constraints(w))
        at = {"x": x, "p": p}
        self.problem = _ProgramCallback(self, "nlp", at, {"f": (one, cost), "g": (g, constraints)})
        self.gradient = _ProgramCallback(
            self, "nlp_grad_f", at, {"f": (one, cost), "grad_f_x": (x, lambda w, _: program.gradient(w))}
        )
        self.jacobian = _ProgramCallback(
            self,
            "nlp_jac_g",
            at,
            {"g": (g, constraints), "jac_g_x": (jacobian, lambda w, _: program.jacobian(w))},
        )
        self.hessian = _ProgramCallback(
            self, "nlp_hess_l", at | {"lam_f": one, "lam_g": g}, {"triu_hess_gamma_x_x": (hessian, bends)}
        )

    def options(self, watch: ca.Callback) -> dict[str, Any]:
        """Options of CasADi's interface in addition to the problem."""
        return {
            "grad_f": self.gradient,
            "jac_g": self.jacobian,
            "hess_lag": self.hessian,
            "iteration_callback": watch,
            "no_nlp_grad": True,
            "print_time": False,
        }


class _ProgramCallback(ca.Callback):
    """Python functions of arrays as a CasADi function; Ctrl-C and errors stop the solver and are stored.

    Each output is given by a sparsity and the function of its entries, which is called only if requested.
    """

    def __init__(
        self,
        bridge: _CasadiFunctions,
        name: str,
        inputs: dict[str, ca.Sparsity],
        outputs: dict[str, tuple[ca.Sparsity, Callable[..., Any]]],
    ) -> None:
        ca.Callback.__init__(self)
        self._bridge = bridge
        self._inputs, self._outputs = inputs, outputs
        self.construct(name, {})

    def get_n_in(self) -> int:
        """Number of inputs."""
        return len(self._inputs)

    def get_n_out(self) -> int:
        """Number of outputs."""
        return len(self._outputs)

    def get_name_in(self, i: int) -> str:
        """Name of an input."""
        return list(self._inputs)[i]

    def get_name_out(self, i: int) -> str:
        """Name of an output."""
        return list(self._outputs)[i]

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """Sparsity of an input."""
        return list(self._inputs.values())[i]

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        """Sparsity of an output."""
        return list(self._outputs.values())[i][0]

    def has_eval_buffer(self) -> bool:
        """True, so that CasADi calls :meth:`eval_buffer`."""
        return True

    def eval_buffer(self, inputs: Sequence[Any], outputs: Sequence[Any]) -> int:
        """Evaluate with CasADi's own memory as input and output."""
        begin = time.perf_counter()
        try:
            arrays = [
                np.zeros(place.nnz()) if one is None else np.frombuffer(one)
                for place, one in zip(self._inputs.values(), inputs, strict=True)
            ]
            for (_, function), buffer in zip(self._outputs.values(), outputs, strict=True):
                if buffer is not None:
                    np.frombuffer(buffer)[:] = function(*arrays)
        except KeyboardInterrupt:
            self._bridge.interrupted = True
        except Exception as fault:
            self._bridge.fault = fault
        finally:
            self._bridge.seconds += time.perf_counter() - begin
        return int(self._bridge.interrupted or self._bridge.fault is not None)


class _IterationCallback(_ProgramCallback):
    """Callback that reports each iteration, and stops the solver on interruption or at the time limit."""

    def __init__(
        self, program: NonlinearProgram, bridge: _CasadiFunctions, on_iteration: OnIteration | None
    ) -> None:
        sizes = {"x": program.size, "f": 1, "g": program.rows, "lam_x": program.size}
        sizes |= {"lam_g": program.rows, "lam_p": 0}
        names = [str(ca.nlpsol_out(i)) for i in range(ca.nlpsol_n_out())]
        sparsities = {n: ca.Sparsity.dense(sizes[n]) if sizes[n] else ca.Sparsity(0, 0) for n in names}
        super().__init__(bridge, "watch", sparsities, {"stop": (ca.Sparsity.dense(1), bool)})
        self._on_iteration, self._count, self._limits = on_iteration, -1, program.limits()

    def has_eval_buffer(self) -> bool:
        """False, so that CasADi calls :meth:`eval`."""
        return False

    def eval(self, iterate: Sequence[ca.DM]) -> list[Any]:
        """Report an iteration."""
        try:
            self._count += 1
            if self._on_iteration is not None:
                g = np.array(iterate[2].nonzeros())
                over = np.maximum(self._limits[0] - g, g - self._limits[1])
                late = self._on_iteration(
                    self._count, float(iterate[1]), max(float(over.max(initial=0.0)), 0.0)
                )
                self._bridge.late = bool(late)
        except KeyboardInterrupt:
            self._bridge.interrupted = True
        return [int(self._bridge.late or self._bridge.interrupted or self._bridge.fault is not None)]


def _sparsity(pattern: sparse.csc_matrix) -> ca.Sparsity:
    rows, columns = pattern.shape
    return ca.Sparsity(int(rows), int(columns), pattern.indptr.tolist(), pattern.indices.tolist())
