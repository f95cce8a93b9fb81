"""A receding horizon: in each period the plan is made anew from what is sensed, for the time that is left."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from optim.planning.bench import Bench
from optim.planning.guess import guess
from optim.planning.make import fault_of
from optim.planning.motion import Motion
from optim.planning.program import Program
from optim.planning.replay import joint_angle
from optim.planning.search import search
from optim.planning.sensed import sensed
from optim.planning.solve import Solved, solve
from spacerobot.arrays import Array
from spacerobot.elements.controllers.mpc import Mpc
from spacerobot.errors import NoPlanError, ScenarioError
from spacerobot.kept import kept_closed_loop
from spacerobot.result import Result
from spacerobot.result.dataset import build_dataset
from spacerobot.result.events import build_events
from spacerobot.result.summary import build_summary
from spacerobot.rollout import Rollout, Trajectory, build_rollout
from spacerobot.rollout.resumed import end_of, joined, resumed, start_of
from spacerobot.scene import Scene, build_scene

Progress = Callable[[str], None]
ROUNDING = 1e-9
"""Of times, in parts of a period."""


def controllers_of(scene: Scene) -> dict[str, tuple[str, Mpc]]:
    """Key and section of each robot's controller of kind ``mpc``, by robot."""
    return {
        body: (key, controller)
        for body, robot in scene.scenario.robots.items()
        for key, controller in robot.controllers.items()
        if isinstance(controller, Mpc)
    }


@dataclass
class _Horizon:
    """The plan that is flown now, and what was done for all of them.

    Attributes
    ----------
    bench
        The problem.
    motion, solved, since
        The plan, its solution, and when it began [s].
    iterations, seconds, missed
        Of each solve, and how many led to no plan.
    """

    bench: Bench
    motion: Motion
    solved: Solved
    since: float = 0.0
    iterations: list[int] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    missed: int = 0

    def renew(self, now: float, seen: Array) -> None:
        """Plan anew for the time that is left, from the last plan; where that fails, from nothing."""
        begin = time.perf_counter()
        left = self.motion.duration_s - (now - self.since)
        problem = dataclasses.replace(self.bench.problem, fixed=seen, duration=(left,) * 3)
        program = Program(problem, self.bench.instants, self.bench.lobatto, self.motion.intervals)
        found = solve(program, self._ahead(now, problem), self.solved)
        iterations = found.iterations
        if not found.converged:
            fresh = guess(problem, self.bench.lobatto, self.motion.intervals).unknowns
            found = solve(program, fresh, scale=self.solved.scale)
            iterations += found.iterations
        if found.converged:
            z, duration = program.split(found.w)
            self.motion = Motion(problem, self.bench.lobatto, self.motion.intervals, duration, z)
            self.solved, self.since = found, now
        else:
            self.missed += 1
        self.iterations.append(iterations)
        self.seconds.append(time.perf_counter() - begin)

    def _ahead(self, now: float, problem: Any) -> Array:
        """Unknowns of what is left of the last plan."""
        lobatto, before = self.bench.lobatto, self.motion
        gone = (now - self.since) / before.duration_s
        parts = gone + lobatto.times(before.intervals, 1.0) * (1 - gone)
        z = before.along(np.minimum(parts, 1.0))
        z[0, : problem.fixed.size] = problem.fixed
        return np.append(z.ravel(), problem.duration[0])

    def knots(self, now: float, period: float, robot: str) -> dict[str, Any]:
        """What a robot's joints do in the period from now on, at the points of one interval."""
        problem = self.motion.problem
        model, driven = problem.stage.scene.model, problem.stage.driven
        times = self.bench.lobatto.nodes * period
        z = self.motion.along(np.minimum((now - self.since + times) / self.motion.duration_s, 1.0))
        q, v, _, u, *_ = self.motion.parts(z)
        own = [k for k, name in enumerate(driven.names) if name.startswith(f"{robot}/")]
        own = [k for k in own if k < len(driven.joints)]
        joints = [model.joints[driven.joints[k]] for k in own]
        angles = np.array([[joint_angle(joint, row) for joint in joints] for row in q])
        return {
            "times": times.tolist(),
            "points": len(times),
            "joints": [driven.names[k].partition("/")[2] for k in own],
            "position": np.unwrap(angles, axis=0).tolist(),
            "rate": v[:, [driven.columns[k] for k in own]].tolist(),
            "effort": u[:, own].tolist(),
        }


def fly(scene: Scene, *, backend: str = "auto", progress: Progress | None = None) -> Result:
    """Simulate a scene whose robots plan anew in each period.

    Parameters
    ----------
    scene
        With a ``plan`` section, and a controller of kind ``mpc`` for each robot.
    backend
        ``auto``, ``compiled`` or ``interpreted``.
    progress
        Told in a few words what begins.

    Returns
    -------
    Result
        Until the plan's end; its summary has ``mpc``: what planning took against the period. That alone
        depends on the machine.

    Raises
    ------
    ScenarioError
        If the scene has no such controllers, or the plan's duration does not fit their period.
    NoPlanError
        If no first plan is found.
    """
    began, tell = time.perf_counter(), progress or (lambda _: None)
    period, least = _period(scene)
    bench = Bench.of(scene, backend, tell, motions=8)
    horizon = _first(bench, sensed(scene, bench.plan, np.concatenate([scene.q, scene.v])))
    duration = bench.problem.duration[0]
    tell("building the closed loop")
    rollout, flown = _rollout(scene, horizon, period, backend)
    pieces: list[tuple[float, Trajectory]] = []
    start = start_of(flown)
    for k in range(round(duration / period)):
        now = k * period
        tell(f"flying: {now:.3g} of {duration:.3g} s, {len(horizon.seconds)} plans")
        if k and duration - now > least - ROUNDING * period:
            horizon.renew(now, sensed(scene, bench.plan, start[1:]))
        p = np.concatenate([_numbers(flown, scene, horizon, now, period), start])
        piece = rollout.run(p, estimate=True)
        pieces.append((now, piece))
        if piece.status != "completed" or piece.ended_at_s is not None:
            break
        start = end_of(piece, start, flown.nx)
    return _result(scene, flown, rollout, pieces, (began, period, horizon))


def _first(bench: Bench, seen: Array) -> _Horizon:
    """The first plan, from a first guess."""
    first = dataclasses.replace(bench, problem=dataclasses.replace(bench.problem, fixed=seen))
    ask = first.asked(refine=False)
    found = search(first, ask)
    if found.solved is None:
        raise NoPlanError(str(fault_of(found)), source=bench.scene.source, where="plan")
    return _Horizon(
        bench,
        first.motion(ask, found),
        found.solved,
        iterations=[one.iterations for one in found.solves],
        seconds=[one.seconds for one in found.solves],
    )


def _period(scene: Scene) -> tuple[float, float]:
    """Period, and time left from which on the last plan is kept [s].

    Raises
    ------
    ScenarioError
        If robots differ in them, one has none, or the plan's duration is not so many periods.
    """
    source, given = scene.source, controllers_of(scene)
    if scene.scenario.phases:
        raise ScenarioError("found phases, allowed with kind mpc: none", source=source, where="phases")
    for body in scene.robots:
        if body.name not in given:
            raise ScenarioError(
                "has no controller of kind mpc; a plan moves the joints of all robots",
                source=source,
                where=f"robots.{body.name}.controllers",
            )
    numbers = {(controller.period, controller.least) for _, controller in given.values()}
    if len(numbers) > 1:
        raise ScenarioError(
            "controllers of kind mpc have different periods, allowed: one", source=source, where="robots"
        )
    (period, least), plan = numbers.pop(), scene.scenario.plan
    if plan is not None and plan.start:
        raise ScenarioError(
            "found a free start, allowed with kind mpc: none", source=source, where="plan.start"
        )
    if plan is not None:
        count = plan.duration.upper / period
        if plan.duration.lower != plan.duration.upper or abs(count - round(count)) > ROUNDING * count:
            raise ScenarioError(
                f"found {plan.duration.lower:g} to {plan.duration.upper:g} s, allowed with kind mpc: "
                f"one number, so many periods of {period:g} s",
                source=source,
                where="plan.duration",
            )
    for body in scene.robots:
        for signal, sensor in body.config.sensors:  # type: ignore[union-attr]
            if sensor.holds and abs(period / sensor.period - round(period / sensor.period)) > ROUNDING:
                raise ScenarioError(
                    f"found {sensor.period:g} s, allowed with kind mpc: a part of {period:g} s",
                    source=source,
                    where=f"robots.{body.name}.sensors.{signal}.period",
                )
    return period, least


def _rollout(scene: Scene, horizon: _Horizon, period: float, backend: str) -> tuple[Rollout, Any]:
    """What rolls out one period from anywhere, and the closed loop."""
    changes: dict[str, Any] = {"simulation.duration": horizon.motion.duration_s}
    for robot, (key, _) in controllers_of(scene).items():
        changes[f"robots.{robot}.controllers.{key}.knots"] = horizon.knots(0.0, period, robot)
    flown = kept_closed_loop(build_scene(scene.scenario, changes, source=scene.source))
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


def _numbers(loop: Any, scene: Scene, horizon: _Horizon, now: float, period: float) -> Array:
    """Parameters of the closed loop in the period that begins now."""
    place = {path: i for i, path in enumerate(loop.parameter_paths)}
    p = np.array(loop.parameter_values, dtype=float)
    for robot, (key, _) in controllers_of(scene).items():
        path, knots = f"robots.{robot}.controllers.{key}", horizon.knots(now, period, robot)
        p[place[f"{path}.begin"]] = now
        for name in ("position", "rate", "effort"):
            for k, row in enumerate(knots[name]):
                for j, value in enumerate(row):
                    p[place[f"{path}.knots.{name}.{k}.{j}"]] = value
    return p


def _result(
    scene: Scene,
    loop: Any,
    rollout: Rollout,
    pieces: list[tuple[float, Trajectory]],
    told: tuple[float, float, _Horizon],
) -> Result:
    began, period, horizon = told
    trajectory = joined(pieces)
    whole = build_dataset(scene, trajectory, loop)
    total = time.perf_counter() - began
    timing = {"closed_loop": 0.0, "compile_or_load": 0.0, "rollout": trajectory.wall_s, "total": total}
    notes: Mapping[str, str] = {"toolchain": rollout.summary, "step_error": f"{trajectory.step_error:.1e}"}
    events = build_events(scene, loop, trajectory.events)
    summary = build_summary(scene, whole, trajectory, timing, notes, events)
    again = horizon.seconds[1:]
    summary["mpc"] = {
        "period_s": period,
        "plans": len(horizon.seconds),
        "missed": horizon.missed,
        "iterations": horizon.iterations,
        "first_solve_s": horizon.seconds[0],
        "mean_solve_s": float(np.mean(again or [0.0])),
        "longest_solve_s": max(again, default=0.0),
        "in_time": sum(seconds <= period for seconds in again),
    }
    return Result(scene.scenario, whole, summary)
