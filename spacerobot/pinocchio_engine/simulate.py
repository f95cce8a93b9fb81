"""Rollout of a scene with an adaptive integrator of high order."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from spacerobot.closedloop import ClosedLoop
from spacerobot.common.arrays import Array
from spacerobot.pinocchio_engine.closed_loop import PinocchioLoop
from spacerobot.pinocchio_engine.integrator import Integrator, LocatedEvent
from spacerobot.rollout import FiredEvent
from spacerobot.rollout.time_grid import time_grid
from spacerobot.rollout.trajectory import Trajectory, frozen
from spacerobot.scene import Scene

Progress = Callable[[float], None]
"""Called with the completed fraction of the time, 0 to 1."""

CHECKING_TOLERANCE = 1e-2
"""Tolerance of the integrator relative to ``simulation.tolerance``; the error of order 8 is then a hundredth
of it."""


@dataclass(frozen=True, repr=False)
class PinocchioTrajectory(Trajectory):
    """Trajectory of a rollout by this engine.

    Attributes:
        happened: Events of this engine; ``events`` is empty, since it holds events of a closed loop.
    """

    happened: tuple[LocatedEvent, ...] = ()


def simulate(
    scene: Scene,
    *,
    output_step_s: float | None = None,
    duration_s: float | None = None,
    rtol: float = 1e-11,
    atol: float = 1e-12,
    progress: Progress | None = None,
) -> PinocchioTrajectory:
    """Simulate a scene with Pinocchio's algorithms and an explicit Runge-Kutta method of order 8.

    The integration stops at every sample and wherever two segments of a reference meet, so that each step has
    a smooth right-hand side (clipped torques excepted) and samples are not interpolated.

    Args:
        scene: The scene.
        output_step_s, duration_s: Longest time between samples, and duration [s]; the scenario's own if None.
        rtol, atol: Tolerances of the integrator, per component of x.
        progress: Called with the completed fraction, once for each sample.

    Returns:
        PinocchioTrajectory: Without measures and costs. A sample at the end of a reference segment shows the
            values before the end. The trajectory is cut short, with status ``diverged``, if the state leaves
            its bounds, becomes singular or cannot be integrated.

    Raises:
        SpaceRobotError: If a duration, a step or a tolerance is not positive and finite.
    """
    begin, simulation = time.perf_counter(), scene.scenario.simulation
    run = PinocchioRun(PinocchioLoop(scene), rtol, atol)
    run.advance(
        simulation.duration if duration_s is None else duration_s,
        simulation.output_step if output_step_s is None else output_step_s,
        progress,
    )
    return dataclasses.replace(run.trajectory, wall_s=time.perf_counter() - begin)


def fired_events(loop: ClosedLoop, checked: PinocchioTrajectory) -> tuple[FiredEvent, ...]:
    """Events of the independent engine in the closed loop's form; states are the same.

    Args:
        loop: The closed loop.
        checked: Rollout of the same scene by the independent engine.
    """
    switches = loop.setup(loop.parameter_values)[1].full().ravel()[list(loop.switches)]
    rules = {rule.name: place for place, rule in enumerate(loop.events)}
    fired = []
    for event in checked.happened:
        number = rules[event.name]
        for place, value in loop.events[number].sets:
            switches[place] = float(value)
        if not loop.events[number].silent:
            fired.append(FiredEvent(event.time_s, number, event.before, event.after, switches.copy()))
    return tuple(fired)


class PinocchioRun:
    """Rollout that is continued from time to time; parameters may be changed in between.

    Args:
        engine: The engine at the start.
        rtol, atol: As for :func:`simulate`.

    Attributes:
        engine, integrator: Engine and integrator of the rollout.
    """

    def __init__(self, engine: PinocchioLoop, rtol: float, atol: float) -> None:
        self._begin, self.engine = time.perf_counter(), engine
        self.integrator = Integrator(self.engine, rtol, atol)
        self._times, self._states = [0.0], [self.integrator.x]
        self._outputs = [self.engine.outputs(0.0, self.integrator.x)]
        self._bad: float | None = None

    def advance(self, until: float, output_step_s: float, progress: Progress | None = None) -> None:
        """Continue to a time [s], with samples on the way.

        Args:
            until: The time.
            output_step_s: Longest time between samples [s].
            progress: As for :func:`simulate`.
        """
        now = self._times[-1]
        samples = now + time_grid(until - now, output_step_s, output_step_s).time
        samples[-1] = until
        rows = _samples(self.engine, self.integrator, samples, progress or (lambda _: None))
        states, outputs, self._bad = rows
        self._times += samples[1 : 1 + len(states)].tolist()
        self._states += states
        self._outputs += outputs

    @property
    def last_outputs(self) -> dict[str, Array]:
        """Outputs of the last sample, by name."""
        return self._outputs[-1]

    @property
    def trajectory(self) -> PinocchioTrajectory:
        """Trajectory so far."""
        integrator, outputs = self.integrator, self._outputs
        return PinocchioTrajectory(
            time=frozen(np.array(self._times)),
            state=frozen(np.array(self._states)),
            outputs={name: frozen(np.array([y[name] for y in outputs])) for name in outputs[0]},
            measures={},
            costs={},
            status="chattering"
            if integrator.chattering
            else "completed"
            if self._bad is None
            else "diverged",
            diverged_at_s=self._bad,
            steps=0,
            step_s=float("nan"),
            backend="pinocchio",
            wall_s=time.perf_counter() - self._begin,
            ended_at_s=integrator.t if integrator.ended else None,
            happened=tuple(integrator.events),
            state_names=self.engine.state_names,
        )


def _samples(
    engine: PinocchioLoop, integrator: Integrator, samples: Array, progress: Progress
) -> tuple[list[Array], list[dict[str, Array]], float | None]:
    """States and outputs at later samples, and the time [s] of an early end, None without one."""
    states, outputs = list[Array](), list[dict[str, Array]]()
    for until in samples[1:]:
        x, within = integrator.advance(until)
        if integrator.stopped:
            return states, outputs, integrator.t if integrator.chattering else None
        rows = None if x is None else _outputs(engine, until, x, within)
        if x is None or rows is None:
            return states, outputs, min(integrator.t, until)
        states.append(x)
        outputs.append(rows)
        progress(until / samples[-1])
    return states, outputs, None


def _outputs(engine: PinocchioLoop, t: float, x: Array, within: float) -> dict[str, Array] | None:
    """Outputs at a sample; None if they cannot be computed."""
    try:
        return engine.outputs(t, x, within)
    except np.linalg.LinAlgError:
        return None
