"""Forward sensitivities: a kernel of the closed loop and its linearisation along one direction.

A Runge-Kutta step of the linearised loop is the derivative of a Runge-Kutta step, so an ordinary rollout of
this kernel gives exact derivatives of the discrete trajectory. Each lane carries one direction. If a
direction moves a jump or an event, the steps around it move and stretch. An additional last constant then
holds the derivative of time at each evaluation, and guards are followed by their derivatives.
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
    """Kernel with parameters (p, direction), in which the derivative of each result follows the result.

    Args:
        kernel: The forward functions.
        wrt: Indices in p of the k parameters of a direction.
        outputs: Names of the outputs to differentiate.

    Returns:
        Kernel: Its state is (x, x', integrals, integrals'), where ' is the derivative along the direction.
            Its outputs are the derivatives of the named ones, its measures (integrals, integrals', peaks,
            peaks', final values, final values'). The slices of a measure's derivative carry its name after
            ``d``. It has no costs.
    """
    f, n, count, nc = kernel.functions, kernel.nx, kernel.integrals, kernel.size("setup", "c")
    # setup, and the indices of the prepared constants that depend on the direction: only they have
    # derivatives
    p, w = ca.SX.sym("p", kernel.size("setup", "p")), ca.SX.sym("w", len(wrt))
    parameters = p[list(wrt)]
    x0, c0 = f["setup"](p)
    reached = sorted(reached_with(kernel.tables, set(ca.jacobian_sparsity(c0, parameters).row())))
    slope, c_slope = _along(x0, parameters, w), _along(entries(c0, reached), parameters, w)
    # whether a direction may move a jump or an event, and with it the steps
    moves = bool(kernel.events) or any(jump in reached for jump in kernel.jumps)
    initial = {"x0": _paired(x0, slope, n), "c": ca.vertcat(c0, c_slope, ca.SX.zeros(int(moves)))}
    setup = sx_function("setup", {"p": ca.vertcat(p, w)}, initial)
    places = tuple(nc + reached.index(jump) if jump in reached else -1 for jump in kernel.jumps)
    # every function, followed by its derivative along the direction
    t, state = ca.SX.sym("t"), ca.SX.sym("x", 2 * (n + count))
    prepared = ca.SX.sym("c", setup.numel_out("c"))
    x, dx = _unpaired(state, n, count)
    last = nc + len(reached)
    c, dc = entries(prepared, slice(nc)), entries(prepared, slice(nc, last))
    rate = entries(prepared, slice(last, None))  # of time, if it moves
    at = {"t": t, "x": state, "c": prepared}

    def along(value: ca.SX) -> ca.SX:
        moving = t if rate.numel() else ca.SX(0, 1)
        return _along(value, ca.vertcat(x, entries(c, reached), moving), ca.vertcat(dx, dc, rate))

    xdot, m = f["dynamics"](t, x, c)
    normal, e, y = f["normalise"](x), f["final"](t, x, c), f["outputs"](t, x, c)
    differentiated = ca.vertcat(ca.SX(0, 1), *[entries(y, kernel.outputs[name]) for name in outputs])
    results = {"xdot": _paired(xdot, along(xdot), n), "m": ca.vertcat(m, along(m))}
    functions = {
        "setup": setup,
        "dynamics": sx_function("dynamics", at, results),
        "normalise": sx_function("normalise", {"x": state}, {"n": _paired(normal, along(normal), n)}),
        "outputs": sx_function("outputs", at, {"y": along(differentiated)}),
        "final": sx_function("final", at, {"e": ca.vertcat(e, along(e))}),
    }
    if kernel.events:
        xdots, event = ca.SX.sym("xdot", state.numel()), ca.SX.sym("e")
        g, g_rate = f["guards"](t, x, c, _unpaired(xdots, n, count)[0])
        after = f["update"](t, x, c, event)
        guard_outputs = {"g": g, "rate": g_rate, "slope": along(g)}
        updated = {"x_after": _paired(after, along(after), n)}
        functions["guards"] = sx_function("guards", {**at, "xdot": xdots}, guard_outputs)
        functions["values"] = sx_function("values", at, {"g": g, "speed": f["values"](t, x, c)[1]})
        functions["update"] = sx_function("update", {**at, "e": event}, updated)
    if kernel.tables:
        functions["rows"] = sx_function("rows", at, {"row": ca.SX(f["rows"](t, x, c))})
    r = ca.SX.sym("r", 2 * kernel.size("objective", "r"))
    none = {"r": r, "p": ca.SX.sym("p", setup.numel_in("p"))}
    functions["objective"] = sx_function("objective", none, {"J": ca.SX(0, 1)})
    # Slices of each measure and its derivative: each kind is followed by its derivatives.
    measure_rows: dict[str, slice] = {}
    ends = (0, kernel.integrals, kernel.integrals + kernel.peaks, kernel.size("objective", "r"))
    for begin, end in pairwise(ends):
        for name, where in kernel.measures.items():
            if begin <= where.start and where.stop <= end:
                measure_rows[name] = slice(where.start + begin, where.stop + begin)
                measure_rows[DERIVATIVE + name] = slice(where.start + end, where.stop + end)
    return Kernel(
        functions,
        2 * n,
        2 * count,
        kernel.peaks,
        np.concatenate([kernel.scale[:n], np.zeros(n), kernel.scale[n:], np.zeros(count)]),
        slices({name: kernel.outputs[name].stop - kernel.outputs[name].start for name in outputs}),
        measure_rows,
        (),
        kernel.closure,
        kernel.method,
        kernel.jumps,
        kernel.switches,
        kernel.events,
        kernel.fine,
        jump_slopes=places,
        rate=last if moves else None,
        guard_states=kernel.guard_states,
        tables=kernel.tables,
        noise=kernel.noise,
        c_slopes=places_in(reached, nc, nc) if kernel.tables else (),
        moving=moving_events(kernel, wrt, reached),
    )


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
