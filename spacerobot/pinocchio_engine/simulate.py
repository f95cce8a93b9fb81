"""Roll out a scene with an adaptive integrator of high order."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from scipy.integrate import DOP853

from spacerobot.arrays import Array
from spacerobot.errors import SpaceRobotError
from spacerobot.pinocchio_engine.engine import Engine
from spacerobot.pinocchio_engine.outputs import outputs_at
from spacerobot.rollout.grid import time_grid
from spacerobot.rollout.trajectory import Trajectory, frozen
from spacerobot.scene import Scene

POSITION_LIMIT = 1e6
"""Greatest position [m, rad] of a rollout that is not called diverged."""
VELOCITY_LIMIT = 1e4
"""Greatest velocity [m/s, rad/s]; beyond, an adaptive integrator would creep."""
CONTROLLER_LIMIT = 1e12
"""Greatest controller state or work."""

Progress = Callable[[float], None]
"""Told the part of the time, 0 to 1, that is done."""


def simulate(
    scene: Scene,
    *,
    output_step_s: float | None = None,
    duration_s: float | None = None,
    rtol: float = 1e-11,
    atol: float = 1e-12,
    progress: Progress | None = None,
) -> Trajectory:
    """Simulate a scene with Pinocchio's algorithms and an explicit Runge-Kutta method of order 8.

    The integration stops at every sample and wherever two pieces of a reference meet, so that each of its
    steps sees a smooth right-hand side (clipped torques excepted) and samples are not interpolated.

    Parameters
    ----------
    scene
        The scene.
    output_step_s, duration_s
        Longest time between samples, and duration [s]; the scenario's own if None.
    rtol, atol
        Tolerances of the integrator, per component of x.
    progress
        Told how far it is, once for each sample.

    Returns
    -------
    Trajectory
        State, outputs and status; no measures and costs. A sample on the end of a reference shows what
        led up to it. Cut short, with status ``diverged``, where the state leaves its bounds, becomes singular
        or cannot be integrated.

    Raises
    ------
    SpaceRobotError
        If a duration, a step or a tolerance is not positive and finite.
    """
    begin = time.perf_counter()
    simulation = scene.scenario.simulation
    output_step_s = simulation.output_step if output_step_s is None else output_step_s
    duration_s = simulation.duration if duration_s is None else duration_s
    samples = time_grid(duration_s, output_step_s, output_step_s).time
    engine = Engine(scene)
    integrator = _Integrator(engine, rtol, atol)
    states, outputs, bad = _roll_out(engine, integrator, samples, progress or (lambda _: None))
    return Trajectory(
        time=frozen(samples[: len(states)]),
        state=frozen(np.array(states)),
        outputs={name: frozen(np.array([y[name] for y in outputs])) for name in outputs[0]},
        measures={},
        costs={},
        status="completed" if bad is None else "diverged",
        diverged_at_s=bad,
        steps=0,
        step_s=float("nan"),
        backend="pinocchio",
        wall_s=time.perf_counter() - begin,
    )


def _roll_out(
    engine: Engine, integrator: _Integrator, samples: Array, progress: Progress
) -> tuple[list[Array], list[dict[str, Array]], float | None]:
    """States and outputs at the samples, and the time [s] at which they end early, if they do."""
    states, outputs = [engine.x0], [outputs_at(engine, 0.0, engine.x0)]
    for until in samples[1:]:
        x, within = integrator.advance(until)
        found = None if x is None else _outputs(engine, until, x, within)
        if x is None or found is None:
            return states, outputs, min(integrator.t, until)
        states.append(x)
        outputs.append(found)
        progress(until / samples[-1])
    return states, outputs, None


def _outputs(engine: Engine, t: float, x: Array, within: float) -> dict[str, Array] | None:
    """Outputs of a sample; None where they do not exist."""
    try:
        return outputs_at(engine, t, x, within)
    except np.linalg.LinAlgError:
        return None


class _Integrator:
    """Carries the state from sample to sample; ``t`` is the time of its last good state."""

    def __init__(self, engine: Engine, rtol: float, atol: float) -> None:
        for name, value in (("rtol", rtol), ("atol", atol)):
            if not 0 < value < np.inf:
                raise SpaceRobotError(f"{name} of the integrator is {value}, allowed: above zero and finite")
        self._engine, self._rtol, self._atol = engine, rtol, atol
        self.t, self._x = 0.0, engine.x0
        sizes = [len(part) for part in engine.split(engine.x0)]
        self._limits = np.repeat([POSITION_LIMIT, VELOCITY_LIMIT, CONTROLLER_LIMIT], sizes)
        self._step: float | None = None

    def advance(self, until: float) -> tuple[Array | None, float]:
        """Normalised state at a later time, None if it diverges, and a time within the last interval."""
        stops = [t for t in self._engine.breakpoints if self.t < t < until * (1 - 1e-12)]
        within = until
        for stop in [*stops, until]:
            within = 0.5 * (self.t + stop)
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                good = self._interval(stop, within)
            if not good:
                return None, within
        return self._x, within

    def _interval(self, until: float, within: float) -> bool:
        """Integrate one interval without breakpoints inside; whether the state stays good."""
        first = None if self._step is None else min(self._step, until - self.t)
        solver = DOP853(
            lambda t, x: self._rate(t, x, within),
            self.t,
            self._x,
            until,
            rtol=self._rtol,
            atol=self._atol,
            first_step=first,
        )
        if not np.isfinite(solver.f).all():
            return False
        while solver.status == "running":
            solver.step()
            if solver.status == "failed" or not self._is_good(solver.y):
                return False
            self.t = solver.t
        # not the last step, which was cut to fit, but the one that the solver would do next
        self._step = solver.h_abs
        self.t, self._x = until, self._engine.normalise(solver.y)
        return True

    def _rate(self, t: float, x: Array, within: float) -> Array:
        """Rate of the state; NaN where there is none, upon which the solver tries a shorter step."""
        try:
            return self._engine.derivative(t, x, within)
        except np.linalg.LinAlgError:
            return np.full(len(x), np.nan)

    def _is_good(self, x: Array) -> bool:
        return bool((np.abs(x) < self._limits).all())
