"""What holds along a planned motion: limits of joints, and each constraint over time."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from optim.planning.motion import Motion
from optim.planning.program import first_held
from spacerobot.arrays import Array
from spacerobot.elements.instant import Row

SIDES = ["lower", "upper"]


def held_variables(motion: Motion) -> tuple[dict[str, Any], dict[str, Any]]:
    """Variables and coordinates of a dataset: limits of joints, constraints over time and their limits."""
    problem = motion.problem
    model, driven = problem.stage.scene.model, problem.stage.driven
    first = model.nq + 2 * model.nv
    positions = [model.joints[joint].idx_q if model.joints[joint].nq == 1 else -1 for joint in driven.joints]
    places = {
        "joint_position": positions,
        "joint_rate": [model.nq + model.joints[joint].idx_v for joint in driven.joints],
        "torque": list(range(first, first + len(driven.joints))),
    }
    variables: dict[str, Any] = {
        f"{name}_limit": (("joint", "side"), _limits(motion, own), {"long_name": f"limits of {name}"})
        for name, own in places.items()
    }
    coordinates: dict[str, Any] = {"side": SIDES}
    if problem.path:
        rows = ca.densify(ca.vertcat(*(row.value for row in problem.path)))
        values = np.array(ca.Function("path", [problem.stage.z], [rows])(motion.z.T).full())
        told = [_told(row, value) for row, value in zip(problem.path, values, strict=True)]
        begin = [first_held(motion.lobatto, motion.intervals, row.last) for row in problem.path]
        variables |= {
            "constraint": (("time", "constraint_name"), np.array([one[0] for one in told]).T),
            "constraint_limit": (("constraint_name", "side"), np.array([one[1] for one in told])),
            "constraint_begin": ("constraint_name", np.array(begin) * motion.duration_s, {"units": "s"}),
        }
        coordinates |= {
            "constraint_name": [row.name for row in problem.path],
            "constraint_unit": ("constraint_name", [row.unit for row in problem.path]),
        }
    return variables, coordinates


def _limits(motion: Motion, places: list[int]) -> Array:
    """Least and greatest of entries of an instant (n, 2); open where there is no entry."""
    lower, upper = np.append(motion.problem.lower, -np.inf), np.append(motion.problem.upper, np.inf)
    return np.stack([lower[places], upper[places]], axis=1)


def _told(row: Row, values: Array) -> tuple[Array, Array]:
    """Values and limits (2,) in the row's unit; a square over its limit's square becomes a size again."""
    limits = np.array([row.lower, row.upper])
    if row.scale == 1.0:
        return values, limits
    limit = 2 * row.scale
    return limit * np.sqrt(np.maximum(values, 0.0)), np.array([-np.inf, limit])
