"""Numerical methods against classical Runge-Kutta at equal error: one rollout, a batch, a gradient."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from statistics import median

import casadi as ca
import numpy as np

from benchmarks.table_row import Row
from benchmarks.timing import cpu_time_of
from spacerobot.closedloop import ClosedLoop, build_closed_loop
from spacerobot.rollout import Measures, Rollout, Signals, build_rollout, integral, time_grid
from spacerobot.rollout.methods import DEFAULT, METHODS
from spacerobot.scene import load_scene

DURATION, SAMPLE = 10.0, 0.1
ERROR = 1e-7
"""Error of the states at the samples, relative to the larger of one unit and the state's largest value."""

FINE = 0.0015
"""Step of the reference rollout by `dop853` [s]."""

FASTER = 1.4
"""Required ratio of times for the default method."""

TURNS = 7
COUNT = 64
"""Number of rollouts in a batch."""

GAINS = tuple(
    f"robots.{robot}.tips.tip.{gain}"
    for robot in ("rpr1", "rpr2")
    for gain in ("pid.kp", "pid.ki", "pid.kd", "amnesia.ge", "amnesia.ta")
)
"""All gains of the paper's scenario."""


def paper_rollout(loop: ClosedLoop, method: str, step_s: float = SAMPLE, sample_s: float = SAMPLE) -> Rollout:
    """Rollout of the paper's scenario by a method, with one cost."""
    signals = Signals.of(loop)
    squared = {"squared": integral(ca.sumsqr(signals["tip_error"]))}
    measures = Measures(signals, squared, costs=lambda r, _: {"cost": r["squared"]})
    return build_rollout(
        loop, duration_s=DURATION, step_s=step_s, output_step_s=sample_s, method=method, measures=measures
    )


def longest(rollout: Rollout, exact: np.ndarray) -> tuple[Rollout, float]:
    """Rollout in the longest steps that divide a sample and keep to the error, and its error."""
    largest = np.maximum(1.0, np.abs(exact).max(axis=0))
    for pieces in range(1, 200):
        candidate = replace(rollout, grid=time_grid(DURATION, SAMPLE / pieces, SAMPLE))
        trajectory = candidate.run()
        if trajectory.status == "completed":
            error = float((np.abs(trajectory.state - exact) / largest).max())
            if error <= ERROR:
                return candidate, error
    raise RuntimeError(f"{rollout.kernel.method.name} does not reach an error of {ERROR:g}")


def rows() -> list[Row]:
    """One row for each method and job; ratios are medians over turns of all methods."""
    loop = build_closed_loop(load_scene("paper"))
    exact = paper_rollout(loop, "dop853", FINE).run().state
    longest_steps = {name: longest(paper_rollout(loop, name), exact) for name in METHODS}
    values = np.linspace(280, 320, COUNT)[:, None]
    jobs: dict[str, tuple[Callable[[Rollout], object], int]] = {
        "one rollout": (lambda rollout: rollout.run(), 1),
        "a rollout of a vectorised batch": (
            lambda rollout: rollout.batch(GAINS[:1], values, threads=1),
            COUNT,
        ),
        f"adjoint gradient, {len(GAINS)} gains": (
            lambda rollout: rollout.value_and_gradient(wrt=GAINS, accuracy=False),
            1,
        ),
    }
    texts = []
    for what, (job, calls) in jobs.items():
        # processor times [s] by each method, in turns, after a warm-up of each
        times: dict[str, list[float]] = {name: [] for name in longest_steps}
        for rollout, _ in longest_steps.values():
            job(rollout)
        for _ in range(TURNS):
            for name, (rollout, _) in longest_steps.items():
                times[name].append(cpu_time_of(lambda rollout=rollout, job=job: job(rollout)) / calls)
        for name in (name for name in METHODS if name != "rk4"):
            (rollout, error), pairs = longest_steps[name], zip(times[name], times["rk4"], strict=True)
            ratio = median(theirs / ours for ours, theirs in pairs)
            evaluations = rollout.grid.steps * rollout.kernel.method.stages
            target = ("stated", None) if name != DEFAULT else (f"{FASTER:g}x faster", ratio >= FASTER)
            step = f"steps of {rollout.grid.step_s * 1e3:.3g} ms"
            row = Row(
                f"{what}, `{name}` at a state error of {ERROR:g}",
                "`rk4` at the same error",
                *(f"{median(times[each]) * 1e3:.2f} ms" for each in (name, "rk4")),
                ratio,
                *target,
                f"{step}, {evaluations} evaluations, error {error:.0e}",
                {"error": error, "evaluations": evaluations},
            )
            texts.append(row)
    return texts
