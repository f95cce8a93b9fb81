"""Flight of exported controllers against the plant of the closed loop.

The closed loop is unchanged, except that the clocks of the controllers' own events are set far into the
future so that these never fire. Between the controllers' instants the loop is rolled out; at each instant the
exported code is called with the present sensor samples and plant values. Its results replace the loop's
states of the same names, and commands are held until the next instant.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
import numpy.typing as npt

from spacerobot.closedloop import ClosedLoop
from spacerobot.common.arrays import Array
from spacerobot.flightcode.controller_library import OnboardController
from spacerobot.flightcode.onboard import Field, Task
from spacerobot.rollout import FiredEvent, Rollout, Trajectory, build_rollout
from spacerobot.rollout.noise import NoiseInput
from spacerobot.rollout.resumable_loop import SWITCHES, resumed, start_of
from spacerobot.rollout.tables import fill
from spacerobot.rollout.time_grid import TimeGrid, pieces, time_grid
from spacerobot.scene import Scene
from spacerobot.updates.plant import ROUNDING, SinglePlant

NEVER = 1e9
"""Sample number of a clock that never ticks."""

COINCIDENT = 1e-9
"""Time [s] within which instants are one; a controller's instant precedes the start of a phase."""


class ControlledPlant(SinglePlant):
    """Simulation whose periodic controllers are exported code; other controllers may be Python functions.

    Args:
        loop, rollout, output_step_s: See :class:`spacerobot.updates.plant.SinglePlant`.
        controller: The exported controller.
    """

    def __init__(
        self, loop: ClosedLoop, rollout: Rollout, output_step_s: float, controller: OnboardController
    ) -> None:
        super().__init__(loop, rollout, output_step_s)
        self._flight = ControlledFlight.of(loop, rollout, controller)

    def _rolled_on(self, until: float) -> Trajectory:
        """Roll out from the present state to a time [s]."""
        flight, step_s = self._flight, self.rollout.grid.step_s * (1 + ROUNDING)
        flight.parameters, flight.start = self.parameters[0], self.start[0].copy()
        return flight.advance(until, step_s, self._sample_s)


@dataclass
class ControlledFlight:
    """A plant and a controller, rolled out piece by piece.

    Attributes:
        loop: The closed loop.
        rollout: Resumed rollout of the same loop.
        controller: The exported controller.
        parameters: Parameters of the closed loop (np,).
        start: Present time, state and switches; see :func:`spacerobot.rollout.resumable_loop.start_of`.
        fired: Events of the controller that are not recorded yet, with absolute times.
    """

    loop: ClosedLoop
    rollout: Rollout
    controller: OnboardController
    parameters: Array
    start: Array
    fired: list[FiredEvent] = dataclasses.field(default_factory=list)

    def __post_init__(self) -> None:
        software = self.controller.software
        self._last_states = np.concatenate([np.zeros(0), *(one.initial for one in software.states)])

    @classmethod
    def of(cls, loop: ClosedLoop, rollout: Rollout, controller: OnboardController) -> ControlledFlight:
        """Flight from the start of a closed loop."""
        parameters = np.array(loop.parameter_values, dtype=float)
        return cls(loop, rollout, controller, parameters, start_of(loop))

    # -- places of the controller's fields -------------------------------------------------------------------

    @functools.cached_property
    def _inputs(self) -> list[tuple[Field, slice]]:
        """Inputs with their places among all inputs."""
        return _placed(self.controller.software.inputs)

    @functools.cached_property
    def _clocks(self) -> npt.NDArray[np.int64]:
        """Indices in x of the sample numbers of the controllers' clocks."""
        software = self.controller.software
        written_fields = {one.path: one for task in software.tasks for one in task.writes}
        counts = [one for path, one in written_fields.items() if path.endswith(".count")]
        return np.array([place for one in counts for place in one.places], dtype=np.int64)

    @functools.cached_property
    def _stored(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Indices in x of the controller's states, and their indices in the controller's state vector."""
        names = {name: i for i, name in enumerate(self.loop.state_names)}
        targets, sources = list[int](), list[int]()
        for one, part in _placed(self.controller.software.states):
            if one.path in names or f"{one.path}[0]" in names:
                targets += one.places
                sources += range(part.start, part.stop)
        return np.array(targets, dtype=np.int64), np.array(sources, dtype=np.int64)

    @functools.cached_property
    def _noise(self) -> Array:
        """Standard normal numbers of all samples."""
        noise = NoiseInput.of(self.loop.noise, self.loop.parameter_paths)
        return np.asarray(noise.drawn(self.parameters[None, :])[0], dtype=float)

    def _constants(self, time: float, x: Array, switches: Array) -> Array:
        """Constants c with the switches, and with the present random numbers in their windows."""
        c = self.loop.setup(self.parameters)[1].full().ravel()
        c[list(self.loop.switches)] = switches
        rows = self.loop.rows(time, x, c).full().ravel().astype(np.int64)
        fill(self.loop.tables, rows, c, noise=self._noise)
        return np.asarray(c, dtype=float)

    @functools.cached_property
    def _draws(self) -> bool:
        """Whether an input is a random number."""
        return any(one.role == "draw" for one, _ in self._inputs)

    @functools.cached_property
    def _alarms(self) -> list[tuple[Task, int]]:
        """Detections, each with the index of its switch in the controller's state vector."""
        places = {one.path: part.start for one, part in _placed(self.controller.software.states)}
        software, alarms = self.controller.software, list[tuple[Task, int]]()
        rules = {rule.name: rule for rule in self.loop.events}
        for task in software.detections:
            switches = [self.loop.switch_names[place] for place, on in rules[task.path].sets if on]
            alarms += [(task, places[name]) for name in switches[:1] if name in places]
        return alarms

    @functools.cached_property
    def _numbers(self) -> dict[str, int]:
        """Indices of the loop's events by name."""
        return {rule.name: number for number, rule in enumerate(self.loop.events)}

    def _parts(self, start: Array) -> tuple[float, Array, Array]:
        """Time, state and switches."""
        nx = self.loop.nx
        return float(start[0]), start[1 : 1 + nx], start[1 + nx :]

    def _gathered(self, time: float, x: Array, switches: Array) -> Array:
        """Vector of all controller inputs at a time [s] and a state of the plant."""
        values = np.zeros(sum(one.size for one, _ in self._inputs))
        order = {place: i for i, place in enumerate(self.loop.switches)}
        constants = self._constants(time, x, switches) if self._draws else np.zeros(0)
        for one, part in self._inputs:
            places = list(one.places)
            if one.role == "mode":
                values[part] = switches[[order[place] for place in places]]
            elif one.role == "plan":
                values[part] = self.parameters[places]
            elif one.role == "draw":
                values[part] = constants[places]
            else:
                values[part] = x[places]
        return values

    # -- flight ----------------------------------------------------------------------------------------------

    def begin(self) -> None:
        """Take the first samples of the sensors and the first step of the controller."""
        time, x, switches = self._parts(self.start)
        x = x.copy()
        c = self._constants(time, x, switches)
        task_names = {task.path for task in self.controller.software.tasks}
        xdot = np.zeros(self.loop.nx)
        for number, event in enumerate(self.loop.events):
            if not event.clock or event.kind != "measured" or event.name in task_names:
                continue
            values = self.loop.guards(time, x, c, xdot)
            if float(values[0][number]) > 0:
                x = self.loop.update(time, x, c, float(number)).full().ravel()
        self.start[1 : 1 + self.loop.nx] = x
        self._step(self._gathered(time, x, switches))

    def advance(self, until: float, step_s: float, sample_s: float) -> Trajectory:
        """Roll out until a time, the controller's step at that time included.

        Args:
            until: Time of the end [s].
            step_s, sample_s: Longest step and longest time between samples [s].

        Returns:
            Trajectory: Time counted from the present one.
        """
        begin = float(self.start[0])
        grid = time_grid(until - begin, step_s, sample_s)
        record = _Record(begin, waiting=True)
        if self.controller.tick == 0:  # the first sample shows the state before sensors and controllers act
            record.add(
                begin,
                self._parts(self.start)[1],
                self._piece(begin + COINCIDENT, exact_outputs=True),
                events=False,
            )
            self.begin()
            record.take(self.fired)
        for k in range(grid.intervals):
            last = self._interval(
                until if k + 1 == grid.intervals else begin + grid.time[k + 1], step_s, record
            )
            if last.status != "completed" or last.ended_at_s is not None:
                return record.trajectory(last, grid)
        record.add(
            until,
            self._parts(self.start)[1],
            self._piece(until + COINCIDENT, exact_outputs=True),
            events=False,
        )
        return record.trajectory(last, grid)

    def _interval(self, end: float, step_s: float, record: _Record) -> Trajectory:
        """Advance to the next output sample and return the last piece.

        The steps are those of an uninterrupted rollout: an instant of a clock ends a step, and the rest of
            the interval is again divided into equal steps.
        """
        begin, completed_steps = float(self.start[0]), 0
        while True:
            present = float(self.start[0])
            count = pieces(end - begin, step_s)
            step_end = (
                end if completed_steps + 1 == count else begin + (completed_steps + 1) * (end - begin) / count
            )
            instant = self._next_instant(present)
            target = instant if instant < step_end - COINCIDENT else step_end
            if record.waiting and self._outputs_count:
                record.add(
                    present,
                    self._parts(self.start)[1],
                    self._piece(present + COINCIDENT, exact_outputs=True),
                    events=False,
                )
            piece = self._piece(target)
            record.add(present, self._parts(self.start)[1], piece)
            if piece.status != "completed" or piece.ended_at_s is not None:
                return piece
            self._conclude(piece, target)
            record.take(self.fired)
            if target == end:
                record.waiting = True
                return piece
            if abs(target - instant) <= COINCIDENT:
                begin, completed_steps = target, 0
            else:
                completed_steps += 1

    def _next_instant(self, now: float) -> float:
        """Next instant of a clock of the controller or of a sensor [s]."""
        software = self.controller.software
        tick = self.controller.tick
        while not software.is_busy(tick) or software.time(tick) <= now + COINCIDENT:
            tick += 1
        instants = [software.time(tick)]
        for period, first in software.sampling:
            number = max(0, math.floor((now + COINCIDENT - first) / period) + 1)
            instants.append(first + number * period)
        return min(instants)

    @functools.cached_property
    def _outputs_count(self) -> bool:
        """Whether an output depends on the sample number of a controller's clock."""
        columns = set(self._clocks.tolist())
        outputs = self.loop.outputs
        patterns = (outputs.jac_sparsity(i, 1) for i in range(outputs.n_out()))
        return any(columns & set(pattern.get_col()) for pattern in patterns)

    def _piece(self, end: float, *, exact_outputs: bool = False) -> Trajectory:
        """Rollout of the plant from the present to a time; the stored state is unchanged.

        With ``exact_outputs``, the outputs of its first sample are exact.
        """
        start = self.start.copy()
        if not exact_outputs:
            start[1 + self._clocks] = NEVER
        length = end - float(start[0])
        rollout = dataclasses.replace(self.rollout, grid=TimeGrid(length, 1, 1))
        return rollout.run(np.concatenate([self.parameters, start]), estimate=True)

    def _conclude(self, piece: Trajectory, end: float) -> None:
        """Advance to a piece's end: phases that started in it, and the controller's steps up to its end."""
        begin, counts = float(self.start[0]), self.start[1 + self._clocks].copy()
        software = self.controller.software
        self.start = np.concatenate([[end], piece.state[-1], piece.outputs[SWITCHES][-1]])
        self.start[1 + self._clocks] = counts
        entries = {task.path: task for task in software.entries}
        phases = [one for one in piece.events if self.loop.events[one.event].name in entries]
        # A phase that begins at the instant of a step begins after it.
        phases.sort(key=lambda one: one.time_s)
        _, x, switches = self._parts(self.start)
        for one in phases:
            time = begin + one.time_s
            before = self._gathered(time, one.before[: len(x)], switches)
            self._steps_until(end if time > end - COINCIDENT else time - 2 * COINCIDENT, before)
            inputs = self._gathered(time, one.before[: len(x)], one.switches)
            entry = entries[self.loop.events[one.event].name]
            self._store(self.controller.enter(entry, inputs, time))
        self._steps_until(end, self._gathered(end, x, self._parts(self.start)[2]))

    def _steps_until(self, time: float, inputs: Array) -> None:
        """Step the controller up to a time [s]."""
        software = self.controller.software
        while software.time(self.controller.tick) <= time + COINCIDENT:
            self._step(inputs)

    def _step(self, inputs: Array) -> None:
        """Step of the controller, with the effects of its events on the plant."""
        software, tick = self.controller.software, self.controller.tick
        states = self.controller.step(inputs)[0]
        due = [task for task in software.tasks if not task.continual and task.is_due(tick)]
        alarms = [task for task, place in self._alarms if states[place] > self._last_states[place]]
        self._store(states)
        for task in due:
            if not self.loop.events[self._numbers[task.path]].silent:
                self._fire(task, software.time(tick), alarm=False)
        for task in alarms:
            self._fire(task, software.time(tick), alarm=True)
            self._store(states)

    def _fire(self, task: Task, time: float, *, alarm: bool) -> None:
        """Turn the switches of an event, and record it; after an alarm, brakes stop joints at once."""
        number = self._numbers[task.path]
        rule = self.loop.events[number]
        _, before, switches = self._parts(self.start.copy())
        for place, on in rule.sets:
            switches[place] = float(on)
        after = before
        if alarm:
            constants = self._constants(time, before, switches)
            after = self.loop.update(time, before, constants, float(number)).full().ravel()
        self.start = np.concatenate([[self.start[0]], after, switches])
        if not rule.silent:
            self.fired.append(FiredEvent(time, number, before, after.copy(), switches.copy()))

    def _store(self, states: Array) -> None:
        """Replace the plant's states by the controller's."""
        targets, sources = self._stored
        self.start[1 + targets] = states[sources]
        self._last_states = states


def fly(scene: Scene, rollout: Rollout, grid: TimeGrid, controller: OnboardController) -> Trajectory:
    """Fly a scene by exported code.

    Args:
        scene, rollout: The scene, and the rollout of its closed loop.
        grid: Steps and samples.
        controller: The exported controller.
    """
    loop, simulation = cast("ClosedLoop", rollout.loop), scene.scenario.simulation
    resumed_rollout = build_rollout(
        resumed(loop),
        duration_s=grid.duration_s,
        step_s=grid.step_s,
        output_step_s=grid.step_s * grid.every,
        tolerance=simulation.tolerance,
        method=simulation.method,
        backend=rollout.backend,  # type: ignore[arg-type]
        rollouts=1,
    )
    flight = ControlledFlight.of(loop, resumed_rollout, controller)
    step_result = flight.advance(
        grid.duration_s, grid.step_s * (1 + ROUNDING), grid.step_s * grid.every * (1 + ROUNDING)
    )
    return dataclasses.replace(step_result, backend=rollout.backend)


@dataclass
class _Record:
    """Samples of a flight; each is taken at the start of the next piece, after the controller's step."""

    begin: float
    waiting: bool = False
    times: list[float] = dataclasses.field(default_factory=list)
    states: list[Array] = dataclasses.field(default_factory=list)
    outputs: list[dict[str, Array]] = dataclasses.field(default_factory=list)
    events: list[FiredEvent] = dataclasses.field(default_factory=list)
    steps: int = 0
    wall_s: float = 0.0
    last: float = 0.0
    step_error: float = 0.0

    def add(self, time: float, x: Array, piece: Trajectory, *, events: bool = True) -> None:
        """Record the first sample of a piece, if one is due, and its events."""
        if self.waiting:
            self._sample(time, x, {name: values[0] for name, values in piece.outputs.items()})
            self.waiting = False
        if events:
            self.last = elapsed = time - self.begin
            self.events += [dataclasses.replace(one, time_s=one.time_s + elapsed) for one in piece.events]
            self.steps += piece.steps
            self.step_error = max(self.step_error, piece.step_error)
        self.wall_s += piece.wall_s

    def take(self, fired: list[FiredEvent]) -> None:
        """Record the events of the controller."""
        self.events += [dataclasses.replace(one, time_s=one.time_s - self.begin) for one in fired]
        fired.clear()

    def _sample(self, time: float, x: Array, outputs: dict[str, Array]) -> None:
        self.times.append(time - self.begin)
        self.states.append(x.copy())
        self.outputs.append(outputs)

    def trajectory(self, last: Trajectory, grid: TimeGrid) -> Trajectory:
        """Trajectory of all samples, with the status of the last piece."""
        times = np.array(self.times)
        if last.ended_at_s is None and len(times) == grid.intervals + 1:
            times = grid.time
        return dataclasses.replace(
            last,
            time=times,
            state=np.array(self.states),
            outputs={name: np.array([one[name] for one in self.outputs]) for name in last.outputs},
            steps=self.steps,
            step_s=grid.step_s,
            wall_s=self.wall_s,
            step_error=self.step_error,
            events=tuple(self.events),
            ended_at_s=None if last.ended_at_s is None else self.last + last.ended_at_s,
            diverged_at_s=None if last.diverged_at_s is None else self.last + last.diverged_at_s,
        )


def _placed(fields: Sequence[Field]) -> list[tuple[Field, slice]]:
    """Fields with their slices in one vector."""
    ends = np.cumsum([0, *(one.size for one in fields)]).tolist()
    return [(one, slice(a, b)) for one, a, b in zip(fields, ends[:-1], ends[1:], strict=True)]
