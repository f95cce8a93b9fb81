"""Exact gradients of costs by the discrete adjoint: one backward pass, whatever the number of parameters."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from spacerobot.common.errors import CompileError
from spacerobot.rollout.closed_loop_protocol import Array
from spacerobot.rollout.engines import Engine, StopFlag, make_job
from spacerobot.rollout.kernel import Kernel, entries, slices, sx_function
from spacerobot.rollout.parameter_dependent_events import moving_events
from spacerobot.rollout.rollout_arrays import RolloutArrays
from spacerobot.rollout.tables import places_in, reached_with, sources
from spacerobot.rollout.time_grid import TimeGrid

WHOLE_BYTES = 128 * 2**20
"""Maximum tape [bytes] of a whole rollout per thread, divided by the number of lanes.

Above it a rollout is integrated piece by piece, once more in the backward pass. For a group of lanes that
takes about the time of a single rollout, whereas its tape is as many times longer as it has lanes.
"""

FEWEST = 8
"""Minimum number of steps between two jumps of a sample interval, as in ``loops/steps.hpp``."""

SEGMENT_BYTES = 2**20
"""Tape [bytes] of one piece of a longer rollout, integrated again from a checkpoint: it fits in cache."""


def adjoint_kernel(kernel: Kernel, wrt: Sequence[int]) -> Kernel:
    """Kernel with the reverse (vector-Jacobian product) of each function, as listed in ``loops/adjoint.hpp``.

    Args:
        kernel: The forward functions.
        wrt: Indices in p of the parameters to differentiate with respect to. Only the prepared constants that
            depend on these get adjoints.
    """
    sizes = {name: kernel.size("dynamics", name) for name in ("x", "c", "m")}
    t, x, c = ca.SX.sym("t"), ca.SX.sym("x", sizes["x"]), ca.SX.sym("c", sizes["c"])
    # reverse of setup and objective, and the places of the prepared constants that parameters reach; those
    # that no other function sees, the rows of tables, come last
    p, r = ca.SX.sym("p", kernel.size("setup", "p")), ca.SX.sym("r", kernel.size("objective", "r"))
    varied = p[list(wrt)]
    x0, c0 = kernel.functions["setup"](p)
    table_entries = sources(kernel.tables)
    entries_reached = reached_with(kernel.tables, set(ca.jacobian_sparsity(c0, varied).row()))
    reached = sorted(entries_reached, key=lambda place: (place in table_entries, place))
    xbar, cbar = ca.SX.sym("xbar", x0.numel()), ca.SX.sym("cbar", len(reached))
    cost = ca.SX(kernel.functions["objective"](r, p))
    jbar = ca.SX.sym("Jbar", cost.numel())
    toward = _transposed(cost, ca.vertcat(r, varied), jbar)
    back = _transposed(ca.vertcat(x0, entries(c0, reached)), varied, ca.vertcat(xbar, cbar))
    ends = {"rbar": entries(toward, slice(r.numel())), "pbar": entries(toward, slice(r.numel(), None))}
    constants = entries(c, [place for place in reached if place not in sources(kernel.tables)])
    at = {"t": t, "x": x, "c": c}
    xdot, m = kernel.functions["dynamics"](t, x, c)
    final = ca.SX(kernel.functions["final"](t, x, c))
    normal, nbar = kernel.functions["normalise"](x), ca.SX.sym("nbar", sizes["x"])
    jump_places = tuple(reached.index(jump) if jump in reached else -1 for jump in kernel.jumps)
    bar_places = places_in(reached, sizes["c"]) if kernel.tables else ()
    event_time = t if max(jump_places, default=-1) >= 0 or kernel.events else ca.SX(0, 1)

    def reverse(name: str, value: ca.SX, bar: str, time: ca.SX, **arguments: ca.SX) -> ca.Function:
        seed = ca.SX.sym(bar, value.numel())
        parts = {"xbar": x, "cbar": constants, "tbar": time}
        back = _transposed(value, ca.vertcat(*parts.values()), seed)
        places = slices({name: part.numel() for name, part in parts.items()})
        split = {name: entries(back, where) for name, where in places.items()}
        return sx_function(name, {**at, **arguments, bar: seed}, split)

    functions = {**kernel.functions} | {
        "objective_reverse": sx_function("objective_reverse", {"r": r, "p": p, "Jbar": jbar}, ends),
        "setup_reverse": sx_function("setup_reverse", {"p": p, "xbar": xbar, "cbar": cbar}, {"pbar": back}),
        "dynamics_reverse": reverse("dynamics_reverse", xdot, "vbar", event_time),
        "peaks_reverse": reverse("peaks_reverse", m, "mbar", event_time),
        "final_reverse": reverse("final_reverse", final, "ebar", t if kernel.events else ca.SX(0, 1)),
        "normalise_reverse": sx_function(
            "normalise_reverse", {"x": x, "nbar": nbar}, {"xbar": _transposed(normal, x, nbar)}
        ),
    }
    if kernel.events:
        e = ca.SX.sym("e")
        guards = kernel.functions["guards"](t, x, c, ca.SX.zeros(sizes["x"]))[0]
        after = ca.SX(kernel.functions["update"](t, x, c, e))
        functions["guards_reverse"] = reverse("guards_reverse", guards, "gbar", t)
        functions["update_reverse"] = reverse("update_reverse", after, "after_bar", t, e=e)
    moving = moving_events(kernel, wrt, reached)
    return replace(kernel, functions=functions, jump_bars=jump_places, c_bars=bar_places, moving=moving)


def _transposed(value: ca.SX, variables: ca.SX, seed: ca.SX) -> ca.SX:
    """Transposed Jacobian of ``value`` times a seed (n,), stored dense even where its entries are zero."""
    if value.numel() == 0 or variables.numel() == 0:
        return ca.SX.zeros(variables.numel())
    return ca.densify(ca.jtimes(value, variables, seed, True))


class _AdjointJob(ctypes.Structure):
    _fields_ = (
        ("seed", ctypes.c_void_p),
        ("gradient", ctypes.c_void_p),
        ("segment", ctypes.c_int64),
        ("most", ctypes.c_int64),
        ("instants", ctypes.c_void_p),
        ("instant", ctypes.c_void_p),
        ("width", ctypes.c_int64),
    )


@dataclass(frozen=True)
class AdjointEngine(Engine):
    """Loops that evaluate a kernel with its reverse: forward sweep, tape and sweep back."""

    whole_bytes: int = WHOLE_BYTES
    segment_bytes: int = SEGMENT_BYTES

    @property
    def bytes_per_step(self) -> int:
        """Room on the tape: a state and the slopes of all stages."""
        return (1 + self.kernel.method.stages) * self.kernel.scale.size * 8 * self.lanes

    def gradients(
        self, p: Array, seed: Array, grid: TimeGrid, raw: RolloutArrays, gradient: Array, stop: StopFlag
    ) -> None:
        """Fill ``raw`` and ``gradient`` (N, k) for rows p (N, np) and cost weights ``seed`` (N, nj)."""
        job, _keep = make_job(self.kernel, p, grid, raw, (), stop)
        per_step = self.bytes_per_step
        is_stored = grid.steps * per_step <= self.whole_bytes // self.lanes
        more = (int(FEWEST / grid.finer) + 2) * self.lanes * len(self.kernel.jumps)
        more += grid.steps // 2 if self.kernel.events else 0  # lengths tried, steps cut short
        segment = grid.steps + more if is_stored else min(grid.steps, max(1, self.segment_bytes // per_step))
        seeds = np.ascontiguousarray(seed)
        instants = raw.instants
        instants_job: tuple[int, int | None, int | None, int] = (0, None, None, 0)
        if instants is not None:
            records = instants.records
            instants_job = (
                records.shape[1],
                instants.count.ctypes.data,
                records.ctypes.data,
                records.itemsize // 8,
            )
        adjoint = _AdjointJob(seeds.ctypes.data, gradient.ctypes.data, segment, *instants_job)
        if self.loops.run("gradients", job, adjoint) < 0:
            raise CompileError(f"no memory for a tape of {segment} steps")
