"""Closed loops derived from others: with parameters tied to common variables, or with further states.

Rollouts treat the result as any closed loop. Exact gradients are therefore with respect to the variables, and
a variable costs one direction of differentiation, whatever the number of parameters that it sets.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import casadi as ca
import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.rollout import ClosedLoopFunctions, EventRule, Signals
from spacerobot.rollout.closed_loop_protocol import OutputRule
from spacerobot.symbolic import NoiseTable, WindowTable


@dataclass(frozen=True, kw_only=True)
class DerivedLoop:
    """A closed loop by its functions; see ``spacerobot.rollout.ClosedLoopFunctions``."""

    parameter_paths: tuple[str, ...]
    parameter_values: Array
    state_names: tuple[str, ...]
    nq: int
    nv: int
    setup: ca.Function
    dynamics: ca.Function
    normalise: ca.Function
    outputs: ca.Function
    gaps: ca.Function
    rows: ca.Function
    guards: ca.Function
    update: ca.Function
    nz: int = 0
    max_gaps: Mapping[str, float] = field(default_factory=dict)
    jumps: tuple[int, ...] = ()
    switches: tuple[int, ...] = ()
    events: Sequence[EventRule] = ()
    fine: tuple[tuple[int, float, float], ...] = ()
    tables: Sequence[WindowTable] = ()
    variables: Sequence[OutputRule] = ()
    noise: Sequence[NoiseTable] = ()

    @classmethod
    def of(cls, loop: ClosedLoopFunctions, **changes: Any) -> DerivedLoop:
        """Copy of a loop with changed attributes."""
        same = {one.name: getattr(loop, one.name) for one in fields(cls) if one.name not in changes}
        return cls(**same, **changes)


def tie(
    loop: ClosedLoopFunctions, tied: Mapping[str, Sequence[str]], nominal: Sequence[float]
) -> DerivedLoop:
    """The closed loop with each group of parameters replaced by one that has the group's name.

    Args:
        loop: The closed loop.
        tied: Paths by the name of the parameter that replaces them.
        nominal: Nominal values of the new parameters, in the order of ``tied``.
    """
    owner = {path: name for name, paths in tied.items() for path in paths}
    untied_paths = [path for path in loop.parameter_paths if path not in owner]
    names = (*tied, *untied_paths)
    symbols = {name: ca.SX.sym(name) for name in names}
    p = ca.vertcat(*(symbols[owner.get(path, path)] for path in loop.parameter_paths))
    x0, c = loop.setup(p)
    old = dict(zip(loop.parameter_paths, loop.parameter_values, strict=True))
    parameters = ca.vertcat(*symbols.values())
    setup = ca.Function("setup", [parameters], [x0, c], ["p"], ["x0", "c"])
    return DerivedLoop.of(
        loop,
        parameter_paths=tuple(names),
        parameter_values=np.array([*nominal, *(old[path] for path in untied_paths)], dtype=float),
        setup=setup,
        gaps=ca.Function("gaps", [parameters], [loop.gaps(p)], ["p"], ["gap"]),
    )


def extend(
    loop: ClosedLoopFunctions, names: Sequence[str], rates: Callable[[Signals, ca.SX], ca.SX]
) -> DerivedLoop:
    """The closed loop with states added that begin at zero; the loop itself does not see them.

    Args:
        loop: The closed loop.
        names: Names of the new states, n of them.
        rates: Function of (signals of the closed loop, new states (n,)) that gives the rates (n,) of the new
            states.
    """
    signals, states = Signals.of(loop), ca.SX.sym("added", len(names))
    rate = ca.SX(rates(signals, states))
    used = [path for path, symbol in signals.parameters.items() if ca.depends_on(rate, symbol)]
    count, nx, nc = len(names), len(loop.state_names), loop.setup.numel_out(1)
    t, x, c = ca.SX.sym("t"), ca.SX.sym("x", nx + count), ca.SX.sym("c", nc + len(used))
    at = {"t": t, "x": x, "c": c}
    y = loop.outputs(t, x[:nx], c[:nc])
    symbols = [signals.t, signals.x, *signals.outputs.values(), states]
    values = [t, x[:nx], *y, x[nx:]]
    for i, path in enumerate(used):
        symbols.append(signals.parameters[path])
        values.append(c[nc + i])
    (added,) = ca.substitute([rate], symbols, values)
    p = ca.SX.sym("p", len(loop.parameter_paths))
    x0, c0 = loop.setup(p)
    place = {path: i for i, path in enumerate(loop.parameter_paths)}
    begin = {
        "x0": ca.vertcat(x0, ca.SX.zeros(count)),
        "c": ca.vertcat(c0, *(p[place[path]] for path in used)),
    }
    guards, update = loop.guards, loop.update
    if loop.events:  # the update leaves added states as they are
        xdot, e = ca.SX.sym("xdot", x.numel()), ca.SX.sym("e")
        guard_outputs = zip(guards.name_out(), guards(t, x[:nx], c[:nc], xdot[:nx]), strict=True)
        after = ca.vertcat(update(t, x[:nx], c[:nc], e), x[nx:])
        guards = _function("guards", {**at, "xdot": xdot}, dict(guard_outputs))
        update = _function("update", {**at, "e": e}, {"x_after": after})
    rows = {"row": ca.SX(loop.rows(t, x[:nx], c[:nc]))} if loop.tables else {}
    return DerivedLoop.of(
        loop,
        state_names=(*loop.state_names, *names),
        nz=loop.nz + count,
        setup=_function("setup", {"p": p}, begin),
        dynamics=_function("dynamics", at, {"xdot": ca.vertcat(loop.dynamics(t, x[:nx], c[:nc]), added)}),
        normalise=_function("normalise", {"x": x}, {"n": ca.vertcat(loop.normalise(x[:nx]), x[nx:])}),
        outputs=_function("outputs", at, dict(zip(loop.outputs.name_out(), y, strict=True))),
        rows=_function("rows", at, rows) if loop.tables else loop.rows,
        guards=guards,
        update=update,
    )


def _function(name: str, inputs: Mapping[str, ca.SX], outputs: Mapping[str, ca.SX]) -> ca.Function:
    dense = [ca.densify(value) for value in ca.cse(list(outputs.values()))]
    return ca.Function(name, list(inputs.values()), dense, list(inputs), list(outputs))
