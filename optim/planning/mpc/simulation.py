"""Model predictive control: each period replans from the measured state, for the time that is left."""

from __future__ import annotations

import dataclasses
import itertools
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from optim.planning.formulation.formulate import scene_with_plan_model
from optim.planning.mpc.horizon import ROUNDING, Horizon
from optim.planning.mpc.measured_state import measured_state, sensors_of
from optim.planning.search.plan_solver import PlanSolver
from spacerobot.arrays import Array
from spacerobot.closedloop import ClosedLoop
from spacerobot.elements.controller import Replanning
from spacerobot.errors import ScenarioError
from spacerobot.loop_cache import cached_closed_loop
from spacerobot.result import Result
from spacerobot.result.dataset import build_dataset
from spacerobot.result.events import build_events
from spacerobot.result.summary import build_summary
from spacerobot.rollout import Rollout, Trajectory, build_rollout
from spacerobot.rollout.resumable_loop import end_of, joined, resumed, start_of
from spacerobot.rollout.time_grid import time_grid
from spacerobot.scenario.load import to_document
from spacerobot.scenario.phases import successors
from spacerobot.scenario.sensors import Sensors
from spacerobot.scene import Scene, build_scene
from spacerobot.section import numbers

Progress = Callable[[str], None]
OFTEN = 1000
"""Motions that are made in flight, as far as it counts whether compiling pays: time presses there."""


def mpc_controllers(scene: Scene) -> dict[str, tuple[str, Replanning]]:
    """Key of each robot's controller whose plan is made again in flight, and how that is done, by robot."""
    return {
        body: (key, controller.replanning)
        for body, robot in scene.scenario.robots.items()
        for key, controller in robot.controllers.items()
        if controller.replanning is not None
    }


@dataclass
class _MpcSimulation:
    """A simulation with model predictive control, advanced piece by piece.

    Attributes
    ----------
    scene, loop, rollout
        The scene, its closed loop with the knots of one period, and what rolls that out from anywhere.
    settings
        Numbers of the controllers.
    horizon
        The plans.
    sensors
        Of each robot, in the phase of the plans.
    start
        Where the next piece begins: time, state, switches.
    pieces
        With the times at which they began [s].
    over
        Whether the first phase, that of the plans, has ended.
    ended
        Whether the simulation has.
    """

    scene: Scene
    loop: ClosedLoop
    rollout: Rollout
    settings: Replanning
    horizon: Horizon
    sensors: Mapping[str, Sensors]
    start: Array
    pieces: list[tuple[float, Trajectory]] = field(default_factory=list)
    over: bool = False
    ended: bool = False

    @property
    def now(self) -> float:
        """Time [s]."""
        return float(self.start[0])

    def advance(self, p: Array, end: float) -> None:
        """Go on to a time [s], with parameters of the closed loop (np,)."""
        if self.ended or end - self.now <= ROUNDING * end:
            return
        piece = self._rolled(p, self.start, end - self.now)
        self.pieces.append((self.now, piece))
        self.ended = piece.status != "completed" or piece.ended_at_s is not None
        self.over = self.over or any(self.loop.events[one.event].kind == "phase" for one in piece.events)
        self.start = end_of(piece, self.start, self.loop.nx)
        self.start[0] = end  # not the sum of the pieces

    def plan(self, p: Array) -> None:
        """Replan from present measurements for the time after the delay, flown with parameters p (np,)."""
        state, ready = self.start.copy(), self.now + self.settings.delay
        size = self.loop.nq + self.loop.nv
        state[1 : 1 + size] = measured_state(self.scene, self.horizon.solver.plan, self.sensors, state[1:])
        if self.settings.delay:
            piece = self._rolled(self._ideal(p), state, self.settings.delay)
            state = end_of(piece, state, self.loop.nx)
        self.horizon.replan(ready, state[1 : 1 + size], self.settings.iterations)

    def _rolled(self, p: Array, start: Array, length: float) -> Trajectory:
        simulation, grid = self.scene.scenario.simulation, self.rollout.grid
        own = time_grid(length, grid.step_s * (1 + ROUNDING), simulation.output_step)
        rollout = dataclasses.replace(self.rollout, grid=own)
        return rollout.run(np.concatenate([p, start]), estimate=True)

    def _ideal(self, p: Array) -> Array:
        """Parameters of the controllers' own model, `plan.model`, which knows of no errors of sensors."""
        found, own = p.copy(), scene_with_plan_model(self.scene)
        if own is not self.scene:
            before, after = (dict(numbers(to_document(one.scenario))) for one in (self.scene, own))
            changed = {path: value for path, value in after.items() if value != before.get(path)}
            for place, path in enumerate(self.loop.parameter_paths):
                found[place] = changed.get(path, found[place])
        for place, path in enumerate(self.loop.parameter_paths):
            robot, *_ = path.partition(".sensors.")
            if robot != path:
                found[place] = {"offset": 0.0, "scale": 1.0}.get(path.rpartition(".")[2], found[place])
        return found

    def numbers(self) -> Array:
        """Parameters of the closed loop in the period that begins now (np,)."""
        place = {path: i for i, path in enumerate(self.loop.parameter_paths)}
        p = np.array(self.loop.parameter_values, dtype=float)
        for robot, (key, _) in mpc_controllers(self.scene).items():
            path = f"robots.{robot}.controllers.{key}"
            knots = self.horizon.knots(self.now, self.settings.period, robot)
            p[place[f"{path}.begin"]] = self.now
            for name in ("position", "rate", "effort"):
                for k, row in enumerate(knots[name]):
                    for j, value in enumerate(row):
                        p[place[f"{path}.knots.{name}.{k}.{j}"]] = value
        return p


def simulate_mpc(scene: Scene, *, backend: str = "auto", progress: Progress | None = None) -> Result:
    """Simulate a scene whose robots replan in each period.

    Parameters
    ----------
    scene
        With a ``plan`` section, and a controller of kind ``mpc`` for each robot, which acts in the first
        phase where there are phases.
    backend
        ``auto``, ``compiled`` or ``interpreted``.
    progress
        Told in a few words what begins.

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
    settings = mpc_settings(scene)
    solver = PlanSolver.of(scene, backend, notify, motions=OFTEN)
    _check_driven(solver)
    sensors, state = sensors_of(scene), np.concatenate([scene.q, scene.v])
    horizon = Horizon.of(solver, measured_state(scene, solver.plan, sensors, state), settings.min_horizon)
    notify("compiling the closed loop, or finding it compiled")
    rollout, loop = _rollout(scene, horizon, settings.period, backend)
    flight = _MpcSimulation(scene, loop, rollout, settings, horizon, sensors, start_of(loop))
    end = scene.scenario.simulation.duration if scene.scenario.phases else horizon.first_duration_s
    for k in itertools.count():
        if flight.over or flight.ended or flight.now >= end:
            break
        notify(f"flying: {flight.now:.3g} of {end:.3g} s, {len(horizon.seconds)} plans")
        p, now = flight.numbers(), k * settings.period
        if k and horizon.replans_at(now + settings.delay):
            flight.plan(p)
            if settings.delay:
                flight.advance(p, min(now + settings.delay, end))
            p = flight.numbers()
        flight.advance(p, min(now + settings.period, end))
    notify("flying: all that follows the plans")
    flight.advance(flight.numbers(), end)
    return _result(flight, began)


def mpc_settings(scene: Scene) -> Replanning:
    """Settings that all mpc controllers share: period, delay, and when the last plan is made.

    Parameters
    ----------
    scene
        With a controller of kind ``mpc`` for each robot.

    Raises
    ------
    ScenarioError
        If robots differ in them, one has none, they do not rest behind the first phase, or the plan's
        duration is not so many periods.
    """
    source, given, plan = scene.source, mpc_controllers(scene), scene.scenario.plan
    for body in scene.robots:
        if body.name not in given:
            raise ScenarioError(
                "has no controller of kind mpc; a plan moves the joints of all robots",
                source=source,
                where=f"robots.{body.name}.controllers",
            )
    leads = [lead for _, lead in given.values()]
    for key in ("period", "min_horizon", "delay", "iterations"):
        if len({getattr(lead, key) for lead in leads}) > 1:
            told = f"controllers of kind mpc differ in {key}, allowed: one for all robots"
            raise ScenarioError(told, source=source, where="robots")
    settings = leads[0]
    if plan is not None:
        # a plan of several phases has no duration of its own
        for key, what in (("phases", "several phases"), ("start", "a free start")):
            if getattr(plan, key):
                told = f"found {what}, allowed with kind mpc: none"
                raise ScenarioError(told, source=source, where=f"plan.{key}")
        count, timed = plan.duration.upper / settings.period, plan.duration
        if timed.lower != timed.upper or abs(count - round(count)) > ROUNDING * count:
            free = "" if timed.lower == timed.upper else f"{timed.lower:g} to "
            raise ScenarioError(
                f"found {free}{timed.upper:g} s, allowed with kind mpc: "
                f"one number, so many periods of {settings.period:g} s",
                source=source,
                where="plan.duration",
            )
    _check_phases(scene)
    _check_held(scene, settings.period)
    return settings


def _check_held(scene: Scene, period: float) -> None:
    """Refuse sensors that measure at other times than plans are made.

    Raises
    ------
    ScenarioError
        Naming the first one.
    """
    for name, sensors in sensors_of(scene).items():
        for signal, sensor in sensors:
            if sensor.errors is not None:
                raise ScenarioError(
                    "found sensor errors, allowed with kind mpc: none",
                    source=scene.source,
                    where=f"robots.{name}.sensors.{signal}.errors",
                )
            if sensor.holds and abs(period / sensor.period - round(period / sensor.period)) > ROUNDING:
                raise ScenarioError(
                    f"found {sensor.period:g} s, allowed with kind mpc: a part of {period:g} s",
                    source=scene.source,
                    where=f"robots.{name}.sensors.{signal}.period",
                )


def _check_phases(scene: Scene) -> None:
    """Refuse phases in which plans are made but the first one.

    Raises
    ------
    ScenarioError
        Naming the first one.
    """
    phases = scene.scenario.phases
    first = next(iter(phases), None)
    if first is None:
        return
    for name, (robot, (key, _)) in itertools.product(phases, mpc_controllers(scene).items()):
        own = scene.scenario.during(name).robots[robot]
        where = f"phases.{name}.robots.{robot}"
        if name != first:
            if key in own.controllers:
                raise ScenarioError(
                    f"plans are made in the first phase alone; write `{key}: null` here",
                    source=scene.source,
                    where=f"{where}.controllers",
                )
        elif key not in own.controllers:
            told = "rests in the first phase, in which plans are made and flown"
            raise ScenarioError(told, source=scene.source, where=f"{where}.controllers.{key}")
    for name, follows in successors(phases).items():
        if first in follows:
            told = f"leads back to {first!r}; plans are made in it once"
            raise ScenarioError(told, source=scene.source, where=f"phases.{name}")


def _check_driven(solver: PlanSolver) -> None:
    """Refuse plans that drive bases, which joints do not follow.

    Raises
    ------
    ScenarioError
        Naming the limits.
    """
    driven = solver.problem.stage.driven
    if len(driven.names) > len(driven.joints):
        told = "found an actuator on a base, allowed with kind mpc: only joints are controlled"
        raise ScenarioError(told, source=solver.scene.source, where="plan.limits")


def _rollout(scene: Scene, horizon: Horizon, period: float, backend: str) -> tuple[Rollout, ClosedLoop]:
    """Rollout of one period from any state, and the closed loop."""
    changes: dict[str, Any] = {}
    if not scene.scenario.phases:
        changes["simulation.duration"] = horizon.first_duration_s
    for robot, (key, _) in mpc_controllers(scene).items():
        changes[f"robots.{robot}.controllers.{key}.knots"] = horizon.knots(0.0, period, robot)
    flown = cached_closed_loop(build_scene(scene.scenario, changes, source=scene.source))
    simulation = scene.scenario.simulation
    rollout = build_rollout(
        resumed(flown),
        duration_s=period,
        step_s=simulation.step,
        output_step_s=simulation.output_step,
        tolerance=simulation.tolerance,
        method=simulation.method,
        backend=backend,  # type: ignore[arg-type]
    )
    return rollout, flown


def _result(flight: _MpcSimulation, began: float) -> Result:
    """Result of a flight that began at a time."""
    scene, loop, horizon = flight.scene, flight.loop, flight.horizon
    trajectory = joined(flight.pieces)
    whole = build_dataset(scene, trajectory, loop)
    total = time.perf_counter() - began
    timing = {"closed_loop": 0.0, "compile_or_load": 0.0, "rollout": trajectory.wall_s, "total": total}
    step_error = f"{trajectory.step_error:.1e}"
    notes: Mapping[str, str] = {"toolchain": flight.rollout.summary, "step_error": step_error}
    events = build_events(scene, loop, trajectory.events)
    summary = build_summary(scene, whole, trajectory, timing, notes, events)
    again, allowed = horizon.seconds[1:], flight.settings.delay or flight.settings.period
    summary["mpc"] = {
        "period_s": flight.settings.period,
        "delay_s": flight.settings.delay,
        "plans": len(horizon.seconds),
        "missed": horizon.missed,
        "unfinished": horizon.unfinished,
        "iterations": horizon.iterations,
        "first_solve_s": horizon.seconds[0],
        "median_solve_s": float(np.median(again or [0.0])),
        "longest_solve_s": max(again, default=0.0),
        "in_time": sum(seconds <= allowed for seconds in again),
    }
    return Result(scene.scenario, whole, summary)
