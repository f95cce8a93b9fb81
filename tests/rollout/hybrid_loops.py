"""Small closed loops with events, written by hand."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace

import casadi as ca
import numpy as np

Law = Callable[[ca.SX, ca.SX, ca.SX], Sequence[ca.SX] | ca.SX]


@dataclass(frozen=True)
class Rule:
    """What is known of an event before anything runs."""

    name: str
    sets: tuple[tuple[int, bool], ...] = ()
    ends: bool = False
    kink: bool = False
    gap: bool = False
    clock: bool = False
    silent: bool = False
    routine: bool = False
    quantised: bool = False
    kind: str = "kind"
    who: str = "who"


@dataclass(frozen=True)
class Hybrid:
    """The laws of a closed loop over (t, x, c).

    ``start`` gives (x0, c) from the parameters; ``guards`` one pair (armed, guard) for each event, and
    ``updates`` its state afterwards.
    """

    parameters: Mapping[str, float]
    start: Callable[..., tuple[Sequence[ca.SX], Sequence[ca.SX]]]
    rates: Law
    guards: Law
    updates: Law
    rules: Sequence[Rule]
    switches: tuple[int, ...] = ()
    jumps: tuple[int, ...] = ()
    fine: tuple[tuple[int, float, float], ...] = field(default=())

    def loop(self) -> SimpleNamespace:
        p = ca.SX.sym("p", len(self.parameters))
        first, constants = (ca.vertcat(*values) for values in self.start(*ca.vertsplit(p)))
        nx, nc = first.numel(), constants.numel()
        t, x, c = ca.SX.sym("t"), ca.SX.sym("x", nx), ca.SX.sym("c", nc)
        xdot, e = ca.SX.sym("xdot", nx), ca.SX.sym("e")
        armed, guards = (ca.vertcat(*pair) for pair in zip(*self.guards(t, x, c), strict=True))
        rates = ca.jtimes(guards, ca.vertcat(t, x), ca.vertcat(1, xdot))
        after = x
        for number, new in enumerate(self.updates(t, x, c)):
            after = ca.if_else(e == number, ca.vertcat(*new), after)
        found = [ca.if_else(armed, guards, -ca.inf), ca.if_else(armed, rates, 0), ca.SX(0, 1)]
        return SimpleNamespace(
            parameter_paths=tuple(self.parameters),
            parameter_values=np.array(list(self.parameters.values())),
            state_names=tuple(f"x{i}" for i in range(nx)),
            nq=0,
            nv=0,
            nz=nx,
            setup=ca.Function("setup", [p], [first, constants]),
            dynamics=ca.Function("dynamics", [t, x, c], [ca.vertcat(*self.rates(t, x, c))]),
            normalise=ca.Function("normalise", [x], [x]),
            outputs=ca.Function("outputs", [t, x, c], [x], ["t", "x", "c"], ["state"]),
            gaps=ca.Function("gaps", [p], [ca.SX(0, 1)]),
            max_gaps={},
            jumps=self.jumps,
            switches=self.switches,
            events=tuple(self.rules),
            fine=self.fine,
            tables=(),
            rows=ca.Function(),
            guards=ca.Function("guards", [t, x, c, xdot], found),
            update=ca.Function("update", [t, x, c, e], [after]),
        )


def bouncing_ball(**changes: float) -> SimpleNamespace:
    """Height, speed, time of the last bounce, sum of impulses; a floor with restitution."""
    return Hybrid(
        {"height": 1.0, "restitution": 0.7, "gravity": 9.81} | changes,
        lambda height, restitution, gravity: ([height, 0, 0, 0], [restitution, gravity]),
        lambda t, x, c: [x[1], -c[1], 0, 0],
        lambda t, x, c: [(1, -x[0])],
        lambda t, x, c: [(x[0], -c[0] * x[1], t, x[3] - (1 + c[0]) * x[1])],
        [Rule("bounce")],
    ).loop()


def spring_wall(**changes: float) -> SimpleNamespace:
    """A mass on a spring that meets a spring wall and leaves it; the third state is when it last met it."""
    return Hybrid(
        {"stiffness": 4.0, "wall": 90.0, "place": 0.6, "start": -1.0, "speed": 0.0} | changes,
        lambda stiffness, wall, place, start, speed: ([start, speed, 0], [0, stiffness, wall, place]),
        lambda t, x, c: [x[1], -c[1] * x[0] - c[0] * c[2] * (x[0] - c[3]), 0],
        lambda t, x, c: [(1 - c[0], x[0] - c[3]), (c[0], c[3] - x[0])],
        lambda t, x, c: [(x[0], x[1], t), (x[0], x[1], x[2])],
        [Rule("touch", ((0, True),)), Rule("part", ((0, False),))],
        switches=(0,),
    ).loop()


def two_balls(**changes: float) -> SimpleNamespace:
    """Two balls that bounce on one floor: heights and speeds."""
    return Hybrid(
        {"first": 1.0, "second": 1.0, "restitution": 0.8} | changes,
        lambda first, second, restitution: ([first, 0, second, 0], [restitution, 9.81]),
        lambda t, x, c: [x[1], -c[1], x[3], -c[1]],
        lambda t, x, c: [(1, -x[0]), (1, -x[2])],
        lambda t, x, c: [(x[0], -c[0] * x[1], x[2], x[3]), (x[0], x[1], x[2], -c[0] * x[3])],
        [Rule("first"), Rule("second")],
    ).loop()


def latch(**changes: float) -> SimpleNamespace:
    """A pendulum that a body at rest catches: they go on together. A timed release follows, then the end.

    States: angle, rate, inertia, time of the catch, energy lost.
    """

    def caught(t: ca.SX, x: ca.SX, c: ca.SX) -> Sequence[ca.SX]:
        rate = x[1] * x[2] / (x[2] + c[2])
        return x[0], rate, x[2] + c[2], t, x[4] + 0.5 * x[2] * x[1] ** 2 - 0.5 * (x[2] + c[2]) * rate**2

    return Hybrid(
        {"start": 1.2, "inertia": 0.5, "body": 0.3, "delay": 0.4, "angle": 0.1} | changes,
        lambda start, inertia, body, delay, angle: (
            [start, 0, inertia, 0, 0],
            [0, 0, body, delay, angle, 2.0],
        ),
        lambda t, x, c: [x[1], -c[5] * ca.sin(x[0]) / x[2], 0, 0, 0],
        lambda t, x, c: [
            ((1 - c[0]) * (1 - c[1]), c[4] - x[0]),
            (c[0], t - (x[3] + c[3])),
            (c[1], x[0] - c[4]),
        ],
        lambda t, x, c: [
            caught(t, x, c),
            (x[0], x[1], x[2] - c[2], x[3], x[4]),
            (x[0], x[1], x[2], x[3], x[4]),
        ],
        [
            Rule("caught", ((0, True),)),
            Rule("released", ((0, False), (1, True))),
            Rule("back", (), ends=True),
        ],
        switches=(0, 1),
    ).loop()


def dwell(**changes: float) -> SimpleNamespace:
    """A swing captured once it was within a range for so long: place, times of entry and capture, exits."""
    return Hybrid(
        {"frequency": 2.0, "range": 0.3, "time": 0.5} | changes,
        lambda frequency, range_, time: ([1, -1, -1, 0], [0, 0, frequency, range_, time]),
        lambda t, x, c: [-c[2] * ca.sin(c[2] * t) * ca.exp(-0.3 * t) - 0.3 * x[0], 0, 0, 0],
        lambda t, x, c: [
            ((1 - c[0]) * (1 - c[1]), c[3] ** 2 - x[0] ** 2),
            (c[0], x[0] ** 2 - c[3] ** 2),
            (c[0], t - x[1] - c[4]),
        ],
        lambda t, x, c: [(x[0], t, x[2], x[3]), (x[0], x[1], x[2], x[3] + 1), (x[0], x[1], t, x[3])],
        [
            Rule("entered", ((0, True),)),
            Rule("left", ((0, False),)),
            Rule("captured", ((0, False), (1, True))),
        ],
        switches=(0, 1),
    ).loop()
