"""Guards that cross more than once within one step: every crossing is found, in turn."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from spacerobot.rollout import build_rollout
from spacerobot.rollout.methods import METHODS
from spacerobot.rollout.methods.tableau import INNER
from tests.rollout.hybrid_loops import Hybrid, Rule

STEP, NEAREST = 0.1, 5e-4
"""Of the rollouts; least distance of two roots [s]."""


def crossing(parameters, start, guard, kink=False):
    """A clock and a guard over it and constants, whose rises and falls are events in turn."""
    return Hybrid(
        parameters,
        start,
        lambda t, x, c: [1],
        lambda t, x, c: [(1 - c[0], guard(x, c)), (c[0], -guard(x, c))],
        lambda t, x, c: [(x[0],), (x[0],)],
        [Rule("rises", ((0, True),), kink=kink), Rule("falls", ((0, False),), kink=kink)],
        switches=(0,),
    ).loop()


def cubic(kink=False):
    """A guard with three given roots."""

    def guard(x, c):
        return c[1] * (x[0] - c[2]) * (x[0] - c[3]) * (x[0] - c[4]) / STEP**3

    return crossing(
        {"sign": 1.0, "first": 0.02, "second": 0.05, "third": 0.08},
        lambda *p: ([0.0], [p[0] * p[1] * p[2] * p[3] < 0, *p]),
        guard,
        kink,
    )


def drawn(count):
    """Signs and roots: some rows have all in one step, some across steps, some one before the start."""
    rng = np.random.default_rng(12)
    gaps = np.exp(rng.uniform(np.log(NEAREST), np.log(0.08), (count, 3)))
    roots = np.cumsum(gaps, axis=1) - np.where(rng.random(count) < 0.4, gaps[:, 0] + 0.03, 0)[:, None]
    sign = np.where(rng.random(count) < 0.5, 1.0, -1.0)
    return np.column_stack([sign, roots])


def expected(row):
    """Times of the crossings within three steps, and which event each is."""
    sign, roots = row[0], row[1:]
    kinds = [0, 1, 0] if sign > 0 else [1, 0, 1]
    return [(t, kind) for t, kind in zip(roots, kinds, strict=True) if 0 < t < 3 * STEP]


PATHS = ("sign", "first", "second", "third")


@pytest.mark.parametrize("kink", [False, True], ids=["jump", "kink"])
def test_every_root_of_a_guard_is_an_event_however_many_lie_in_a_step(kink):
    """Where all events are kinks, places inside a step are left out far from them."""
    rollout = build_rollout(cubic(kink), duration_s=3 * STEP, step_s=STEP, many=True)
    rows = drawn(400)
    found = rollout.batch(PATHS, rows).events
    several = 0
    for i, row in enumerate(rows):
        wanted = expected(row)
        several += len({int(t / STEP) for t, _ in wanted}) < len(wanted)
        assert found.event[i, : found.count[i]].tolist() == [kind for _, kind in wanted], row
        np.testing.assert_allclose(found.time_s[i, : found.count[i]], [t for t, _ in wanted], atol=1e-9)
    assert several > 200


def waves_and_tents(kink=False):
    """A guard that turns many times within a step, or one with a kink, the least of two lines."""

    def guard(x, c):
        wave = ca.sin(c[2] * x[0] + c[3]) - c[4]
        tent = ca.fmin(c[2] * (x[0] - c[3] + c[4] / 2), c[3] + c[4] / 2 - x[0])
        return ca.if_else(c[1], wave, tent)

    return crossing(
        {"wave": 1.0, "rate": 60.0, "place": 0.5, "size": 0.5},
        lambda wave, rate, place, size: ([0.0], [wave * ca.sin(place) > size, wave, rate, place, size]),
        guard,
        kink,
    )


def turning(count):
    """Waves of up to five turns in a step, tents of a twentieth of a step and more; and when they cross."""
    rng, until = np.random.default_rng(5), 3 * STEP
    for _ in range(count):
        rate, place, size = rng.uniform(20, 150), rng.uniform(0, 2 * np.pi), rng.uniform(-0.95, 0.95)
        around = 2 * np.pi * np.arange(-1, 9) - place
        roots = np.sort(np.concatenate([around + np.arcsin(size), around + np.pi - np.arcsin(size)])) / rate
        yield (1.0, rate, place, size), roots[(roots > 0) & (roots < until)]
        rate, place, size = np.exp(rng.uniform(-1, 1)), rng.uniform(0.02, 0.28), rng.uniform(0.05, 0.2) * STEP
        yield (0.0, rate, place, size), place + np.array([-0.5, 0.5]) * size


@pytest.mark.parametrize("kink", [False, True], ids=["jump", "kink"])
def test_a_guard_that_turns_more_than_twice_in_a_step_or_has_a_kink_is_followed(kink):
    loop, rows = waves_and_tents(kink), list(turning(200))
    rollout = build_rollout(loop, duration_s=3 * STEP, step_s=STEP, many=True)
    found = rollout.batch(loop.parameter_paths, np.array([row for row, _ in rows])).events
    for i, (row, roots) in enumerate(rows):
        assert found.count[i] == len(roots), row
        np.testing.assert_allclose(found.time_s[i, : len(roots)], roots, atol=1e-9)
    slow = build_rollout(loop, duration_s=3 * STEP, step_s=STEP, backend="interpreted")
    for row, roots in rows[:8]:
        events = slow.run(dict(zip(loop.parameter_paths, row, strict=True))).events
        np.testing.assert_allclose([here.time_s for here in events], roots, atol=1e-9)


def grazing(count):
    """Waves of 4 to 40 steps that rise above their level by 1e-6 to 0.3; and when they cross in 20 steps."""
    rng, until = np.random.default_rng(7), 20 * STEP
    for _ in range(count):
        rate, place = 2 * np.pi / (STEP * rng.uniform(4, 40)), rng.uniform(0, 2 * np.pi)
        size = 1 - 10 ** rng.uniform(-6, -0.5)
        around = 2 * np.pi * np.arange(-1, 9) - place
        roots = np.sort(np.concatenate([around + np.arcsin(size), around + np.pi - np.arcsin(size)])) / rate
        yield (1.0, rate, place, size), roots[(roots > 0) & (roots < until)]


def test_a_kink_that_is_grazed_between_steps_is_found():
    """After steps at which nothing came near it, that were judged by their ends alone."""
    loop, rows = waves_and_tents(kink=True), list(grazing(300))
    rollout = build_rollout(loop, duration_s=20 * STEP, step_s=STEP, many=True)
    found = rollout.batch(loop.parameter_paths, np.array([row for row, _ in rows])).events
    inside = 0
    for i, (row, roots) in enumerate(rows):
        steps = (roots / STEP).astype(int)
        inside += (np.diff(steps) == 0).any()
        assert found.count[i] == len(roots), row
        np.testing.assert_allclose(found.time_s[i, : len(roots)], roots, atol=1e-9)
    assert inside > 100


def test_the_interpreted_engine_finds_them_too():
    rollout = build_rollout(cubic(), duration_s=3 * STEP, step_s=STEP, backend="interpreted")
    for row in drawn(12):
        found = [(here.time_s, here.event) for here in rollout.run(dict(zip(PATHS, row, strict=True))).events]
        assert [kind for _, kind in found] == [kind for _, kind in expected(row)]
        np.testing.assert_allclose([t for t, _ in found], [t for t, _ in expected(row)], atol=1e-9)


@pytest.mark.parametrize("name", METHODS)
def test_states_inside_a_step_are_of_their_order(name):
    """Of x' = sin(x + t), by the slopes of one step, against many small ones."""
    method = METHODS[name]

    def slopes(x, t, h):
        found = []
        for row, node in zip(method.a[: method.stages], method.nodes, strict=False):
            found.append(np.sin(x + h * sum(w * k for w, k in zip(row, found, strict=False)) + t + node * h))
        return np.array(found)

    def error(h, part):
        x, pieces = 0.3, 32
        for n in range(pieces):
            piece = part * h / pieces
            x += piece * np.dot(method.b, slopes(x, 0.2 + n * piece, piece))
        return abs(x - 0.3 - h * method.inner[INNER.index(part)] @ slopes(0.3, 0.2, h))

    order = min(4, method.order - 1)
    for part in INNER:
        assert order + 0.5 < np.log2(error(0.04, part) / error(0.02, part)) < order + 1.7  # 0.45 suits RK4
