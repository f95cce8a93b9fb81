"""One simulation under model predictive control, from scene to result."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from optim.planning.mpc.flight import Computer, Ends, Rows, fly
from optim.planning.mpc.flown_scene import FlownScene
from optim.planning.mpc.handover import Handover
from optim.planning.mpc.horizon import ROUNDING
from optim.planning.mpc.measured_state import readings_of
from optim.planning.mpc.planners import Planners
from spacerobot.arrays import Array
from spacerobot.closedloop import ClosedLoop
from spacerobot.elements.controllers.controller import Replanning
from spacerobot.errors import NoPlanError
from spacerobot.loop_cache import cached_closed_loop
from spacerobot.pinocchio_engine import PinocchioLoop, PinocchioRun
from spacerobot.result import Result
from spacerobot.result.dataset import build_dataset
from spacerobot.result.events import build_events
from spacerobot.result.summary import build_summary
from spacerobot.result.summary_types import MpcStatistics
from spacerobot.rollout import Rollout, Trajectory, build_rollout
from spacerobot.rollout.resumable_loop import end_of, joined, resumed, start_of
from spacerobot.rollout.time_grid import time_grid
from spacerobot.scene import Scene
from spacerobot.simulation import CHECKING_TOLERANCE, fired_events

Progress = Callable[[str], None]
AFTER = 1e-6
"""Time from the beginning of the phase with plans to that of the first plan [s]."""


class SinglePlant:
    """One simulation, rolled out piece by piece; see :class:`optim.planning.mpc.flight.ControlledPlant`.

    Parameters
    ----------
    loop
        The closed loop.
    rollout
        That rolls it out from anywhere.
    output_step_s
        Longest time between samples [s].
    """

    def __init__(self, loop: ClosedLoop, rollout: Rollout, output_step_s: float) -> None:
        self.loop, self.rollout, self._sample_s = loop, rollout, output_step_s
        self.parameters = np.array(loop.parameter_values, dtype=float)[None, :]
        self.start = start_of(loop)[None, :]
        self.readings = [readings_of(loop.variables, {})]
        self.over, self.ended = np.zeros(1, bool), np.zeros(1, bool)
        self.pieces: list[tuple[float, Trajectory]] = []

    def roll(self, p: Array, start: Array, length: float) -> Ends:
        """See :class:`optim.planning.mpc.flight.ControlledPlant`."""
        return self._ends(self._rolled(p, start, length), start)

    def advance(self, rows: Rows, until: float) -> None:
        """See :class:`optim.planning.mpc.flight.ControlledPlant`."""
        now = float(self.start[0, 0])
        if not len(rows) or until - now <= ROUNDING * until:
            return
        piece = self._rolled(self.parameters, self.start, until - now)
        self.pieces.append((now, piece))
        self.ended[0] = piece.status != "completed" or piece.ended_at_s is not None
        self.over[0] |= any(self.loop.events[one.event].kind == "phase" for one in piece.events)
        ends = self._ends(piece, self.start)
        self.start, self.readings = ends.start, list(ends.readings)
        self.start[0, 0] = until  # not the sum of the pieces

    @property
    def trajectory(self) -> Trajectory:
        """Everything so far."""
        return joined(self.pieces)

    def _rolled(self, p: Array, start: Array, length: float) -> Trajectory:
        grid = time_grid(length, self.rollout.grid.step_s * (1 + ROUNDING), self._sample_s)
        return dataclasses.replace(self.rollout, grid=grid).run(
            np.concatenate([p[0], start[0]]), estimate=True
        )

    def _ends(self, piece: Trajectory, start: Array) -> Ends:
        last = {name: values[-1] for name, values in piece.outputs.items()}
        return Ends(end_of(piece, start[0])[None, :], [readings_of(self.loop.variables, last)])


class CheckedPlant(SinglePlant):
    """One simulation by the independent engine; controllers predict with their own model.

    Parameters
    ----------
    loop, rollout
        Closed loop and rollout, as in :class:`SinglePlant`.
    flown
        The scene with places for plans.
    """

    def __init__(self, loop: ClosedLoop, rollout: Rollout, flown: FlownScene) -> None:
        simulation = flown.scene.scenario.simulation
        super().__init__(loop, rollout, simulation.output_step)
        local = simulation.tolerance * CHECKING_TOLERANCE
        self.run = PinocchioRun(PinocchioLoop(flown.scene), local, local / 10)
        place = {path: i for i, path in enumerate(loop.parameter_paths)}
        self._order = [place[path] for path in self.run.engine.parameter_paths]

    def advance(self, rows: Rows, until: float) -> None:
        """See :class:`optim.planning.mpc.flight.ControlledPlant`."""
        if not len(rows) or until - self.start[0, 0] <= ROUNDING * until:
            return
        run, event_count = self.run, len(self.run.integrator.events)
        run.engine.change(self.parameters[0, self._order])
        run.advance(until, self._sample_s)
        self.ended[0] = run.integrator.stopped or run.trajectory.status != "completed"
        self.over[0] |= any(event.kind == "phase" for event in run.integrator.events[event_count:])
        self.start = np.concatenate([[until], run.integrator.x, run.engine.switches])[None, :]
        self.readings = [readings_of(self.loop.variables, run.last_outputs)]

    @property
    def trajectory(self) -> Trajectory:
        """Everything so far."""
        trajectory_so_far = self.run.trajectory
        return dataclasses.replace(trajectory_so_far, events=fired_events(self.loop, trajectory_so_far))


def simulate_mpc(scene: Scene, *, backend: str = "auto", progress: Progress | None = None) -> Result:
    """Simulate a scene whose robots replan in each period.

    Parameters
    ----------
    scene
        Scene with a ``plan`` section and a controller of kind ``mpc`` for each robot, which acts in one phase
        where there are phases.
    backend
        ``auto``, ``compiled`` or ``interpreted``.
    progress
        Callback that receives a short message at each step.

    Returns
    -------
    Result
        Until the plan's end, or to that of the simulation where there are phases; its summary has ``mpc``:
        what planning took against the period. That alone depends on the machine.

    Raises
    ------
    ScenarioError
        If the scene has no such controllers, or the plan's duration does not fit their period.
    NoPlanError
        If no first plan is found.
    """
    began, notify = time.perf_counter(), progress or (lambda _: None)
    flown = FlownScene.of(scene)
    planners = None if flown.phase else Planners(scene, backend, notify)
    notify("compiling the closed loop, or finding it compiled")
    loop, simulation = cached_closed_loop(flown.scene), scene.scenario.simulation
    rollout = build_rollout(
        resumed(loop),
        duration_s=flown.settings.period,
        step_s=simulation.step,
        output_step_s=simulation.output_step,
        tolerance=simulation.tolerance,
        method=simulation.method,
        backend=backend,  # type: ignore[arg-type]
        rollouts=2 * math.ceil(flown.duration_s / flown.settings.period),
    )
    checked = simulation.engine == "pinocchio"
    plant = (
        CheckedPlant(loop, rollout, flown) if checked else SinglePlant(loop, rollout, simulation.output_step)
    )
    handover = None
    if flown.phase:
        notify(f"simulating what comes before {flown.phase}")
        # A scout finds the instant at which the phase begins, so that until then the controllers' plan is to
        # rest there.
        scout = SinglePlant(loop, rollout, simulation.output_step)
        rows, places, begins = np.zeros(1, dtype=np.int64), flown.places(loop.parameter_paths), None
        scout.parameters[0, places] = flown.resting(scout.start[0, 1:])
        while begins is None and not scout.ended[0] and scout.start[0, 0] < flown.duration_s * (1 - ROUNDING):
            scout.advance(rows, min(scout.start[0, 0] + flown.settings.period, flown.duration_s))
            now, piece = scout.pieces[-1]
            for one in piece.events:
                rule = loop.events[one.event]
                if rule.kind == "phase" and rule.who == flown.phase:
                    begins, state = now + one.time_s, one.after
        if begins is None:  # it never does
            plant.parameters[:] = scout.parameters
            plant.advance(rows, flown.duration_s)
        else:
            plant.parameters[0, places] = flown.resting(state)
            plant.advance(rows, begins + AFTER)
            plant.over[:] = False
            handover = Handover.at(scene, loop, plant.start[0])
            planners = Planners(scene, backend, notify, (flown, handover))
    planner_statistics: Mapping[str, Any] | None = None
    if planners is not None:
        (fault,) = fly(Computer(scene, flown, plant, handover), planners, notify)
        if fault:
            raise NoPlanError(fault, source=scene.source, where="plan")
        (planner_statistics,) = planners.end([0])
    trajectory = plant.trajectory
    dataset = build_dataset(scene, trajectory, loop)
    total = time.perf_counter() - began
    timing = {"closed_loop": 0.0, "compile_or_load": 0.0, "rollout": trajectory.wall_s, "total": total}
    notes = {"toolchain": rollout.summary, "step_error": f"{trajectory.step_error:.1e}"}
    events = build_events(scene, loop, trajectory.events)
    summary = build_summary(scene, dataset, trajectory, timing, notes, events)
    if planner_statistics:
        summary["mpc"] = statistics(flown.settings, planner_statistics)
    return Result(scene.scenario, dataset, summary)


def statistics(settings: Replanning, planner_statistics: Mapping[str, Any]) -> MpcStatistics:
    """Plans of a simulation, and the time that they took, for its summary.

    Parameters
    ----------
    settings
        Settings of the controllers.
    planner_statistics
        Statistics of its horizon.
    """
    seconds: Sequence[float] = planner_statistics["seconds"]
    again, allowed = seconds[1:], settings.delay or settings.period
    return {
        "period_s": settings.period,
        "delay_s": settings.delay,
        "plans": planner_statistics["plans"],
        "missed": planner_statistics["missed"],
        "unfinished": planner_statistics["unfinished"],
        "iterations": planner_statistics["iterations"],
        "first_solve_s": seconds[0],
        "median_solve_s": float(np.median(again or [0.0])),
        "longest_solve_s": max(again, default=0.0),
        "in_time": sum(one <= allowed for one in again),
    }
