"""Reaction wheels for the page: axes on their base, and rotation angles."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid

from spacerobot.result import Result
from viz.drawing.motion import BodyMotion
from viz.page.meshcat_scene import packed, rounded

FASTEST = 4.0
"""Angular velocity of the fastest wheel as drawn [rad/s]; faster rotation may look like standing still."""

NO_REACTION_WHEELS: dict[str, Any] = {"count": 0, "nodes": [], "axes": [], "angles": "", "slowed": 1.0}
"""Data of a scene without reaction wheels."""


def reaction_wheel_data(result: Result, motion: BodyMotion) -> dict[str, Any]:
    """Reaction wheels of a result: ``count``, and of each the ``nodes`` and ``axes`` (3,) of its base.

    ``angles`` are those relative to the base at the motion's rows, packed (nt, count) [rad], divided by
    ``slowed`` for all wheels alike.
    """
    data = result.data
    if "wheel" not in data.dims:  # an element of one's own may give speeds of other dimensions
        return NO_REACTION_WHEELS
    axes = {
        f"{robot}/{name}.{k}": axis
        for robot, section in result.scenario.robots.items()
        for name, actuator in section.actuators.items()
        if (storage := actuator.momentum_storage()) is not None
        for k, axis in enumerate(storage.axes.T)
    }
    columns = [k for k, label in enumerate(data.wheel.values) if str(label) in axes]
    labels = [str(data.wheel.values[k]) for k in columns]
    bases = {node.body: k for k, node in enumerate(motion.nodes) if node.is_base}
    speed = result.array("wheel_speed")[:, columns]
    slowed = max(1.0, float(np.abs(speed).max(initial=0.0)) / FASTEST)
    angles = cumulative_trapezoid(speed, result.array("time"), axis=0, initial=0)[motion.rows]
    return {
        "count": len(labels),
        "nodes": [bases[label.partition("/")[0]] for label in labels],
        "axes": [rounded(axes[label]) for label in labels],
        "angles": packed(angles / slowed),
        "slowed": slowed,
    }
