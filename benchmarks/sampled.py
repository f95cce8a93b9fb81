"""Cost of controllers at 100 Hz and of sensor noise in the paper's scenario."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.table_row import Row, at_most
from benchmarks.timing import paired
from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import DivergedError
from spacerobot.rollout import Batch, Rollout, build_rollout
from spacerobot.scene import load_scene

Changes = dict[str, Any]
RATE_HZ, STEP, COUNT, MOST, MOST_OF_NOISE = 100, 0.005, 64, 1.5, 1.02
VARIED = ("robots.rpr1.tips.tip.pid.kp", "simulation.noise_draw")
GAINS = {"robots.rpr2.tips.tip.amnesia.ge": 500, "robots.rpr2.tips.tip.amnesia.ta": 3}
"""Gains of the first robot, since the second one's correction, of 25 Hz, is unstable if held for 10 ms."""


def rows() -> list[Row]:
    """Row of sampled against continuous controllers, and row with noise against one without."""
    period = {"period": 1 / RATE_HZ}
    sampled: Changes = {f"robots.{name}.tips.tip.pid.sampled": period for name in ("rpr1", "rpr2")}
    changes: Changes = {"robots.rpr1.sensors": {"joint_rate": {"errors": period}}}
    noisy: Changes = {"robots.rpr1.sensors": {"joint_rate": {"errors": period | {"noise": 1e-7}}}}
    note = f"tanaka6 at {STEP * 1e3:g} ms, one thread; correction of rpr2 as that of rpr1"
    what = f"the paper's scenario, controllers at {RATE_HZ} Hz"
    noise = f"{what} and joint rates with noise, a draw each", "the same without noise"
    return [
        _compared((what, "the same, continuous"), sampled, {}, note, MOST),
        _compared(noise, sampled | noisy, sampled | changes, note, MOST_OF_NOISE),
    ]


def _compared(names: tuple[str, str], first: Changes, second: Changes, note: str, most: float) -> Row:
    """Row of batches of two variants, whose gains and draws differ between rollouts."""
    rollouts = [_rollout(first), _rollout(second)]
    values = np.column_stack([np.linspace(280, 320, COUNT), np.arange(COUNT)])

    def batch(which: int) -> Batch:
        rollout = rollouts[which]
        paths = [path for path in VARIED if path in rollout.loop.parameter_paths]
        return rollout.batch(paths, values[:, : len(paths)], threads=1)

    batches = [batch(0), batch(1)]
    if any(np.isfinite(batch.diverged_at_s).any() for batch in batches):
        raise DivergedError("a sampled rollout of the paper's scenario is lost")
    times = paired(lambda: batch(0), lambda: batch(1))
    names = f"{names[0]}, in {batches[0].lanes} lanes", names[1]
    return at_most(most, names, times, note, count=COUNT)


def _rollout(changes: Changes) -> Rollout:
    loop = build_closed_loop(load_scene("paper", GAINS | changes))
    return build_rollout(loop, duration_s=10, step_s=STEP, output_step_s=0.02, many=True)
