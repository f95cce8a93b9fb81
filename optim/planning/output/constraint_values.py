"""Constraints along a trajectory: limits of joints, values over time, multipliers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
import xarray as xr

from optim.planning.formulation.formulate import formulate_phases
from optim.planning.formulation.rows import row_values
from optim.planning.search.make_plan import PlanSolution
from optim.planning.transcription.collocation_program import first_constrained
from optim.planning.transcription.motion import PhasedMotion
from spacerobot.common.arrays import Array
from spacerobot.elements.goals.plan_instant import BoundedRow
from spacerobot.scene import Scene

SIDES = ["lower", "upper"]


def constraint_variables(
    phased_motion: PhasedMotion, names: Sequence[str]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Variables and coordinates of a dataset: limits of joints, constraints over time and their limits.

    In a plan with several phases a constraint's name includes its phase; its values are NaN in other phases.
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
        f"{name}_limit": (
            ("joint", "side"),
            _limits(phased_motion, indices),
            {"long_name": f"limits of {name}"},
        )
        for name, indices in places.items()
    }
    coordinates: dict[str, Any] = {"side": SIDES}
    # Axes of bases that are driven in any phase, and the largest force or torque of each [N, N m].
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
    # For each constraint, by name: values at all points, unit, limits, and time from which it holds [s].
    values, notes = dict[str, Array](), dict[str, tuple[str, Array, float]]()
    points = [len(motion.time) for motion in phased_motion.motions]
    for k, (phase, motion) in enumerate(zip(names, phased_motion.motions, strict=True)):
        rows = [row for row in motion.problem.path if row.lower < row.upper]  # equations hold nothing back
        values_of_rows = row_values(rows, motion.problem.stage.z, motion.z.T) if rows else ()
        for row, of_row in zip(rows, values_of_rows, strict=True):
            name = f"{phase}: {row.name}" if several else row.name
            physical_values, limits = _in_physical_units(row, of_row)
            over = np.full(sum(points), np.nan)
            over[sum(points[:k]) : sum(points[: k + 1])] = physical_values
            share = first_constrained(motion.lobatto, motion.mesh, row.final_fraction)
            notes.setdefault(name, (row.unit, limits, phased_motion.begins[k] + share * motion.duration_s))
            # another segment of the same phase has the same constraints
            values[name] = np.fmax(values[name], over) if name in values else over
    if values:
        units, limits_of, begins = zip(*notes.values(), strict=True)
        variables |= {
            "constraint": (("time", "constraint_name"), np.array([*values.values()]).T),
            "constraint_limit": (("constraint_name", "side"), np.array(limits_of)),
            "constraint_begin": ("constraint_name", np.array(begins), {"units": "s"}),
        }
        coordinates |= {"constraint_name": [*values], "constraint_unit": ("constraint_name", [*units])}
    return variables, coordinates


def _limits(phased_motion: PhasedMotion, places: list[int]) -> Array:
    """Lower and upper limits of an instant's entries over all phases (n, 2); infinite for missing entries."""
    problems = [motion.problem for motion in phased_motion.motions]
    lower = np.array([np.append(problem.lower, -np.inf)[places] for problem in problems])
    upper = np.array([np.append(problem.upper, np.inf)[places] for problem in problems])
    return np.stack([lower.min(axis=0), upper.max(axis=0)], axis=1)


def _in_physical_units(row: BoundedRow, values: Array) -> tuple[Array, Array]:
    """Values and limits (2,) in the reported unit: the root of a square, the angle of a cosine."""
    if row.form == "square":
        limit = 2 * row.scale
        return limit * np.sqrt(np.maximum(values, 0.0)), np.array([-np.inf, limit])
    if row.form == "cosine":
        return np.arccos(np.clip(values, -1.0, 1.0)), np.array([-np.inf, np.arccos(row.lower)])
    return values, np.array([row.lower, row.upper])


def with_flown(plan: xr.Dataset, scene: Scene, replay: xr.Dataset) -> xr.Dataset:
    """Plan's dataset with the values of its constraints along the simulated motion.

    Args:
        plan: Dataset of ``plan.nc``.
        scene: Scene with its plan section.
        replay: Data of a simulation result with the same bodies.

    Returns:
        xarray.Dataset: Dataset with ``constraint_flown`` (flown_time, constraint_name); NaN for constraints
            on accelerations, drives or grasp wrenches, and outside a constraint's phase.
    """
    phases = formulate_phases(scene)
    names, times = [str(name) for name in plan.constraint_name.values], replay.time.values
    flown_values = np.full((len(times), len(names)), np.nan)
    for phase in phases:
        phase_times = (
            plan.time.values if len(phases) == 1 else plan.time.values[plan.phase.values == phase.name]
        )
        inside = (times >= phase_times[0]) & (times <= phase_times[-1])
        stage = phase.problem.stage
        state, later = ca.vertcat(stage.q, stage.v), ca.vertcat(stage.a, stage.u, stage.w, stage.s)
        at = np.hstack([replay.q.values[inside], replay.v.values[inside]]).T
        for row in phase.problem.path:
            name = f"{phase.name}: {row.name}" if len(phases) > 1 else row.name
            if name in names and not ca.depends_on(row.value, later):
                flown_values[inside, names.index(name)] = _in_physical_units(
                    row, row_values([row], state, at)[0]
                )[0]
    data = {"constraint_flown": (("flown_time", "constraint_name"), flown_values)}
    return plan.assign(data).assign_coords(flown_time=times)


def multiplier_norms(planned: PlanSolution) -> Array:
    """Norms of the multipliers at all points of a plan's phases, one after the other (points,).

    The norm includes the equations of motion and all limits at a point, not collocation and goals.
    Multipliers are converted to densities over time, which do not depend on the mesh: the cost saved per unit
    of relaxation of a constraint and per second.

    Args:
        planned: The plan.
    """
    solution = planned.solution
    norms, row, unknown = [], 0, 0
    for motion in planned.phased_motion.motions:
        problem, (points, nz) = motion.problem, motion.z.shape
        nx, count = len(problem.start[0]), problem.stage.balance.numel() + len(problem.path)
        first = row + motion.intervals * (motion.lobatto.points - 1) * nx
        of_rows = solution.multipliers[first : first + points * count].reshape(points, count)
        of_limits = solution.bound_multipliers[unknown : unknown + points * nz].reshape(points, nz).copy()
        of_limits[0, :nx] = 0.0  # the start is no limit
        pull = np.linalg.norm(np.hstack([of_rows, of_limits]), axis=1)
        norms.append(pull / (motion.duration_s * motion.lobatto.quadrature(motion.mesh)))
        row, unknown = first + points * count + len(problem.goal), unknown + points * nz + 1
    return np.concatenate(norms)
