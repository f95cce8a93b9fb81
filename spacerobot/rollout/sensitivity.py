"""Forward sensitivities: the closed loop and its linearisation along one direction, as a kernel of its own.

A Runge-Kutta step of the linearised loop is the derivative of a Runge-Kutta step, so that the ordinary
rollout of this kernel gives exact derivatives of the discrete trajectory. Each lane carries one direction.
Where a direction moves a jump or an event, steps move and stretch with it: a last constant then holds the
derivative of time at each evaluation, and guards are followed by their derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import casadi as ca
import numpy as np

from spacerobot.rollout.kernel import Kernel, entries, slices, sx_function
from spacerobot.rollout.parameter_dependent_events import moving_events
from spacerobot.rollout.tables import places_in, reached_with

DERIVATIVE = "d "  # prefix of the names of measures' derivatives


def sensitivity_kernel(kernel: Kernel, wrt: Sequence[int], outputs: Sequence[str]) -> Kernel:
    """Kernel whose parameters are (p, direction) and whose every result is followed by its derivative.

    Parameters
    ----------
    kernel
        The forward functions.
    wrt
        Places in p of the k parameters that a direction has entries for.
    outputs
        Outputs whose derivatives are wanted.

    Returns
    -------
    Kernel
        Its state is (x, x', integrals, integrals'), its outputs are the derivatives of those wanted, its
        measures (integrals, integrals', peaks, peaks', final values, final values'), a dash being the
        derivative along the direction. The slices of a measure's derivative carry its name after ``d``. It
        has no costs.
    """
    n, count, nc = kernel.nx, kernel.integrals, kernel.size("setup", "c")
    setup, reached = _setup(kernel, wrt)
    places = tuple(nc + reached.index(jump) if jump in reached else -1 for jump in kernel.jumps)
    rate = nc + len(reached) if _moves(kernel, reached) else None
    # Where each measure and its derivative lie: each kind is followed by its derivatives.
    found: dict[str, slice] = {}
    ends = (0, kernel.integrals, kernel.integrals + kernel.peaks, kernel.size("objective", "r"))
    for begin, end in pairwise(ends):
        for name, where in kernel.measures.items():
            if begin <= where.start and where.stop <= end:
                found[name] = slice(where.start + begin, where.stop + begin)
                found[DERIVATIVE + name] = slice(where.start + end, where.stop + end)
    return Kernel(
        _functions(kernel, outputs, setup, reached),
        2 * n,
        2 * count,
        kernel.peaks,
        np.concatenate([kernel.scale[:n], np.zeros(n), kernel.scale[n:], np.zeros(count)]),
        slices({name: kernel.outputs[name].stop - kernel.outputs[name].start for name in outputs}),
        found,
        (),
        kernel.closure,
        kernel.method,
        kernel.jumps,
        kernel.switches,
        kernel.events,
        kernel.fine,
        jump_slopes=places,
        rate=rate,
        seen=kernel.seen,
        tables=kernel.tables,
        noise=kernel.noise,
        c_slopes=places_in(reached, nc, nc) if kernel.tables else (),
        moving=moving_events(kernel, wrt, reached),
    )


def _moves(kernel: Kernel, reached: Sequence[int]) -> bool:
    """Whether a direction may move a jump or an event, and with it the steps."""
    return bool(kernel.events) or any(jump in reached for jump in kernel.jumps)


def _functions(
    kernel: Kernel, outputs: Sequence[str], setup: ca.Function, reached: Sequence[int]
) -> dict[str, ca.Function]:
    """Every function of the kernel, followed by its derivative along the direction."""
    f, n, count = kernel.functions, kernel.nx, kernel.integrals
    nc = kernel.size("setup", "c")
    t, state = ca.SX.sym("t"), ca.SX.sym("x", 2 * (n + count))
    prepared = ca.SX.sym("c", setup.numel_out("c"))
    x, dx = _unpaired(state, n, count)
    end = nc + len(reached)
    c, dc = entries(prepared, slice(nc)), entries(prepared, slice(nc, end))
    rate = entries(prepared, slice(end, None))  # of time, if it moves
    at = {"t": t, "x": state, "c": prepared}

    def along(value: ca.SX) -> ca.SX:
        moving = t if rate.numel() else ca.SX(0, 1)
        return _along(value, ca.vertcat(x, entries(c, reached), moving), ca.vertcat(dx, dc, rate))

    xdot, m = f["dynamics"](t, x, c)
    normal, e, y = f["normalise"](x), f["final"](t, x, c), f["outputs"](t, x, c)
    wanted = ca.vertcat(ca.SX(0, 1), *[entries(y, kernel.outputs[name]) for name in outputs])
    moved = {"xdot": _paired(xdot, along(xdot), n), "m": ca.vertcat(m, along(m))}
    hybrid = {}
    if kernel.events:
        slope, event = ca.SX.sym("xdot", state.numel()), ca.SX.sym("e")
        g, g_rate = f["guards"](t, x, c, _unpaired(slope, n, count)[0])
        after = f["update"](t, x, c, event)
        told = {"g": g, "rate": g_rate, "slope": along(g)}
        hybrid["guards"] = sx_function("guards", {**at, "xdot": slope}, told)
        hybrid["values"] = sx_function("values", at, {"g": g, "speed": f["values"](t, x, c)[1]})
        updated = {"x_after": _paired(after, along(after), n)}
        hybrid["update"] = sx_function("update", {**at, "e": event}, updated)
    if kernel.tables:
        hybrid["rows"] = sx_function("rows", at, {"row": ca.SX(f["rows"](t, x, c))})
    return hybrid | {
        "setup": setup,
        "dynamics": sx_function("dynamics", at, moved),
        "normalise": sx_function("normalise", {"x": state}, {"n": _paired(normal, along(normal), n)}),
        "outputs": sx_function("outputs", at, {"y": along(wanted)}),
        "final": sx_function("final", at, {"e": ca.vertcat(e, along(e))}),
        "objective": sx_function(
            "objective",
            {
                "r": ca.SX.sym("r", (2 * kernel.size("objective", "r"))),
                "p": ca.SX.sym("p", setup.numel_in("p")),
            },
            {"J": ca.SX(0, 1)},
        ),
    }


def _setup(kernel: Kernel, wrt: Sequence[int]) -> tuple[ca.Function, list[int]]:
    """``setup``, and the places of the prepared constants that a direction reaches: only they have slopes."""
    p, w = ca.SX.sym("p", kernel.size("setup", "p")), ca.SX.sym("w", len(wrt))
    wanted, n = p[list(wrt)], kernel.nx
    x0, c0 = kernel.functions["setup"](p)
    reached = sorted(reached_with(kernel.tables, set(ca.jacobian_sparsity(c0, wanted).row())))
    slope, c_slope = _along(x0, wanted, w), _along(entries(c0, reached), wanted, w)
    rate = ca.SX.zeros(1 if _moves(kernel, reached) else 0)
    prepared = {"x0": _paired(x0, slope, n), "c": ca.vertcat(c0, c_slope, rate)}
    return sx_function("setup", {"p": ca.vertcat(p, w)}, prepared), reached


def _paired(value: ca.SX, slope: ca.SX, n: int) -> ca.SX:
    """State, its derivative, integrals, their derivatives; n entries are the state's."""
    head, tail = slice(n), slice(n, None)
    return ca.vertcat(*(entries(part, where) for where in (head, tail) for part in (value, slope)))


def _unpaired(pair: ca.SX, n: int, count: int) -> tuple[ca.SX, ca.SX]:
    """State and ``count`` integrals, and their derivatives."""
    cuts = (slice(n), slice(n, 2 * n), slice(2 * n, 2 * n + count), slice(2 * n + count, None))
    x, dx, sums, dsums = (entries(pair, cut) for cut in cuts)
    return ca.vertcat(x, sums), ca.vertcat(dx, dsums)


def _along(value: ca.SX, variables: ca.SX, direction: ca.SX) -> ca.SX:
    if value.numel() == 0 or variables.numel() == 0:
        return ca.SX.zeros(value.numel())
    return ca.densify(ca.jtimes(value, variables, direction))
