"""The paper's scenario with its controllers evaluated at 100 Hz, against the continuous one."""

from __future__ import annotations

import numpy as np

from benchmarks.table_row import Row
from benchmarks.timing import paired
from spacerobot.closedloop import build_closed_loop
from spacerobot.errors import DivergedError
from spacerobot.rollout import Rollout, build_rollout
from spacerobot.scene import load_scene

RATE_HZ, STEP, COUNT, MOST = 100, 0.005, 64, 1.5
VARIED = "robots.rpr1.tips.tip.pid.kp"
GAINS = {"robots.rpr2.tips.tip.amnesia.ge": 500, "robots.rpr2.tips.tip.amnesia.ta": 3}
"""Those of the first robot: the second one's correction, of 25 Hz, is unstable where it is held for 10 ms."""


def rows() -> list[Row]:
    """One row."""
    sampled, continuous = _rollout(True), _rollout(False)
    values = np.linspace(280, 320, COUNT)[:, None]
    batches = [rollout.batch((VARIED,), values, threads=1) for rollout in (sampled, continuous)]
    if any(np.isfinite(batch.diverged_at_s).any() for batch in batches):
        raise DivergedError("a sampled rollout of the paper's scenario is lost")
    times = paired(
        lambda: sampled.batch((VARIED,), values, threads=1),
        lambda: continuous.batch((VARIED,), values, threads=1),
        calls=(1, 1),
    )
    ratio = times.first_s / times.second_s
    return [
        Row(
            f"the paper's scenario, controllers at {RATE_HZ} Hz, in {batches[0].lanes} lanes",
            "the same, continuous",
            f"{times.first_s / COUNT * 1e3:.2f} ms",
            f"{times.second_s / COUNT * 1e3:.2f} ms",
            ratio,
            f"at most {MOST:g} times",
            ratio <= MOST,
            f"tanaka6 at {STEP * 1e3:g} ms, one thread; correction of rpr2 as that of rpr1",
        )
    ]


def _rollout(sampled: bool) -> Rollout:
    own = {f"robots.{name}.tips.tip.pid.sampled": {"period": 1 / RATE_HZ} for name in ("rpr1", "rpr2")}
    loop = build_closed_loop(load_scene("paper", GAINS | (own if sampled else {})))
    return build_rollout(loop, duration_s=10, step_s=STEP, output_step_s=0.02, many=True)
