"""Exact gradients of costs by the discrete adjoint: one sweep back, whatever the number of parameters."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import casadi as ca
import numpy as np

from spacerobot.compiled import Library
from spacerobot.errors import CompileError
from spacerobot.rollout.engines import InterpretedEngine, Raw, StopFlag, make_job
from spacerobot.rollout.grid import INWARD, TimeGrid
from spacerobot.rollout.kernel import Kernel, sx_function
from spacerobot.rollout.protocol import Array

WHOLE_BYTES = 128 * 2**20
"""Longest tape that holds a whole rollout, for each thread and over the number of lanes: a group of lanes
integrates a piece once more in about the time of a single rollout, but its tape is so many times longer."""

SEGMENT_BYTES = 2**20
"""Tape of longer rollouts, which are integrated once more between checkpoints: it stays in a core's cache."""


def adjoint_kernel(kernel: Kernel, wrt: Sequence[int]) -> Kernel:
    """The kernel and the reverse of each of its functions, as ``rollout.hpp`` lists them.

    Parameters
    ----------
    kernel
        The forward functions.
    wrt
        Places in p of the parameters that gradients are asked for. Only the prepared constants that these
        reach take part in the sweep back.
    """
    sizes = {name: kernel.size("dynamics", name) for name in ("x", "c", "m")}
    t, x, c = ca.SX.sym("t"), ca.SX.sym("x", sizes["x"]), ca.SX.sym("c", sizes["c"])
    p = ca.SX.sym("p", kernel.size("setup", "p"))
    wanted = p[list(wrt)]
    x0, c0 = kernel.functions["setup"](p)
    reached = sorted(set(ca.jacobian_sparsity(c0, wanted).row()))
    constants = c[reached]
    at = {"t": t, "x": x, "c": c}
    xbar, cbar = ca.SX.sym("xbar", sizes["x"]), ca.SX.sym("cbar", len(reached))
    xdot, m = kernel.functions["dynamics"](t, x, c)
    final = ca.SX(kernel.functions["final"](t, x, c))
    r = ca.SX.sym("r", kernel.size("objective", "r"))
    cost = ca.SX(kernel.functions["objective"](r, p))
    normal = kernel.functions["normalise"](x)

    def reverse(name: str, value: ca.SX, bar: str) -> ca.Function:
        seed = ca.SX.sym(bar, value.numel())
        back = _transposed(value, ca.vertcat(x, constants), seed)
        return sx_function(name, {**at, bar: seed}, {"xbar": back[: x.numel()], "cbar": back[x.numel() :]})

    nbar, jbar = ca.SX.sym("nbar", sizes["x"]), ca.SX.sym("Jbar", cost.numel())
    toward = _transposed(cost, ca.vertcat(r, wanted), jbar)
    back = _transposed(ca.vertcat(x0, c0[reached]), wanted, ca.vertcat(xbar, cbar))
    functions = dict(kernel.functions) | {
        "dynamics_reverse": reverse("dynamics_reverse", xdot, "vbar"),
        "peaks_reverse": reverse("peaks_reverse", m, "mbar"),
        "final_reverse": reverse("final_reverse", final, "ebar"),
        "normalise_reverse": sx_function(
            "normalise_reverse", {"x": x, "nbar": nbar}, {"xbar": _transposed(normal, x, nbar)}
        ),
        "objective_reverse": sx_function(
            "objective_reverse",
            {"r": r, "p": p, "Jbar": jbar},
            {"rbar": toward[: r.numel()], "pbar": toward[r.numel() :]},
        ),
        "setup_reverse": sx_function("setup_reverse", {"p": p, "xbar": xbar, "cbar": cbar}, {"pbar": back}),
    }
    return replace(kernel, functions=functions)


def _transposed(value: ca.SX, variables: ca.SX, seed: ca.SX) -> ca.SX:
    """Transposed Jacobian times a seed, dense also where nothing depends on anything."""
    if value.numel() == 0 or variables.numel() == 0:
        return ca.SX.zeros(variables.numel())
    return ca.densify(ca.jtimes(value, variables, seed, True))


class AdjointEngine(Protocol):
    """Evaluates costs and their gradients."""

    @property
    def backend(self) -> str:
        """``compiled`` or ``interpreted``."""

    @property
    def lanes(self) -> int:
        """Rollouts carried at once."""

    def gradients(
        self, p: Array, seed: Array, grid: TimeGrid, raw: Raw, gradient: Array, stop: StopFlag
    ) -> None:
        """Fill ``raw`` and ``gradient`` (N, k) for rows p (N, np) and cost weights ``seed`` (N, nj)."""


class _AdjointJob(ctypes.Structure):
    _fields_ = (("seed", ctypes.c_void_p), ("gradient", ctypes.c_void_p), ("segment", ctypes.c_int64))


@dataclass(frozen=True)
class CompiledAdjoint:
    """Forward sweep, tape and sweep back in machine code."""

    kernel: Kernel
    library: Library
    whole_bytes: int = WHOLE_BYTES
    segment_bytes: int = SEGMENT_BYTES
    backend: str = field(default="compiled", init=False)

    @property
    def lanes(self) -> int:
        """Rollouts carried at once."""
        return self.library.lanes

    def gradients(
        self, p: Array, seed: Array, grid: TimeGrid, raw: Raw, gradient: Array, stop: StopFlag
    ) -> None:
        """Costs and gradients of every row; see :class:`AdjointEngine`."""
        job, _keep = make_job(self.kernel, p, grid, raw, (), stop)
        per_step = 5 * self.kernel.scale.size * 8 * self.lanes
        whole = grid.steps * per_step <= self.whole_bytes // self.lanes
        segment = grid.steps if whole else min(grid.steps, max(1, self.segment_bytes // per_step))
        seeds = np.ascontiguousarray(seed)
        adjoint = _AdjointJob(seeds.ctypes.data, gradient.ctypes.data, segment)
        entry = self.library.entry("gradients")
        entry.restype = ctypes.c_int64
        if entry(ctypes.byref(job), ctypes.byref(adjoint)) < 0:
            raise CompileError(f"no memory for a tape of {segment} steps")


@dataclass(frozen=True)
class InterpretedAdjoint:
    """The same sweeps, step by step from Python: slow, the same numbers."""

    kernel: Kernel
    backend: str = field(default="interpreted", init=False)
    lanes: int = field(default=1, init=False)

    def gradients(
        self, p: Array, seed: Array, grid: TimeGrid, raw: Raw, gradient: Array, stop: StopFlag
    ) -> None:
        """Costs and gradients of every row; see :class:`AdjointEngine`."""
        engine, objective = InterpretedEngine(self.kernel), self.kernel.functions["objective"]
        for i, row in enumerate(p):
            if stop.is_set:
                return
            c, x, m, done = engine.course(row, grid)
            raw.done[i] = done
            if done == grid.steps:
                raw.r[i] = engine.reduce(c, x, m, grid)
                gradient[i] = self._back(row, seed[i], raw.r[i], c, x, m, grid)
            raw.cost[i] = objective(raw.r[i], row).full().ravel()

    def _back(self, p: Array, seed: Array, r: Array, c: Array, x: Array, m: Array, grid: TimeGrid) -> Array:
        f, kernel = self.kernel.functions, self.kernel
        rbar, direct = (part.full().ravel() for part in f["objective_reverse"](r, p, seed))
        first, last = kernel.integrals, kernel.integrals + kernel.peaks
        when = m.argmax(axis=0) if kernel.peaks else np.empty(0, dtype=int)
        end_s = (grid.steps - INWARD) * grid.step_s
        xbar, cbar = (part.full().ravel() for part in f["final_reverse"](end_s, x[-1], c, rbar[last:]))
        xbar[kernel.nx :] += rbar[:first]
        for k in range(grid.steps, -1, -1):
            if k < grid.steps:
                xbar, part = self._step_back(k, grid.step_s, c, x[k], xbar)
                cbar = cbar + part
            if (when == k).any():
                mbar = np.where(when == k, rbar[first:last], 0.0)
                instant_s = (k + INWARD if k < grid.steps else k - INWARD) * grid.step_s
                more = [v.full().ravel() for v in f["peaks_reverse"](instant_s, x[k], c, mbar)]
                xbar, cbar = xbar + more[0], cbar + more[1]
        return np.asarray(f["setup_reverse"](p, xbar, cbar).full().ravel() + direct, dtype=np.float64)

    def _step_back(self, k: int, h: float, c: Array, x: Array, xbar: Array) -> tuple[Array, Array]:
        f = self.kernel.functions
        times = ((k + INWARD) * h, (k + 0.5) * h, (k + 0.5) * h, (k + 1 - INWARD) * h)
        reach = (h / 2, h / 2, h, 0.0)
        weight = (h / 6, h / 3, h / 3, h / 6)
        stages, total = [x], x
        for s in range(4):
            slope = f["dynamics"](times[s], stages[s], c)[0].full().ravel()
            total = total + weight[s] * slope
            stages.append(x + reach[s] * slope)
        sum_bar = f["normalise_reverse"](total, xbar).full().ravel()
        back, cbar, stage_bar = sum_bar.copy(), 0.0, np.zeros_like(x)
        for s in (3, 2, 1, 0):
            seed = weight[s] * sum_bar + reach[s] * stage_bar
            stage_bar, part = (v.full().ravel() for v in f["dynamics_reverse"](times[s], stages[s], c, seed))
            back, cbar = back + stage_bar, cbar + part
        return back, np.asarray(cbar)
