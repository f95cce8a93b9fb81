"""Windows into tables, against the same law that chooses among all rows by itself."""

from __future__ import annotations

import functools
from dataclasses import replace
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from spacerobot.rollout import Measures, Signals, build_rollout, final, integral, peak
from spacerobot.symbolic import WindowTable
from tests.rollout.hybrid_loops import Hybrid, Rule

ROWS = [(1, 0.3), (0.4, -0.2), (1.3, 0.1)]
PARAMETERS = {f"rate.{k}.{j}": value for k, row in enumerate(ROWS) for j, value in enumerate(row)}
PARAMETERS |= {"force.0": 0.8, "force.1": -0.5, "force.2": 0.0, "late": 0.31, "level": 0.25, "first": 0.05}
JUMPS, SWITCH, LEVEL = (0, 1), 2, 3
RATES = WindowTable(cursor=0, first=4, window=10, width=2, count=3)
FORCES = WindowTable(cursor=1, first=12, window=18, width=2, count=3)


def rows(t, x, c):
    """Rows by known times, and by what events counted."""
    return (t >= c[0]) + (t >= c[1]), x[3]


def law(*, tables: bool, events: bool) -> SimpleNamespace:
    """A loop whose rates are rows of tables: seen through windows, or chosen by the law."""

    def start(*p):
        rate, force, (late, level, first) = p[:6], p[6:9], p[9:]
        pairs = [part for pair in zip(force, (0.2, 0.45, np.inf), strict=True) for part in pair]
        c = [late, 0.8, 0.0, level, *rate, *rate[:2], *pairs, *pairs[:2]]
        return [first, 0, 0, 0], c

    def shown(table, t, x, c):
        if tables:
            return c[table.window : table.window + table.width]
        found, row = c[table.first : table.first + table.width], rows(t, x, c)[table.cursor]
        for k in range(1, table.count):
            place = table.first + k * table.width
            found = ca.if_else(row == k, c[place : place + table.width], found)
        return found

    def rates(t, x, c):
        rate, force = shown(RATES, t, x, c), shown(FORCES, t, x, c)
        return [rate[0] + rate[1] * ca.sin(3 * x[0]), force[0] * c[SWITCH] * x[0] - x[1], 0, 0]

    hybrid = Hybrid(
        PARAMETERS,
        start,
        rates,
        lambda t, x, c: [(1 - c[SWITCH], x[0] - c[LEVEL]), (c[SWITCH], t - x[2] - shown(FORCES, t, x, c)[1])],
        lambda t, x, c: [(x[0], x[1], t, 0), (x[0], x[1], x[2], x[3] + 1)],
        [Rule("start", ((0, True),)), Rule("knot", kink=True)] if events else [],
        switches=(SWITCH,),
        jumps=JUMPS,
    )
    loop = hybrid.loop()
    if tables:
        loop.tables = (RATES, FORCES)
        t, x, c = ca.SX.sym("t"), ca.SX.sym("x", 4), ca.SX.sym("c", 20)
        loop.rows = ca.Function("rows", [t, x, c], [ca.vertcat(*rows(t, x, c))])
    return loop


def rollout_of(loop, backend):
    signals = Signals.of(loop)
    state = signals["state"]
    named = {"path": integral(state[1] ** 2), "most": peak(state[1] - state[0] ** 2), "end": final(state[:2])}
    measures = Measures(
        signals, named, lambda r, p: {"J": r["path"] + 2 * r["most"] + ca.sum1(r["end"] ** 2)}
    )
    return build_rollout(
        loop, duration_s=1.2, step_s=0.06, output_step_s=0.12, measures=measures, backend=backend
    )


@functools.cache
def made(events, backend):
    """Rollouts by the law that sees windows, and by the one that chooses by itself."""
    plain = rollout_of(law(tables=False, events=events), "interpreted")
    return rollout_of(law(tables=True, events=events), backend), plain


def rows_of(rollout):
    """Three rows of parameters."""
    return tuple(PARAMETERS), rollout.values() * (1 + 0.01 * np.arange(3)[:, None])


CASES = [(True, "compiled"), (True, "interpreted"), (False, "interpreted")]


@pytest.mark.parametrize(("events", "backend"), CASES)
def test_windows_show_what_a_law_would_choose(events, backend):
    found, expected = (rollout.run() for rollout in made(events, backend))
    assert [e.event for e in found.events] == [e.event for e in expected.events] == [0, 1, 1][: 3 * events]
    np.testing.assert_allclose(found.state, expected.state, atol=1e-13)
    assert found.costs["J"] == pytest.approx(expected.costs["J"], rel=1e-12)


@pytest.mark.parametrize(("events", "backend"), CASES)
def test_gradients_reach_every_row(events, backend):
    rollout, plain = made(events, backend)
    found, known = (each.gradient_batch(*rows_of(plain)).gradients["J"] for each in (rollout, plain))
    assert (known != 0).sum(axis=1).min() == (12 if events else 8)
    np.testing.assert_allclose(found, known, atol=1e-12 * np.abs(known).max())


@pytest.mark.parametrize(("events", "backend"), CASES)
def test_slopes_reach_every_row(events, backend):
    rollout, plain = made(events, backend)
    paths, values = rows_of(plain)
    found, known = (each.slope_batch(paths, values[2:]).slopes for each in (rollout, plain))
    for name, slope in found.items():
        np.testing.assert_allclose(slope, known[name], atol=1e-12)


def test_a_tape_in_pieces_gives_the_same_bits():
    rollout, _ = made(True, "compiled")
    places = tuple(rollout.indices(tuple(PARAMETERS)))
    whole = rollout.gradient_batch(*rows_of(rollout)).gradients["J"]
    engine = rollout.engines.adjoint(places, many=True)
    short = replace(engine, whole_bytes=0, segment_bytes=3 * engine.bytes_per_step)
    rollout.engines._made["adjoint", places, engine.lanes] = short
    found = rollout.gradient_batch(*rows_of(rollout)).gradients["J"]
    rollout.engines._made["adjoint", places, engine.lanes] = engine
    np.testing.assert_array_equal(found, whole)
