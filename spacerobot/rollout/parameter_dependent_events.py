"""Events whose times depend on parameters, found from the sparsity of the functions.

A clock, such as that of a sampled sensor or of pulsed thrusters, compares time with a state that its own
events set. Event times and states are therefore decided together, as the smallest fixed point of

* a state moves if its rate is not structurally zero, if its initial value depends on parameters, or if an
  event that moves sets it, or an event sets it to a moving value;
* an event moves if its guard depends on a state that moves or on a constant that parameters reach.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import casadi as ca

from spacerobot.rollout.kernel import Kernel


def moving_events(kernel: Kernel, wrt: Sequence[int], reached: Collection[int]) -> tuple[bool, ...]:
    """Find the events whose times parameters may move.

    Args:
        kernel: The forward functions.
        wrt: Indices in p of the parameters.
        reached: Indices in c of the prepared constants that depend on them.

    Returns:
        tuple of bool: One for each event.
    """
    if not kernel.events:
        return ()
    f = kernel.functions
    t, x, c = (ca.SX.sym(name, kernel.size("dynamics", name)) for name in ("t", "x", "c"))
    p = ca.SX.sym("p", kernel.size("setup", "p"))
    x0, rates = f["setup"](p)[0], ca.sparsify(ca.SX(f["dynamics"](t, x, c)[0]))
    moving_states = {*rates.sparsity().row(), *ca.jacobian_sparsity(x0, p[list(wrt)]).row()}
    arguments = ca.vertcat(x, t, c)  # entries up to nx are states, then comes time
    nx = x.numel()
    constants = {nx + 1 + place for place in reached}
    guards = _dependencies(f["values"](t, x, c)[0], arguments)
    sets = []
    for event in range(len(kernel.events)):
        after = ca.SX(f["update"](t, x, c, event))
        rows = _dependencies(after, arguments)
        sets.append({i: rows[i] for i in range(nx) if not ca.is_equal(after[i], x[i], 2)})
    events: set[int] = set()
    while True:
        variables = moving_states | constants
        late = {event for event, row in enumerate(guards) if row & variables} - events
        events |= late
        changed = {
            i
            for event, rows_by_place in enumerate(sets)
            for i, row in rows_by_place.items()
            if row & variables or (event in events and nx in row)
        } - moving_states
        moving_states |= changed
        if not late and not changed:
            return tuple(event in events for event in range(len(kernel.events)))


def _dependencies(values: ca.SX, variables: ca.SX) -> list[set[int]]:
    """Variables that each entry of a column may depend on, by their places."""
    rows: list[set[int]] = [set() for _ in range(values.numel())]
    for row, column in zip(*ca.jacobian_sparsity(values, variables).get_triplet(), strict=True):
        rows[row].add(column)
    return rows
