"""Rollouts through events by SciPy's integrator and root finding, straight from a closed loop's functions."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import solve_ivp

from spacerobot.closedloop import ClosedLoop
from spacerobot.compiled.numeric_function import NumericFunction


@dataclass(frozen=True)
class Happened:
    """An event: its time, its rule's name, and the state before and after it."""

    time: float
    name: str
    before: np.ndarray
    after: np.ndarray
    c_before: np.ndarray
    c_after: np.ndarray


@dataclass
class Run:
    """A rollout: where it came to, and what happened on the way."""

    loop: ClosedLoop
    t: float
    x: np.ndarray
    c: np.ndarray
    events: list[Happened] = field(default_factory=list)

    def __post_init__(self):
        self._guards, self._rate = NumericFunction(self.loop.guards), NumericFunction(self.loop.dynamics)

    def guards(self, t: float, x: np.ndarray, c: np.ndarray) -> np.ndarray:
        """Guards (ne,)."""
        return self._guards(t, x, c, np.zeros(self.loop.nx))[0]

    def rate(self, t: float, x: np.ndarray, c: np.ndarray) -> np.ndarray:
        """Rate of the state (nx,)."""
        return self._rate(t, x, c)[0]

    @property
    def names(self) -> list[str]:
        """Names of the events, in turn."""
        return [event.name for event in self.events]

    def outputs(self, t=None, x=None, c=None) -> dict[str, np.ndarray]:
        """Outputs where it came to, or elsewhere."""
        given = self.t if t is None else t, self.x if x is None else x, self.c if c is None else c
        values = self.loop.outputs(*given)
        return {n: v.full().ravel() for n, v in zip(self.loop.outputs.name_out(), values, strict=True)}

    def state(self, name: str) -> np.ndarray:
        """Components of a state by its name."""
        return np.array(
            [v for n, v in zip(self.loop.state_names, self.x, strict=True) if n.startswith(f"{name}[")]
        )


def fire(run: Run, index: int) -> bool:
    """Let an event happen; whether it ends the rollout."""
    rule, before, c = run.loop.events[index], run.x, run.c.copy()
    for place, value in rule.sets:
        c[run.loop.switches[place]] = float(value)
    run.x = run.loop.update(run.t, before, c, index).full().ravel()
    c = run.loop.at(run.t, run.x, c).full().ravel()
    run.events.append(Happened(run.t, rule.name, before, run.x, run.c, c))
    run.c = c
    return rule.ends


def roll(loop: ClosedLoop, duration: float, changes=None, rtol: float = 1e-10) -> Run:
    """Rollout of a closed loop, each event at its time."""
    x, c = (value.full().ravel() for value in loop.setup(loop.parameters(changes)))
    run = Run(loop, 0.0, x, c)
    while True:
        above = np.flatnonzero(run.guards(run.t, run.x, run.c) > 0)
        while above.size:
            assert len(run.events) < 200, run.names
            if fire(run, int(above[0])):
                return run
            above = np.flatnonzero(run.guards(run.t, run.x, run.c) > 0)
        if run.t >= duration:
            return run
        _advance(run, duration, rtol)


def _advance(run: Run, duration: float, rtol: float) -> None:
    """To the next event, just past its root, or to the end."""
    loop, c = run.loop, run.c
    armed = np.isfinite(run.guards(run.t, run.x, c))

    def highest(t, x):
        return max(run.guards(t, x, c)[armed], default=-1.0)

    highest.terminal, highest.direction = True, 1
    found = solve_ivp(
        lambda t, x: run.rate(t, x, c),
        (run.t, duration),
        run.x,
        method="DOP853",
        rtol=rtol,
        atol=1e-12,
        max_step=0.02,
        events=highest if armed.any() else None,
    )
    run.t, run.x = float(found.t[-1]), loop.normalise(found.y[:, -1]).full().ravel()
    step = 1e-12
    while found.status == 1 and not highest(run.t, run.x) > 0:  # rounding may leave it just below its root
        rate = run.rate(run.t, run.x, c)
        run.t, run.x, step = run.t + step, run.x + step * rate, 2 * step
        assert step < 1e-8
