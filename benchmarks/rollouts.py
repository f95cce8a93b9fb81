"""One rollout against a plain Python loop; batches and gradients against one rollout; the paper's GA."""

from __future__ import annotations

import functools

import numpy as np

from benchmarks.methods import DURATION, GAINS, paper_rollout
from benchmarks.plain_loop import PlainLoop
from benchmarks.table_row import Row
from benchmarks.timing import cpu_time_of, paired
from spacerobot.closedloop import ClosedLoop, build_closed_loop
from spacerobot.rollout import Rollout
from spacerobot.rollout.methods import DEFAULT
from spacerobot.scene import Scene, load_scene

FINE = 0.00025
ACCURATE = DURATION / 3000
"""Step of RK4 at which the state errors of both rollouts are below 1e-6 [s]."""

TUNING = 0.01
"""Step of the default method at which batches and gradients are compared with a single rollout [s]."""

GA_ROLLOUTS = 50 * 150
BATCH_TARGET = {8: 8.0, 4: 4.0}


@functools.cache
def _scene_and_loop() -> tuple[Scene, ClosedLoop]:
    scene = load_scene("paper")
    return scene, build_closed_loop(scene)


def _rollout(step: float, method: str = DEFAULT) -> Rollout:
    return paper_rollout(_scene_and_loop()[1], method, step)


def single() -> Row:
    """Row of one compiled rollout against the same closed loop in a plain Python loop with the same step."""
    scene, loop = _scene_and_loop()
    rollout, plain = _rollout(ACCURATE, "rk4"), PlainLoop(scene)
    size = loop.nq + loop.nv
    exact = _rollout(FINE, "rk4").run().state[-1][:size]
    errors = [
        float(np.abs(final - exact).max())
        for final in (rollout.run().state[-1][:size], plain.run(DURATION, ACCURATE)[:size])
    ]
    times = paired(rollout.run, lambda: plain.run(DURATION, ACCURATE), turns=3)
    return Row(
        "one rollout of the paper's scenario, compiled",
        "plain Python loop over pin.aba",
        f"{times.first_s * 1e3:.1f} ms",
        f"{times.second_s * 1e3:.0f} ms",
        times.ratio,
        "150x faster",
        times.ratio >= 150 and max(errors) <= 1e-6,
        f"RK4 at {ACCURATE * 1e3:.2f} ms; state errors {errors[0]:.0e} and {errors[1]:.0e}",
        {"state_errors": errors},
    )


def batch() -> list[Row]:
    """Rows of a batch in lanes on one core against one rollout, and of the paper's GA budget on all cores."""
    rollout = _rollout(TUNING)
    count = 64
    values = np.linspace(280, 320, count)[:, None]
    times = paired(
        rollout.run,
        lambda: rollout.batch(GAINS[:1], values, threads=1),
        calls=(1, count),
    )
    lanes, gain = rollout.engines.batch.lanes, 1 / times.ratio
    target = BATCH_TARGET.get(lanes, 1.5)
    many = np.linspace(280, 320, 512)[:, None]
    threads = rollout.batch(GAINS[:1], many).threads
    per_core = len(many) / cpu_time_of(lambda: rollout.batch(GAINS[:1], many))
    return [
        Row(
            f"batch in {lanes} lanes, a rollout and core",
            "one compiled rollout",
            f"{times.second_s * 1e3:.2f} ms",
            f"{times.first_s * 1e3:.1f} ms",
            gain,
            f"{target:g}x faster",
            gain >= target,
            f"{DEFAULT} at {TUNING * 1e3:g} ms, one thread",
        ),
        Row(
            "the paper's GA budget, 50 x 150 rollouts of 10 s",
            "",
            f"{GA_ROLLOUTS / (per_core * threads):.1f} s",
            note=f"{per_core:.0f} rollouts a second and core, {threads} cores",
            numbers={"rollouts_per_second_and_core": per_core},
        ),
    ]


def gradient() -> list[Row]:
    """Row of the exact adjoint gradient with respect to all gains against one rollout."""
    rollout = _rollout(TUNING)
    times = paired(rollout.run, lambda: rollout.value_and_gradient(wrt=GAINS, accuracy=False))
    count = 16
    values = np.tile([rollout.values()[i] for i in rollout.indices(GAINS)], (count, 1))
    many = paired(
        rollout.run,
        lambda: rollout.gradient_batch(GAINS, values, threads=1, accuracy=False),
        calls=(1, count),
    )
    return [
        Row(
            f"adjoint gradient, {len(GAINS)} gains",
            "one compiled rollout",
            f"{times.second_s * 1e3:.1f} ms",
            f"{times.first_s * 1e3:.1f} ms",
            times.ratio,
            "at most 4 rollouts",
            times.ratio <= 4,
            f"{count} batched gradients: {many.ratio:.2f} rollouts each",
            {"batched_gradient_s": many.second_s, "batched_ratio": many.ratio},
        )
    ]


def limited() -> Row:
    """Row of a batch with torque limits at all joints, at which steps end, against one without limits."""
    limits = {f"robots.{robot}.torque_limits": True for robot in ("rpr1", "rpr2")}
    free, bounded = (
        _rollout(TUNING),
        paper_rollout(build_closed_loop(load_scene("paper", limits)), DEFAULT, TUNING),
    )
    values = np.linspace(280, 320, 64)[:, None]
    one = paired(free.run, bounded.run)
    many = paired(
        *(lambda rollout=each: rollout.batch(GAINS[:1], values, threads=1) for each in (free, bounded))
    )
    return Row(
        "torque limits at 16 joints, a batch",
        "the same without limits",
        f"{many.second_s / len(values) * 1e3:.2f} ms",
        f"{many.first_s / len(values) * 1e3:.2f} ms",
        many.ratio,
        "at most 1.6 times",
        many.ratio <= 1.6,
        f"one rollout: {one.ratio:.2f} times",
        {"one_rollout_ratio": one.ratio},
    )
