"""Throughput of many simulations against ``mujoco.rollout`` at a smaller or equal error."""

from __future__ import annotations

import importlib.util

from benchmarks.peers.scenes import mujoco_rollout
from benchmarks.table_row import Row

AT_LEAST = 3.0


def row() -> Row:
    """Row of processor times for the same simulated time; the smallest ratio of MuJoCo's integrators."""
    here = f"{mujoco_rollout.COUNT} simulations of mjorbit's capture arm", "mujoco.rollout, the same threads"
    if importlib.util.find_spec("mujoco") is None:
        return Row(*here, "", note="not measured: `pip install mujoco`")
    outcome = mujoco_rollout.measure()
    ratio = outcome.theirs_s / outcome.ours_s
    return Row(
        *here,
        outcome.ours,
        outcome.theirs,
        ratio,
        f"at least {AT_LEAST:g} times at no greater error",
        ratio >= AT_LEAST,
        f"errors of final states {outcome.error}; {mujoco_rollout.NOTE}",
        outcome.numbers,
    )
