"""Figures of a plan: what it asks of the joints, what holds it back, how it was found, what was flown."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from spacerobot.arrays import Array
from spacerobot.errors import ResultError
from spacerobot.files import write_bytes
from spacerobot.result import Result
from viz.figures.phases import shade
from viz.figures.style import COLOURS, DASHES, Drawing, line, panels, styled, to_bytes, unit_scale

ACTIVE = 1e-4
"""How near to a limit a value is to be held by it, as a part of the limits' size."""
ROOM = 0.6
"""Limits are drawn no farther from the curves than this part of the curves' own range."""
HELD: dict[str, Any] = {"marker": "s", "markersize": 3, "linestyle": "", "color": "#B00020", "zorder": 4}
"""Look of the points at which a limit is active."""
FLOWN: dict[str, Any] = {"color": "black", "linewidth": 1.0, "linestyle": (0, (1, 2))}
"""Look of what was flown."""


@styled
def plan_joints(plan: xr.Dataset, flown: Result | None = None) -> Drawing:
    """Joint positions, rates and torques of each robot, with limits; active ones are marked.

    Parameters
    ----------
    plan
        What stands in ``plan.nc``.
    flown
        Result of its scenario, drawn dotted over the plan.
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
                own = plan.sel(joint=joint)
                look = {
                    "color": COLOURS[k % len(COLOURS)],
                    "linestyle": DASHES[k // len(COLOURS) % len(DASHES)],
                }
                panel.plot(
                    plan.time.values,
                    own[name].values * scale,
                    linewidth=1.1,
                    label=joint.partition("/")[2],
                    **look,
                )
                _held(panel, plan.time.values, own[name].values * scale, own[f"{name}_limit"].values * scale)
            if flown is not None:
                _over(panel, plan, flown, name, mine)
            _limits(panel, plan, name, mine, scale)
            shade(panel, _phases(plan), named=panel is axes[0, 0])
            panel.set_title(f"{robot}, {words}")
            panel.set_ylabel(f"[{unit}]")
            panel.set_xlabel("time [s]")
        row[2].legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7)
    return figure


@styled
def plan_constraints(plan: xr.Dataset) -> Drawing:
    """Distances, cones and what else holds along a plan, each with its limits; active ones are marked.

    Parameters
    ----------
    plan
        What stands in ``plan.nc``; with ``constraint_flown``, drawn dotted over it, where it was flown.
    """
    names = [str(name) for name in plan.constraint_name.values]
    figure, axes = panels(-(-len(names) // 2), min(2, len(names)), sharex=True, height_in=1.6)
    time = plan.time.values
    for panel, name in zip(axes.flat, names, strict=False):
        own = plan.sel(constraint_name=name)
        scale, unit = unit_scale(str(own.constraint_unit.values))
        values, limits = own.constraint.values * scale, own.constraint_limit.values * scale
        holds = (time >= float(own.constraint_begin) - 1e-9) & np.isfinite(values)
        panel.plot(time, values, **line(0))
        if "constraint_flown" in own:
            panel.plot(own.flown_time.values, own.constraint_flown.values * scale, **FLOWN)
        for limit in limits[np.isfinite(limits)]:
            panel.plot(time[holds], np.full(holds.sum(), limit), color="0.35", linewidth=0.9, linestyle="--")
        _held(panel, time[holds], values[holds], limits)
        shade(panel, _phases(plan))
        panel.set_title(name, fontsize=7.5)
        panel.set_ylabel(f"[{unit}]")
        panel.set_xlabel("time [s]")
    for panel in list(axes.flat)[len(names) :]:
        panel.set_visible(False)
    return figure


@styled
def convergence(solves: list[Mapping[str, Any]]) -> Drawing:
    """Cost and greatest violation over the iterations of every run of the solver.

    Parameters
    ----------
    solves
        As ``plan.json`` has them.
    """
    figure, axes = panels(1, 2, height_in=2.3)
    least = min(solve["cost"] for solve in solves)
    for k, solve in enumerate(solves):
        label = f"start {solve['start'] + 1}, {solve['intervals']} intervals"
        costs, violations = (np.array(solve[key], dtype=float) for key in ("costs", "violations"))
        panel_values = (costs - least, violations)
        for panel, values in zip(axes.flat, panel_values, strict=True):
            shown = np.where(values > 0, values, np.nan)
            panel.plot(np.arange(len(shown)), shown, label=label, **line(k))
    for panel, title in zip(axes.flat, ("cost above the least one found", "greatest violation"), strict=True):
        panel.set(title=title, xlabel="iteration", yscale="log")
        panel.yaxis.set_major_formatter(lambda value, _: f"{value:.0e}")
    axes[0, 0].legend(fontsize=7)
    return figure


def plan_figures(
    plan: xr.Dataset, summary: Mapping[str, Any], flown: Result | None = None
) -> Iterator[tuple[str, Drawing]]:
    """Name and drawing of each figure of a plan."""
    yield "plan_joints", plan_joints(plan, flown)
    if "constraint" in plan:
        yield "plan_constraints", plan_constraints(plan)
    yield "convergence", convergence(summary["solves"])


def write_plan_figures(
    plan: xr.Dataset, summary: Mapping[str, Any], folder: Path, *, flown: Result | None = None
) -> list[Path]:
    """Write the figures of a plan as PDF and PNG.

    Raises
    ------
    ResultError
        If a file cannot be written, or ``flown`` has none of the plan's joints.
    """
    written = []
    for name, drawing in plan_figures(plan, summary, flown):
        for form in ("pdf", "png"):
            path = folder / f"{name}.{form}"
            write_bytes(path, to_bytes(drawing, form))
            written.append(path)
    return written


def _phases(plan: xr.Dataset) -> list[tuple[str, float, float]]:
    """Name, begin and end [s] of each phase of a plan that has several; none of one that has one."""
    if "phase" not in plan:
        return []
    names, time = plan.phase.values.astype(str), plan.time.values
    spans = [(str(name), time[names == name]) for name in dict.fromkeys(names)]
    return [(name, float(own[0]), float(own[-1])) for name, own in spans] if len(spans) > 1 else []


def _held(panel: Axes, time: Array, values: Array, limits: Array) -> None:
    """Mark where values are at a limit."""
    for limit in limits[np.isfinite(limits)]:
        size = max(float(np.abs(limits[np.isfinite(limits)]).max()), 1e-9)
        near = np.abs(values - limit) <= ACTIVE * size
        panel.plot(time[near], values[near], **HELD)


def _limits(panel: Axes, plan: xr.Dataset, name: str, joints: list[str], scale: float) -> None:
    """Limits that are not far from what is drawn."""
    low, high = panel.get_ylim()
    room = ROOM * (high - low)
    for limit in np.unique(plan[f"{name}_limit"].sel(joint=joints).values * scale):
        if low - room <= limit <= high + room:
            panel.axhline(limit, color="0.35", linewidth=0.9, linestyle="--")


def _over(panel: Axes, plan: xr.Dataset, flown: Result, name: str, joints: list[str]) -> None:
    """What was flown until the plan's end, dotted."""
    scale = unit_scale(plan[name].attrs["units"])[0]
    data = flown.data.sel(time=slice(0.0, float(plan.time.values[-1])))
    known = {str(label) for label in data.joint.values}
    if not known.issuperset(joints):
        raise ResultError("was not flown by this plan: its joints are others", source=flown.folder)
    for joint in joints:
        own = data["joint_torque" if name == "torque" else "joint_position"].sel(joint=joint).values * scale
        if name == "joint_rate":
            own = np.gradient(np.unwrap(own, period=360.0), data.time.values)
        panel.plot(data.time.values, own, **FLOWN)
