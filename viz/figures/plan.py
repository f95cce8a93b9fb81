"""Figures of a plan: joint and base motion, constraints, convergence of the solver, simulated motion."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from scipy.spatial.transform import Rotation

from spacerobot.common.arrays import Array
from spacerobot.common.errors import ResultError
from spacerobot.common.tables import unit_scale
from spacerobot.result import Result
from viz.figures.phases import shade
from viz.figures.style import (
    COLOURS,
    DASHES,
    Drawing,
    below_last,
    legend_above,
    legend_beside,
    line,
    panel_grid,
    panels,
    styled,
)

ACTIVE = 1e-4
"""Distance from a limit up to which it is active, as a share of the greater one of a pair of limits."""
ROOM = 0.6
"""Maximum distance of drawn limits from the curves, as a share of the curves' range."""
HELD: dict[str, Any] = {"marker": "s", "markersize": 3, "linestyle": "", "color": "#B00020", "zorder": 4}
"""Marker of the points at which a limit is active."""
FLOWN: dict[str, Any] = {"color": "black", "linewidth": 1.0, "linestyle": (0, (1, 2))}
"""Line style of the simulated motion."""


@styled
def plan_joints(plan: xr.Dataset, simulation: Result | None = None) -> Drawing:
    """Joint positions, rates and torques of each robot, with limits; active ones are marked.

    Args:
        plan: Content of ``plan.nc``.
        simulation: Result of its scenario, drawn dotted over the plan.
    """
    labels = [str(joint) for joint in plan.joint.values]
    robots = list(dict.fromkeys(label.partition("/")[0] for label in labels))
    figure, axes = panels(len(robots), 3, sharex=True, height_in=2.4)
    named = (("joint_position", "positions"), ("joint_rate", "rates"), ("torque", "torques"))
    for row, robot in zip(axes, robots, strict=True):
        mine = [label for label in labels if label.startswith(f"{robot}/")]
        for panel, (name, words) in zip(row, named, strict=True):
            scale, unit = unit_scale(plan[name].attrs["units"])
            for k, joint in enumerate(mine):
                joint_plan = plan.sel(joint=joint)
                time, values = plan.time.values, joint_plan[name].values * scale
                panel.plot(time, values, linewidth=1.1, label=joint.partition("/")[2], **_look(k))
                _held(panel, time, values, joint_plan[f"{name}_limit"].values * scale)
            if simulation is not None:
                # the simulated motion until the plan's end, dotted
                data = simulation.data.sel(time=slice(0.0, float(plan.time.values[-1])))
                if not {str(label) for label in data.joint.values}.issuperset(mine):
                    message = "was not flown by this plan: its joints are others"
                    raise ResultError(message, source=simulation.folder)
                key = "joint_torque" if name == "torque" else "joint_position"
                for joint in mine:
                    values = data[key].sel(joint=joint).values * scale
                    if name == "joint_rate":
                        values = np.gradient(np.unwrap(values, period=360.0), data.time.values)
                    panel.plot(data.time.values, values, **FLOWN)
            limits = plan[f"{name}_limit"].sel(joint=mine).values * scale
            # without the words that all joints begin with; the legend has the whole names
            parts = [joint.partition("/")[2].split("_") for joint in mine]
            shared = len(list(itertools.takewhile(lambda each: len({*each}) == 1, zip(*parts, strict=False))))
            short = ["_".join(part[shared if len(parts) > 1 else 0 :] or part) for part in parts]
            _near_limits(panel, limits, short)
            shade(panel, _phases(plan), named=panel is axes[0, 0])
            panel.set(title=f"{robot}, {words}", ylabel=f"[{unit}]", xlabel="time [s]")
    below_last(axes)
    legend_beside(figure, axes)
    return figure


@styled
def plan_bases(plan: xr.Dataset, flown: Result | None = None) -> Drawing:
    """Motion of driven bases since the start, their rates, and their forces and torques, with limits.

    Active limits are marked.

    Args:
        plan: Content of ``plan.nc``, with ``base_wrench``.
        flown: Result of its scenario: the motion is drawn dotted over the plan's.
    """
    drives, rows = [str(drive) for drive in plan.drive.values], list[tuple[str, str, list[str]]]()
    for base in dict.fromkeys(drive.rpartition(".")[0] for drive in drives):
        for part in ("f", "t"):
            matching = [drive for drive in drives if drive.startswith(f"{base}.{part}")]
            rows += [(base.rpartition("/")[0], part, matching)] if matching else []
    time, figure, axes = plan.time.values, *panels(len(rows), 3, sharex=True, height_in=2.4)
    for row, (robot, part, matching) in zip(axes, rows, strict=True):
        names = ("displacement", "velocity", "force") if part == "f" else ("rotation", "spin", "torque")
        units = ("m", "m/s", "N") if part == "f" else ("rad", "rad/s", "N m")
        moved = base_motion(plan, robot)[part == "t"]
        columns = ["xyz".index(drive[-1]) if moved.shape[1] > 1 else 0 for drive in matching]
        rates, wrench = (plan[key].sel(drive=matching).values for key in ("base_rate", "base_wrench"))
        for panel, name, unit, values in zip(
            row, names, units, (moved[:, columns], rates, wrench), strict=True
        ):
            scale, unit_label = unit_scale(unit)
            for k, drive in enumerate(matching):
                panel.plot(time, values[:, k] * scale, label=drive[-1], **_look(k))
            panel.set(title=f"base of {robot}, {name}", ylabel=f"[{unit_label}]", xlabel="time [s]")
            shade(panel, _phases(plan), named=panel is axes[0, 0])
        limits = plan.base_wrench_limit.sel(drive=matching).values
        for k, own_limits in enumerate(limits):
            _held(row[2], time, wrench[:, k], own_limits)
        _near_limits(row[2], limits, [drive[-1] for drive in matching])
        if flown is not None:
            data = flown.data.sel(time=slice(0.0, float(time[-1])))
            other = base_motion(data, robot)[part == "t"][:, columns]
            row[0].plot(data.time.values, other * unit_scale(units[0])[0], **FLOWN)
    below_last(axes)
    legend_beside(figure, axes)
    return figure


def base_motion(data: xr.Dataset, robot: str) -> tuple[Array, Array]:
    """Displacement (n, 2 or 3) [m] and rotation vector (n, 1 or 3) [rad] of a floating base since the start.

    World axes; rotations are unwound, so that they continue beyond 180 deg.

    Args:
        data: A plan, or a result's data: configurations ``q`` by label.
        robot: Name of the robot.
    """
    labels = [str(label).removeprefix("q.") for label in data.configuration.values]
    q = data.q.values[:, [label.startswith(f"{robot}/root[") for label in labels]]
    if q.shape[1] == 4:
        angle = np.unwrap(np.arctan2(q[:, 3], q[:, 2]))
        return q[:, :2] - q[0, :2], (angle - angle[0])[:, None]
    turned = Rotation.from_quat(q[:, 3:])
    vectors = (turned * turned[0].inv()).as_rotvec()
    for before, vector in itertools.pairwise(vectors):
        angle = float(np.linalg.norm(vector))
        if angle > 0:
            axis = vector / angle
            vector += 2 * np.pi * round(float((before - vector) @ axis) / (2 * np.pi)) * axis
    return q[:, :3] - q[0, :3], vectors


@styled
def plan_constraints(plan: xr.Dataset) -> Drawing:
    """Distances, cones and what else holds along a plan, each with its limits; active ones are marked.

    Args:
        plan: Content of ``plan.nc``; ``constraint_flown`` of a flown plan is drawn dotted over it.
    """
    names = [str(name) for name in plan.constraint_name.values]
    figure, axes = panel_grid(len(names), 2, sharex=True, height_in=1.6)
    time = plan.time.values
    for panel, name in zip(axes.flat, names, strict=False):
        constraint = plan.sel(constraint_name=name)
        scale, unit = unit_scale(str(constraint.constraint_unit.values))
        values, limits = constraint.constraint.values * scale, constraint.constraint_limit.values * scale
        holds = (time >= float(constraint.constraint_begin) - 1e-9) & np.isfinite(values)
        panel.plot(time, values, **line(0))
        if "constraint_flown" in constraint:
            panel.plot(constraint.flown_time.values, constraint.constraint_flown.values * scale, **FLOWN)
        for limit in limits[np.isfinite(limits)]:
            panel.plot(time[holds], np.full(holds.sum(), limit), color="0.35", linewidth=0.9, linestyle="--")
        _held(panel, time[holds], values[holds], limits)
        shade(panel, _phases(plan))
        panel.set_title(textwrap.fill(name, 48), fontsize=7.5)
        panel.set(ylabel=f"[{unit}]", xlabel="time [s]")
    below_last(axes)
    if axes.size > len(names):
        for above in axes[-2:-1, 1]:  # the last of its column
            above.set_xlabel("time [s]")
            above.tick_params(labelbottom=True)
    return figure


@styled
def convergence(solves: list[Mapping[str, Any]]) -> Drawing:
    """Cost and largest violation over the iterations of every run of the solver.

    The cost is shown as the distance from the last cost of its run, since costs on different meshes differ.

    Args:
        solves: Runs of the solver, from ``plan.json``.
    """
    figure, axes = panels(1, 2, height_in=2.3)
    for k, solve in enumerate(solves):
        label = f"run {k + 1}: start {solve['start'] + 1}, {solve['intervals']} intervals"
        costs, violations = (np.array(solve[key], dtype=float) for key in ("costs", "violations"))
        for panel, values in zip(axes.flat, (np.abs(costs - costs[-1:]), violations), strict=True):
            curve = np.where(values > 0, values, np.nan)
            panel.plot(np.arange(len(curve)), curve, label=label, **line(k))
    for panel, title in zip(
        axes.flat, ("distance from the run's last cost", "maximum violation"), strict=True
    ):
        panel.set(title=title, xlabel="iteration", yscale="log")
        panel.yaxis.set_major_formatter(lambda value, _: f"{value:.0e}")
    legend_above(figure, axes[0, 0], columns=2)
    return figure


def plan_figures(
    plan: xr.Dataset, summary: Mapping[str, Any], flown: Result | None = None
) -> Iterator[tuple[str, Drawing]]:
    """Name and drawing of each figure of a plan."""
    if plan.sizes["joint"]:
        yield "plan_joints", plan_joints(plan, flown)
    if "drive" in plan.sizes:
        yield "plan_bases", plan_bases(plan, flown)
    if "constraint" in plan:
        yield "plan_constraints", plan_constraints(plan)
    yield "convergence", convergence(summary["solver_runs"])


def _phases(plan: xr.Dataset) -> list[tuple[str, float, float]]:
    """Name, start and end [s] of each phase of a plan with several phases; empty for one phase."""
    if "phase" not in plan:
        return []
    names, time = plan.phase.values.astype(str), plan.time.values
    spans = [(str(name), time[names == name]) for name in dict.fromkeys(names)]
    return [(name, float(times[0]), float(times[-1])) for name, times in spans] if len(spans) > 1 else []


def _held(panel: Axes, time: Array, values: Array, limits: Array) -> None:
    """Mark where values are at a limit."""
    for limit in limits[np.isfinite(limits)]:
        size = max(float(np.abs(limits[np.isfinite(limits)]).max()), 1e-9)
        near = np.abs(values - limit) <= ACTIVE * size
        panel.plot(time[near], values[near], **HELD)


def _near_limits(panel: Axes, limits: Array, names: Sequence[str]) -> None:
    """Draw the limits (k, 2) near the curves, with the names of their curves.

    The limit of a single curve has its colour; a limit common to several is grey.
    """
    low, high = panel.get_ylim()
    room = ROOM * (high - low)
    limits_in_range = [limit for limit in np.unique(limits) if low - room <= limit <= high + room]
    # a name interrupts its line; names of limits near to each other take turns at the two ends
    near = 0.07 * (max(high, *limits_in_range) - min(low, *limits_in_range)) if limits_in_range else 0.0
    left = False
    for k, limit in enumerate(limits_in_range):
        left = k > 0 and limit - limits_in_range[k - 1] < near and not left
        rows = np.flatnonzero((limits == limit).any(axis=1)).tolist()
        text = f"{len(rows)} joints" if len(rows) > 2 else ", ".join(names[k] for k in rows)
        text = "all" if len(rows) == len(names) > 1 else text
        colour = _look(rows[0])["color"] if len(rows) == 1 else "0.35"
        panel.axhline(limit, color=colour, linewidth=0.9, linestyle="--")
        inside: dict[str, Any] = {"ha": "left" if left else "right", "va": "center", "fontsize": 7}
        inside["bbox"] = {"facecolor": "white", "linewidth": 0, "pad": 0.8}
        end = 0.02 if left else 0.98
        named = panel.annotate(text, (end, limit), xycoords=("axes fraction", "data"), color=colour, **inside)
        named.set_in_layout(False)  # panels keep their widths however long the names are


def _look(k: int) -> dict[str, Any]:
    """Colour and dashes of joint or drive number ``k``: colours come round again with other dashes."""
    return {"color": COLOURS[k % len(COLOURS)], "linestyle": DASHES[k // len(COLOURS) % len(DASHES)]}
