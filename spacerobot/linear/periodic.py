"""Periodic systems: transition over one period, with holds, delays and sample instants.

Between events ``x' = A x + B w`` with the coefficients of the instant and constant w; at an event, the
linearised update ``x+ = E x + F w``. The product over one period, the least common multiple of all periods,
is the discrete system ``x_k+1 = A_d x_k + B_d w_k``. A loop broken at a signal y that is held over the whole
period is time-invariant: its period begins with the event that sets y, so that w_k acts together with y_k,
also in algebraic loops. A loop whose signal is read only at sample instants, once in each period, is
time-invariant as well.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from spacerobot.closedloop import ClosedLoop
from spacerobot.closedloop.break_points import PerturbedLoop
from spacerobot.common.arrays import Array
from spacerobot.common.errors import ScenarioError
from spacerobot.elements.core.clock import EARLY, ONCE
from spacerobot.linear.complex_step import evaluate
from spacerobot.linear.instants import Instant

TOGETHER = 1e-9
"""Time [s] below which two events are at one instant."""

MAX_EVENTS = 20_000
"""Maximum number of events in one common period."""

Matrices = tuple[Array, Array, Array, Array]


@dataclass(frozen=True)
class PeriodicUpdate:
    """A periodic event at its instant: time [s] and Jacobians of the state after it by state and input."""

    time_s: float
    by_state: Array
    by_input: Array


def occurrences(
    loop: ClosedLoop, perturbed: PerturbedLoop, instant: Instant
) -> tuple[list[PeriodicUpdate], float]:
    """Periodic events from an instant on, over two common periods, and the common period [s].

    Args:
        loop, perturbed: Closed loop and its derivatives.
        instant: Instant at which the events are evaluated; only counters of samples advance.

    Returns:
        tuple: No events and zero if nothing is periodic. Events that set switches, such as thruster pulses,
            are not linear and are left out, as are events that occur once.

    Raises:
        ScenarioError: If the periods have no common multiple with at most :data:`MAX_EVENTS` events, or a
            value that a delay waits for is not stored.
    """
    places = [i for i, rule in enumerate(loop.events) if rule.clock and not rule.sets]
    counters = [i for i, name in enumerate(loop.state_names) if name.endswith(".count[0]")]
    x = instant.x.copy()

    def due(x: Array) -> Array:
        """Times of the next occurrence of each event [s]."""
        guards = evaluate(loop.guards, instant.time_s, x, instant.c, np.zeros(len(x)))[0].ravel()
        return np.asarray(instant.time_s - guards[places] + EARLY)

    def advanced(x: Array, after: Array) -> Array:
        return np.where(np.isin(np.arange(len(x)), counters), after, x)

    first, periods = due(x), {}
    for k, place in enumerate(places):
        if np.isfinite(first[k]):
            after = evaluate(perturbed.update, instant.time_s, x, instant.c, place)[0].ravel()
            period = (due(advanced(x, after))[k] - first[k]).item()
            if TOGETHER < period.real < ONCE:
                periods[k] = period
    if not periods:
        return [], 0.0
    common = common_period(list(periods.values()))
    begin = max((first[k] for k in periods), key=np.real)  # what waits for a delay has begun by then
    updates, end = list[PeriodicUpdate](), begin + 2 * common + TOGETHER
    while True:
        times = {k: time for k, time in enumerate(due(x)) if k in periods}
        soonest = min(np.real(time) for time in times.values())
        if soonest > np.real(end):
            return updates, common
        k = min(k for k, time in times.items() if np.real(time) < soonest + TOGETHER)
        after, by_state, by_input = evaluate(perturbed.update, instant.time_s, x, instant.c, places[k])
        if np.isnan(after).any():
            raise ScenarioError(
                f"{loop.events[places[k]].name}: found a delay that is longer than the scenario's by a "
                "period or more, allowed: less; give the scenario the longest delay of the range"
            )
        if np.real(times[k]) > np.real(begin) - TOGETHER:
            updates.append(PeriodicUpdate(times[k], by_state, by_input))
        x = advanced(x, after.ravel())


def common_period(periods: Sequence[float]) -> float:
    """Least common multiple of periods [s].

    Raises:
        ScenarioError: If there is none with at most :data:`MAX_EVENTS` events.
    """
    shortest = min(periods, key=np.real)
    ratios = [Fraction((period / shortest).real).limit_denominator(1000) for period in periods]
    numerator = math.lcm(*(ratio.numerator for ratio in ratios))
    common = shortest * numerator / math.gcd(*(ratio.denominator for ratio in ratios))
    apart = max(abs(float(r) * shortest / p - 1) for r, p in zip(ratios, periods, strict=True))
    if apart > TOGETHER or sum((common / period).real for period in periods) > MAX_EVENTS:
        listed = ", ".join(f"{period:g} s" for period in sorted(set(periods)))
        raise ScenarioError(f"periods of {listed} have no common multiple: a linear analysis needs one")
    return common


def beginning(
    updates: Sequence[PeriodicUpdate], continuous: Matrices, place: int, period_s: float
) -> float | None:
    """Time at which the period of a broken loop begins [s]; None if the loop is time-varying.

    The loop is time-invariant if its signal is set once in a period and held, or read by events at one
    instant only.

    Args:
        updates: Events over two periods.
        continuous: A, B, C, D between events.
        place: Index of the break point among inputs and outputs.
        period_s: Common period [s].
    """
    A, B, C, D = continuous
    eye, rows = np.eye(len(A)), np.flatnonzero(C[place])
    if np.abs(A[rows]).sum() + np.abs(B[rows]).sum() + np.abs(D[place]).sum() == 0:  # held
        sets = [np.abs(one.by_state - eye)[rows].sum() + np.abs(one.by_input[rows]).sum() for one in updates]
    elif np.abs(B[:, place]).sum() + np.abs(D[:, place]).sum() == 0:  # sampled
        sets = [np.abs(one.by_input[:, place]).sum() for one in updates]
    else:
        return None
    times = [one.time_s for one, size in zip(updates, sets, strict=True) if size > 0]
    if not times or any(TOGETHER < np.real(t - times[0]) < np.real(period_s) - TOGETHER for t in times):
        return None
    return times[0]


def transition(
    updates: Sequence[PeriodicUpdate], continuous: Matrices, begin_s: float, period_s: float
) -> Matrices:
    """Discrete system over one period; outputs are the values just after the events at its start.

    Args:
        updates: Events over two periods.
        continuous: A, B, C, D between events.
        begin_s, period_s: Start and length of the period [s].
    """
    from scipy.linalg import expm

    A, B, C, D = continuous
    size, inputs = B.shape
    augmented = np.zeros((size + inputs,) * 2, dtype=A.dtype)
    augmented[:size, :size], augmented[:size, size:] = A, B
    state, now, outputs = np.eye(size, size + inputs), begin_s, None
    lengths: dict[complex, Array] = {}

    def flow(length: float) -> Array:
        """Transition of state and input over a time without events."""
        key = round(np.real(length), 12) + 1j * np.imag(length)
        if key not in lengths:
            lengths[key] = expm(augmented * length)[:size]
        return lengths[key]

    pad = np.hstack([np.zeros((inputs, size)), np.eye(inputs)])
    last = np.real(period_s) - TOGETHER
    for one in [*(u for u in updates if -TOGETHER < np.real(u.time_s - begin_s) < last), None]:
        time_s = begin_s + period_s if one is None else one.time_s
        if np.real(time_s - now) > TOGETHER:
            outputs = C @ state + D @ pad if outputs is None else outputs
            state, now = flow(time_s - now) @ np.vstack([state, pad]), time_s
        if one is not None:
            state = one.by_state @ state + one.by_input @ pad
    assert outputs is not None
    return state[:, :size], state[:, size:], outputs[:, :size], outputs[:, size:]
