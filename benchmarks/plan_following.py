"""Cost of following plans with few and many knots."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.table_row import Row, at_most
from benchmarks.timing import paired
from spacerobot.closedloop import ClosedLoop, build_closed_loop
from spacerobot.rollout import Rollout, build_rollout
from spacerobot.scene import load_scene

FEW, MANY = 16, 400
DURATION, STEP, POINTS, MOST = 10.0, 0.005, 4, 2.0
NODES = np.array([0, (1 - 5**-0.5) / 2, (1 + 5**-0.5) / 2])
SCENE, KEY = "examples/reach.yaml", "robots.arm.controllers"


def plan(intervals: int) -> dict[str, Any]:
    """Section of a controller that follows a plan with a number of intervals; each joint swings a little."""
    ends = np.linspace(0, DURATION, intervals + 1)
    times = np.append((ends[:-1, None] + DURATION / intervals * NODES).ravel(), DURATION)
    first, pace = np.radians(40) * np.repeat([1, -1], 4), 2 * np.pi / DURATION
    swing, rate = np.sin(pace * times)[:, None] ** 2, pace * np.sin(2 * pace * times)[:, None]
    shape = np.linspace(0.1, 0.2, 8)
    values = {"position": first + swing * shape, "rate": rate * shape, "effort": 0 * (swing + first)}
    rows = {key: value.tolist() for key, value in ({"times": times} | values).items()}
    joints = [f"joint_{k}" for k in range(1, 9)]
    knots = {**rows, "points": POINTS, "joints": joints}
    return {"kind": "joint_tracking", "kp": 20, "kd": 20, "knots": knots}


def loop(intervals: int) -> ClosedLoop:
    """Closed loop of the paper's arm, which follows a plan, or without a controller for zero intervals."""
    controllers = {"follow": plan(intervals)} if intervals else {}
    return build_closed_loop(load_scene(SCENE, {KEY: controllers, "plan": None}))


def rollout(closed: ClosedLoop) -> Rollout:
    """Rollout over the plan's duration."""
    return build_rollout(closed, duration_s=DURATION, step_s=STEP, output_step_s=DURATION / 10)


def rows() -> list[Row]:
    """Rows of a rollout that follows a plan, against one of the same arm without a controller."""
    loops = {count: loop(count) for count in (0, FEW, MANY)}
    rollouts = {count: rollout(each) for count, each in loops.items()}
    operations = {count: each.dynamics.n_instructions() for count, each in loops.items()}
    table = []
    for count in (FEW, MANY):
        times = paired(rollouts[count].run, rollouts[0].run)
        what = f"one rollout of the paper's arm following a plan of {count} intervals of {POINTS} points"
        both = [operations[count], operations[0]]
        note = f"{both[0]} operations and {both[1]}; {STEP * 1e3:g} ms steps"
        row = at_most(MOST, (what, "the same arm without a controller"), times, note)
        table.append(replace(row, numbers={"operations": both}))
    return table
