"""Simulations that are rolled out in segments, from one update of their controllers to the next."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from spacerobot.closedloop import ClosedLoop, OutputVariable
from spacerobot.common.arrays import Array
from spacerobot.elements.controllers.controller import INPUT
from spacerobot.rollout import Rollout, Trajectory
from spacerobot.rollout.closed_loop_protocol import LoopParameters
from spacerobot.rollout.resumable_loop import end_of, joined, start_of
from spacerobot.rollout.time_grid import time_grid
from spacerobot.scene import Scene

Rows = NDArray[np.int64]
"""Indices of some of N simulations (n,)."""

Inputs = Mapping[str, Array]
"""Inputs of controllers with a Python update at one instant, by the output's name, each (n,)."""

ROUNDING = 1e-9
"""Relative tolerance of times."""
SHORT = 1e-11
"""Duration of a rollout that evaluates the outputs at its start [s]."""


def input_variables(variables: Sequence[OutputVariable]) -> list[OutputVariable]:
    """Output variables that are inputs of controllers with a Python update."""
    return [one for one in variables if INPUT in one.name]


@dataclass
class Ends:
    """States at the ends of n rollouts of the same duration.

    Attributes:
        start: Time, state and switches (n, 1 + nx + ns), from which the next rollouts begin.
        inputs: Inputs of the controllers, one mapping for each rollout.
    """

    start: Array
    inputs: Sequence[Inputs]


class UpdatedPlant(Protocol):
    """N simulations whose controllers are updated in Python.

    Updates may change ``parameters``, and the held values among the states in ``start``.

    Attributes:
        parameters: Parameters of the closed loop (N, np).
        start: Present time [s], state and switches of each simulation (N, 1 + nx + ns).
        inputs: Present inputs of controllers in each simulation; empty at the start.
        over, ended: Whether a phase of the scenario has ended, and whether the simulation has (N,).
        variables: Output variables of the closed loop.
    """

    parameters: Array
    start: Array
    inputs: list[Inputs]
    over: NDArray[np.bool_]
    ended: NDArray[np.bool_]
    variables: Sequence[OutputVariable]

    @property
    def loop(self) -> LoopParameters:
        """The closed loop."""

    def roll(self, p: Array, start: Array, duration: float) -> Ends:
        """Roll out for a duration [s] from given starts, without a change of the simulations.

        Args:
            p: Parameters (n, np).
            start: Times, states and switches (n, 1 + nx + ns).
            duration: Duration [s].
        """

    def advance(self, rows: Rows, until: float) -> None:
        """Advance some simulations to a time [s]."""


class SinglePlant:
    """One simulation that records its trajectory; see :class:`UpdatedPlant`.

    Args:
        loop: The closed loop.
        rollout: Rollout of the resumable loop.
        output_step_s: Maximum time between samples [s].
    """

    def __init__(self, loop: ClosedLoop, rollout: Rollout, output_step_s: float) -> None:
        self.loop, self.rollout, self._sample_s = loop, rollout, output_step_s
        self.variables: Sequence[OutputVariable] = loop.variables
        self.parameters = np.array(loop.parameter_values, dtype=float)[None, :]
        self.start = start_of(loop)[None, :]
        self.inputs: list[Inputs] = [{}]
        self.over, self.ended = np.zeros(1, bool), np.zeros(1, bool)
        self.pieces: list[tuple[float, Trajectory]] = []

    def scout(self) -> SinglePlant:
        """New copy of the simulation at its start, for a trial run."""
        return SinglePlant(self.loop, self.rollout, self._sample_s)

    def roll(self, p: Array, start: Array, duration: float) -> Ends:
        """See :class:`UpdatedPlant`."""
        ends = [
            self._ends(self._rolled(row[None, :], begin[None, :], duration), begin[None, :])
            for row, begin in zip(p, start, strict=True)
        ]
        return Ends(np.vstack([one.start for one in ends]), [inputs for one in ends for inputs in one.inputs])

    def advance(self, rows: Rows, until: float) -> None:
        """See :class:`UpdatedPlant`."""
        now = float(self.start[0, 0])
        if not len(rows) or until - now <= ROUNDING * until:
            return
        piece = self._rolled_on(until)
        self.pieces.append((now, piece))
        self.ended[0] = piece.status != "completed" or piece.ended_at_s is not None
        self.over[0] |= any(self.loop.events[one.event].kind == "phase" for one in piece.events)
        ends = self._ends(piece, self.start)
        self.start, self.inputs = ends.start, list(ends.inputs)
        self.start[0, 0] = until  # exact, without the rounding of summed durations

    def _rolled_on(self, until: float) -> Trajectory:
        """Roll out from the present state to a time [s]."""
        return self._rolled(self.parameters, self.start, until - float(self.start[0, 0]))

    @property
    def trajectory(self) -> Trajectory:
        """The trajectory so far."""
        return joined(self.pieces)

    def _rolled(self, p: Array, start: Array, duration: float) -> Trajectory:
        grid = time_grid(duration, self.rollout.grid.step_s * (1 + ROUNDING), self._sample_s)
        return dataclasses.replace(self.rollout, grid=grid).run(
            np.concatenate([p[0], start[0]]), estimate=True
        )

    def _ends(self, piece: Trajectory, start: Array) -> Ends:
        last = {one.name: piece.outputs[one.name][-1] for one in input_variables(self.variables)}
        return Ends(end_of(piece, start[0])[None, :], [last])


class CheckedPlant(SinglePlant):
    """One simulation by the independent engine, with predictions (:meth:`roll`) by the closed loop.

    Args:
        loop, rollout: Closed loop and rollout, as in :class:`SinglePlant`.
        scene: Scene of the closed loop.
    """

    def __init__(self, loop: ClosedLoop, rollout: Rollout, scene: Scene) -> None:
        from spacerobot.pinocchio_engine import PinocchioLoop, PinocchioRun
        from spacerobot.pinocchio_engine.simulate import CHECKING_TOLERANCE

        simulation = scene.scenario.simulation
        super().__init__(loop, rollout, simulation.output_step)
        local = simulation.tolerance * CHECKING_TOLERANCE
        self.run = PinocchioRun(PinocchioLoop(scene), local, local / 10)
        place = {path: i for i, path in enumerate(loop.parameter_paths)}
        self._order = [place[path] for path in self.run.engine.parameter_paths]

    def advance(self, rows: Rows, until: float) -> None:
        """See :class:`UpdatedPlant`."""
        if not len(rows) or until - self.start[0, 0] <= ROUNDING * until:
            return
        run, event_count = self.run, len(self.run.integrator.events)
        run.engine.change(self.parameters[0, self._order])
        run.integrator.change(self.start[0, 1 : 1 + len(run.integrator.x)])
        run.advance(until, self._sample_s)
        self.ended[0] = run.integrator.stopped or run.trajectory.status != "completed"
        self.over[0] |= any(event.kind == "phase" for event in run.integrator.events[event_count:])
        self.start = np.concatenate([[until], run.integrator.x, run.engine.switches])[None, :]
        names = [one.name for one in input_variables(self.variables)]
        self.inputs = [{name: run.last_outputs[name] for name in names if name in run.last_outputs}]

    @property
    def trajectory(self) -> Trajectory:
        """The trajectory so far."""
        from spacerobot.pinocchio_engine.simulate import fired_events

        trajectory_so_far = self.run.trajectory
        return dataclasses.replace(trajectory_so_far, events=fired_events(self.loop, trajectory_so_far))
