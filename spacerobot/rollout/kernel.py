"""Functions that a rollout evaluates, built from a closed loop and the requested measures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from spacerobot.rollout.check_measures import check_measures
from spacerobot.rollout.closed_loop_protocol import Array, ClosedLoopFunctions, EventRule
from spacerobot.rollout.initial_gaps import Closure
from spacerobot.rollout.measures import Measures, Signals
from spacerobot.rollout.methods import DEFAULT, METHODS, Tableau
from spacerobot.rollout.noise import NoiseInput
from spacerobot.symbolic import WindowTable

POSITION_LIMIT = VELOCITY_LIMIT = 1e6
CONTROLLER_LIMIT = 1e12


@dataclass(frozen=True)
class Kernel:
    """Functions of a rollout, all SX with dense arguments.

    Attributes:
        functions: ``setup``, ``dynamics``, ``normalise``, ``outputs``, ``final`` and ``objective``, and
            ``guards``, ``values`` and ``update`` where there are events, ``rows`` where there are tables, as
            ``loops/steps.hpp`` lists them.
        nx: Length of the closed loop's state; integrals follow it.
        integrals, peaks: Number of integrals and of peaks.
        scale: Reciprocal of the largest allowed departure of each state from its initial value, shape (nx +
            integrals,).
        outputs, measures: Slice of each named vector in y and in r.
        costs: Names of the entries of J.
        closure: Grasps that must be closed at the start of a rollout.
        method: Integration method.
        jumps: Indices in c of the times at which the dynamics jump.
        switches, events, fine: Indices in c of the switches; the events; triples of an index in ``switches``,
            the longest step [s] while that switch is on, and the number of such steps over which steps grow
            after switching on and shrink before switching off.
        jump_bars: Adjoint kernels: indices in cbar of the adjoints of jump times, -1 for a jump that the
            parameters do not move.
        tables: Tables in c.
        c_bars, c_slopes: If there are tables: index of each constant's adjoint in cbar and of its derivative
            in c, or -1.
        guard_states: Indices in x of the states that events change and guards depend on.
        moving: Derivative kernels: whether parameters may move the time of each event.
        names: Names of the entries of x; the integrals of measures follow the states.
        noise: Random numbers that windows of tables read.
        jump_slopes, rate: Forward sensitivities: indices in c of the derivatives of jump times (-1 if
            constant), and of the derivative of time if any jump moves.
    """

    functions: Mapping[str, ca.Function]
    nx: int
    integrals: int
    peaks: int
    scale: Array
    outputs: Mapping[str, slice]
    measures: Mapping[str, slice]
    costs: tuple[str, ...]
    closure: Closure
    method: Tableau
    jumps: tuple[int, ...]
    switches: tuple[int, ...] = ()
    events: tuple[EventRule, ...] = ()
    fine: tuple[tuple[int, float, float], ...] = ()
    jump_bars: tuple[int, ...] = ()
    jump_slopes: tuple[int, ...] = ()
    rate: int | None = None
    guard_states: tuple[int, ...] = ()
    tables: tuple[WindowTable, ...] = ()
    c_bars: tuple[int, ...] = ()
    c_slopes: tuple[int, ...] = ()
    moving: tuple[bool, ...] = ()
    names: tuple[str, ...] = ()
    noise: NoiseInput = field(default_factory=NoiseInput)

    @property
    def gaps(self) -> tuple[int, ...]:
        """Indices of events whose guard is minus a gap, in the order of the speeds from ``values``."""
        return tuple(number for number, event in enumerate(self.events) if event.gap)

    def size(self, function: str, argument: str) -> int:
        """Length of an argument of a function."""
        f = self.functions[function]
        size = f.numel_out(argument) if argument in f.name_out() else f.numel_in(argument)
        return int(size)


def sx_function(name: str, inputs: Mapping[str, ca.SX], outputs: Mapping[str, ca.SX]) -> ca.Function:
    """SX function with named dense arguments and common subexpressions merged."""
    dense = [ca.densify(ca.SX(value)) for value in outputs.values()]
    return ca.Function(name, list(inputs.values()), dense, list(inputs), list(outputs), {"cse": True})


def build_kernel(
    loop: ClosedLoopFunctions, measures: Measures | None = None, method: Tableau = METHODS[DEFAULT]
) -> Kernel:
    """Kernel of a rollout that also evaluates measures.

    Args:
        loop: The closed loop.
        measures: Measures to evaluate; none if None.
        method: Integration method.

    Raises:
        SpaceRobotError: If a measure or a cost depends on an output where it does not exist.
    """
    measures = measures or Measures(Signals.of(loop), {})
    nx = loop.dynamics.numel_in(1)
    integrals = measures.of_kind("integral")
    summed = [f"the integral {name!r}" for name, e in integrals.items() for _ in range(e.numel())]
    count = len(summed)
    p, t = ca.SX.sym("p", len(loop.parameter_paths)), ca.SX.sym("t")
    state, sums = ca.SX.sym("x", nx), ca.SX.sym("sums", count)
    # paths of the parameters that occur in the measures themselves
    written = ca.vertcat(ca.SX(0, 1), *[m.expression for m in measures.named.values()])
    signals = measures.signals
    used = [path for path, symbol in signals.parameters.items() if ca.depends_on(written, symbol)]
    prepared, measure_parameters = ca.SX.sym("c", loop.setup.numel_out(1)), ca.SX.sym("p", len(used))
    x, c = ca.vertcat(state, sums), ca.vertcat(prepared, measure_parameters)
    result = loop.outputs(t, state, prepared)
    y = [ca.SX(part) for part in result] if isinstance(result, tuple | list) else [ca.SX(result)]
    check_measures(loop, measures, y)
    symbols = [signals.t, signals.x, *signals.outputs.values(), *[signals.parameters[path] for path in used]]
    values = [t, state, *y, *ca.vertsplit(measure_parameters)]

    def stacked(expressions: Mapping[str, ca.SX]) -> ca.SX:
        stack = ca.vertcat(ca.SX(0, 1), *expressions.values())
        return ca.substitute([stack], symbols, values)[0] if stack.numel() else stack

    xdot = ca.vertcat(loop.dynamics(t, state, prepared), stacked(integrals))
    at, peaks = {"t": t, "x": x, "c": c}, stacked(measures.of_kind("peak"))
    # of the closed loop, with integrals that begin at zero and the parameters that the measures use
    x0, c0 = loop.setup(p)
    order = {path: i for i, path in enumerate(loop.parameter_paths)}
    initial = {
        "x0": ca.vertcat(x0, ca.SX.zeros(count)),
        "c": ca.vertcat(c0, *[p[order[path]] for path in used]),
    }
    functions = {
        "setup": sx_function("setup", {"p": p}, initial),
        "dynamics": sx_function("dynamics", at, {"xdot": xdot, "m": peaks}),
        "normalise": sx_function("normalise", {"x": x}, {"n": ca.vertcat(loop.normalise(state), sums)}),
        "outputs": sx_function("outputs", at, {"y": ca.vertcat(*y)}),
        "final": sx_function("final", at, {"e": stacked(measures.of_kind("final"))}),
    }
    if loop.tables:
        functions["rows"] = sx_function("rows", at, {"row": ca.SX(loop.rows(t, state, prepared))})
    guard_states: tuple[int, ...] = ()
    if loop.events:
        # guards, their values with the speeds of gaps, and updates, which leave the integrals alone
        slope, e = ca.SX.sym("xdot", nx), ca.SX.sym("e")
        g, rate, speed = loop.guards(t, state, prepared, slope)
        after = ca.vertcat(loop.update(t, state, prepared, e), sums)
        slopes = ca.vertcat(slope, ca.SX.sym("y", count))
        functions |= {
            "guards": sx_function("guards", {**at, "xdot": slopes}, {"g": g, "rate": rate}),
            "values": sx_function("values", at, {"g": g, "speed": speed}),
            "update": sx_function("update", {**at, "e": e}, {"x_after": after}),
        }
        # places in x of what changes between events and guards depend on
        places = functions["values"].jac_sparsity
        looked = {place for output in (0, 1) for place in places(output, 1).get_triplet()[1]}
        guard_states = tuple(sorted(looked & set(ca.sparsify(ca.SX(xdot)).sparsity().row())))
    r = ca.SX.sym("r", sum(measures.sizes.values()))
    named_measures = {name: entries(r, where) for name, where in slices(measures.sizes).items()}
    costs = measures.cost_expressions(
        named_measures, dict(zip(loop.parameter_paths, ca.vertsplit(p), strict=True))
    )
    stack = ca.vertcat(ca.SX(0, 1), *costs.values())
    functions["objective"] = sx_function("objective", {"r": r, "p": p}, {"J": stack})
    limits = [POSITION_LIMIT] * loop.nq + [VELOCITY_LIMIT] * loop.nv
    scale = 1 / np.array(limits + [CONTROLLER_LIMIT] * (loop.nz + count))
    return Kernel(
        functions,
        nx,
        count,
        peaks.numel(),
        scale,
        slices({name: loop.outputs.numel_out(name) for name in loop.outputs.name_out()}),
        slices(measures.sizes),
        tuple(costs),
        Closure(loop.gaps, loop.max_gaps),
        method,
        tuple(loop.jumps),
        tuple(loop.switches),
        tuple(loop.events),
        tuple(loop.fine),
        guard_states=guard_states,
        tables=tuple(loop.tables),
        names=(*loop.state_names, *summed),
        noise=NoiseInput.of(getattr(loop, "noise", ()), list(loop.parameter_paths)),
    )


def entries(column: ca.SX, places: slice | Sequence[int]) -> ca.SX:
    """Some entries of a column; of a column of one, ``column[places]`` may be a row."""
    return column[places, 0]


def slices(sizes: Mapping[str, int]) -> dict[str, slice]:
    """Consecutive slices for named vectors of given lengths."""
    ends = np.cumsum([0, *sizes.values()])
    return {name: slice(int(a), int(b)) for name, a, b in zip(sizes, ends[:-1], ends[1:], strict=True)}
