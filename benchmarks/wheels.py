"""Cost of four reaction wheels with attitude control, in one rollout and in a batch."""

from __future__ import annotations

import numpy as np

from benchmarks.table_row import Row, at_most
from benchmarks.timing import paired
from spacerobot.closedloop import build_closed_loop
from spacerobot.rollout import Rollout, build_rollout
from spacerobot.scene import load_scene

COUNT, MOST, STEP = 32, 1.2, 0.02
VARIED = "target.links.body.mass"
FREE = {"robots.servicer.actuators": {}, "robots.servicer.controllers": {}}


def rows() -> list[Row]:
    """Rows of the shipped servicer with wheels against the same servicer with a free-floating base."""
    held, free = (load_scene("servicer-wheels", changes) for changes in ({}, FREE))
    duration_s = held.scenario.simulation.duration

    def rollouts(*, many: bool) -> list[Rollout]:
        loops = (build_closed_loop(scene) for scene in (held, free))
        settings = {"duration_s": duration_s, "step_s": STEP, "output_step_s": duration_s / 50}
        return [build_rollout(loop, **settings, many=many) for loop in loops]

    table = []
    single, batch = rollouts(many=False), rollouts(many=True)
    mass = batch[0].values()[batch[0].indices([VARIED])[0]]
    values = mass * np.linspace(0.9, 1.1, COUNT)[:, None]
    for what, calls, jobs in (
        ("one rollout", 1, [rollout.run for rollout in single]),
        (f"a batch of {COUNT}", COUNT, [lambda r=r: r.batch((VARIED,), values, threads=1) for r in batch]),
    ):
        names = f"{what} of the servicer with four wheels and attitude control", "the same without"
        times = paired(jobs[0], jobs[1], calls=(calls, calls))
        note = f"tanaka6 at {STEP * 1e3:g} ms, one thread, {duration_s:g} s"
        table.append(at_most(MOST, names, times, note))
    return table
