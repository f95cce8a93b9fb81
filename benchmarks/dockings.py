"""Plans of ``docking`` after small random changes: number of successes, and processor time.

``python -m benchmarks dockings`` makes twenty plans in one process.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Mapping

import numpy as np

from benchmarks.table_row import Row
from optim.planning.search.make_plan import make_plan
from spacerobot.common.errors import SpaceRobotError
from spacerobot.scene import load_scene

DRAWS, SEED, TARGET_S = 20, 0, 5.0


def changes(rng: np.random.Generator) -> Mapping[str, float]:
    """Uniform changes of the object's pose, motion and mass: up to 50 mm, 5 deg, 2 mm/s, 0.5 deg/s, 20 %."""
    u = rng.uniform(-1, 1, 7)
    return {
        "target.base.position.0": 0.88 + 0.05 * u[0],
        "target.base.position.1": 1.84 + 0.05 * u[1],
        "target.base.rotation_deg.2": 5 * u[2],
        "target.base.velocity.0": 0.002 + 0.002 * u[3],
        "target.base.velocity.1": 0.003 + 0.002 * u[4],
        "target.base.spin_deg.2": 0.5 + 0.5 * u[5],
        "target.links.body.mass": 20 * (1 + 0.2 * u[6]),
    }


def rows() -> list[Row]:
    """One row: median processor time of a plan, including the scene and the verification."""
    rng = np.random.default_rng(SEED)
    times, intervals, iterations, faults = list[float](), list[int](), list[int](), list[str]()
    for _ in range(DRAWS):
        designs, begin = changes(rng), time.process_time()
        try:
            plan = make_plan(load_scene("docking", designs))
        except SpaceRobotError as fault:
            faults.append(str(fault))
        else:
            intervals.append(plan.motion.intervals)
            iterations.append(sum(one.iterations for one in plan.runs))
        times.append(time.process_time() - begin)
    median, count = statistics.median(times), DRAWS - len(faults)
    median_iterations = statistics.median(iterations or [0])
    return [
        Row(
            f"`docking` planned after small changes of pose, motion and mass, {DRAWS} draws",
            "",
            f"{count} of {DRAWS}, {median:.2g} s of processor time each (at most {max(times):.3g} s)",
            target=f"all, at most {TARGET_S:g} s",
            met=not faults and median <= TARGET_S,
            note=f"up to {max(intervals, default=0)} intervals; {median_iterations:g} iterations",
            numbers={"seconds": times, "iterations": iterations, "intervals": intervals, "faults": faults},
        )
    ]
