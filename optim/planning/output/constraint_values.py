"""Constraints along a trajectory: limits of joints, and the value of each constraint over time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
import xarray as xr

from optim.planning.formulation.formulate import formulate_phases
from optim.planning.formulation.rows import row_values
from optim.planning.transcription.collocation_program import first_constrained
from optim.planning.transcription.motion import PhasedMotion
from spacerobot.arrays import Array
from spacerobot.elements.plan_instant import BoundedRow
from spacerobot.scene import Scene

SIDES = ["lower", "upper"]


def constraint_variables(
    phased_motion: PhasedMotion, names: Sequence[str]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Variables and coordinates of a dataset: limits of joints, constraints over time and their limits.

    Where a plan has several phases, a constraint carries its phase's name, and has no numbers in others.
    """
    stage = phased_motion.motions[0].problem.stage
    model, driven = stage.scene.model, stage.driven
    first = model.nq + 2 * model.nv
    positions = [model.joints[joint].idx_q if model.joints[joint].nq == 1 else -1 for joint in driven.joints]
    places = {
        "joint_position": positions,
        "joint_rate": [model.nq + model.joints[joint].idx_v for joint in driven.joints],
        "torque": list(range(first, first + len(driven.joints))),
    }
    variables: dict[str, Any] = {
        f"{name}_limit": (("joint", "side"), _limits(phased_motion, own), {"long_name": f"limits of {name}"})
        for name, own in places.items()
    }
    coordinates: dict[str, Any] = {"side": SIDES}
    # axes of bases that are driven in any phase, and the greatest force or torque of each [N, N m].
    drives: dict[str, float] = {}
    for driven in (motion.problem.stage.driven for motion in phased_motion.motions):
        for name, limit in zip(driven.names, driven.limits, strict=True):
            if name not in driven.names[: len(driven.joints)]:
                drives[name] = max(drives.get(name, 0.0), float(limit))
    if drives:
        variables["base_wrench_limit"] = (
            ("drive", "side"),
            np.array([(-most, most) for most in drives.values()]),
            {"long_name": "limits of what drives bases"},
        )
    several = len(set(names)) > 1
    found = list[_ConstraintValues]()
    for k, name in enumerate(names):
        for one in _constraints(phased_motion, k, name if several else ""):
            known = [i for i, other in enumerate(found) if other.name == one.name]
            if known:  # of another segment of the same phase
                found[known[0]] = replace(found[known[0]], values=np.fmax(found[known[0]].values, one.values))
            else:
                found.append(one)
    if found:
        variables |= {
            "constraint": (("time", "constraint_name"), np.array([one.values for one in found]).T),
            "constraint_limit": (("constraint_name", "side"), np.array([one.limits for one in found])),
            "constraint_begin": ("constraint_name", np.array([one.begin for one in found]), {"units": "s"}),
        }
        coordinates |= {
            "constraint_name": [one.name for one in found],
            "constraint_unit": ("constraint_name", [one.unit for one in found]),
        }
    return variables, coordinates


@dataclass(frozen=True, eq=False)
class _ConstraintValues:
    """One constraint over all points, its limits, and when it begins to hold [s]."""

    name: str
    unit: str
    values: Array
    limits: Array
    begin: float


def _constraints(phased_motion: PhasedMotion, k: int, phase: str) -> Iterator[_ConstraintValues]:
    """Those of one phase."""
    motion, points = phased_motion.motions[k], [len(m.time) for m in phased_motion.motions]
    rows = [row for row in motion.problem.path if row.lower < row.upper]  # equations hold nothing back
    if not rows:
        return
    values = row_values(rows, motion.problem.stage.z, motion.z.T)
    for row, own in zip(rows, values, strict=True):
        told, limits = _told(row, own)
        over = np.full(sum(points), np.nan)
        over[sum(points[:k]) : sum(points[: k + 1])] = told
        share = first_constrained(motion.lobatto, motion.mesh, row.final_fraction)
        begin = phased_motion.begins[k] + share * motion.duration_s
        name = f"{phase}: {row.name}" if phase else row.name
        yield _ConstraintValues(name, row.unit, over, limits, begin)


def _limits(phased_motion: PhasedMotion, places: list[int]) -> Array:
    """Least and greatest of entries of an instant in any phase (n, 2); open where there is no entry."""
    problems = [motion.problem for motion in phased_motion.motions]
    lower = np.array([np.append(problem.lower, -np.inf)[places] for problem in problems])
    upper = np.array([np.append(problem.upper, np.inf)[places] for problem in problems])
    return np.stack([lower.min(axis=0), upper.max(axis=0)], axis=1)


def _told(row: BoundedRow, values: Array) -> tuple[Array, Array]:
    """Values and limits (2,) in the row's unit; a square becomes a size again, a cosine an angle."""
    if row.form == "square":
        limit = 2 * row.scale
        return limit * np.sqrt(np.maximum(values, 0.0)), np.array([-np.inf, limit])
    if row.form == "cosine":
        return np.arccos(np.clip(values, -1.0, 1.0)), np.array([-np.inf, np.arccos(row.lower)])
    return values, np.array([row.lower, row.upper])


def with_flown(plan: xr.Dataset, scene: Scene, flown: xr.Dataset) -> xr.Dataset:
    """A plan's dataset with the values that its constraints had when it was flown.

    Parameters
    ----------
    plan
        What stands in ``plan.nc``.
    scene
        With its plan section.
    flown
        A result's data, of the same bodies.

    Returns
    -------
    xarray.Dataset
        With ``constraint_flown`` (flown_time, constraint_name); no numbers where a constraint is of what
        drives the motion, or of another phase.
    """
    phases = formulate_phases(scene)
    names, times = [str(name) for name in plan.constraint_name.values], flown.time.values
    found = np.full((len(times), len(names)), np.nan)
    for phase in phases:
        own = plan.time.values if len(phases) == 1 else plan.time.values[plan.phase.values == phase.name]
        inside = (times >= own[0]) & (times <= own[-1])
        stage = phase.problem.stage
        state, later = ca.vertcat(stage.q, stage.v), ca.vertcat(stage.a, stage.u, stage.w, stage.s)
        at = np.hstack([flown.q.values[inside], flown.v.values[inside]]).T
        for row in phase.problem.path:
            name = f"{phase.name}: {row.name}" if len(phases) > 1 else row.name
            if name in names and not ca.depends_on(row.value, later):
                found[inside, names.index(name)] = _told(row, row_values([row], state, at)[0])[0]
    data = {"constraint_flown": (("flown_time", "constraint_name"), found)}
    return plan.assign(data).assign_coords(flown_time=times)
