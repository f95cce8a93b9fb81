"""Report section of a plan: verification, motion, active limits, cost sensitivities, replay and mesh."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import xarray as xr

from optim.planning.output.plan_tables import (
    cost_table,
    mesh_text,
    replay_table,
    sensitivity_table,
    solver_table,
    violation_table,
)
from spacerobot.common.arrays import Array
from spacerobot.common.tables import escape, unit_scale
from spacerobot.result import Result
from viz.figures import to_bytes
from viz.figures.plan import ACTIVE, plan_figures
from viz.page.page import page as animated
from viz.report.report import ReportSection, page
from viz.report.sections import picture, playable, still_png, table

TITLES = {
    "plan_joints": "Joints: positions, rates and torques with their limits; squares where a limit is active; "
    "dotted: as flown",
    "plan_bases": "Motion of the bases, and what drives them",
    "plan_constraints": "Distances, cones and other constraints with their limits",
    "convergence": "Convergence of the solver",
}
LIMITED = {
    "joint_position": ("position", "joint_position_limit"),
    "joint_rate": ("rate", "joint_rate_limit"),
    "torque": ("torque", "torque_limit"),
}
"""Label of each variable of the joints, and the variable of its limits."""


def plan_report(
    plan: xr.Dataset, summary: Mapping[str, Any], simulation: Result, data: Mapping[str, Any]
) -> str:
    """HTML of a report about a plan.

    Args:
        plan, summary: Data of ``plan.nc`` and ``plan.json``.
        simulation: Result of the scenario that follows the plan.
        data: Data of the animated page of plan and result.
    """
    figures = "".join(
        picture(name, TITLES.get(name, name), to_bytes(drawing, "svg"))
        for name, drawing in plan_figures(plan, summary, simulation)
    )
    texts = {
        "verdict": ("In short", _in_short(summary, simulation, data)),
        "limits": ("Limits, and where they bind", _limits(plan)),
        "cost": ("Cost", _cost(summary)),
        "replay": ("Replay", _replay(summary)),
        "mesh": ("Mesh and solver", _mesh(summary)),
        "figures": ("Figures", figures),
    }
    sections = [
        (ReportSection(name, title, lambda _: None), text) for name, (title, text) in texts.items() if text
    ]
    return page(f"Plan of {summary['scenario']}", sections)


def _in_short(summary: Mapping[str, Any], flown: Result, data: Mapping[str, Any]) -> str:
    verification = summary["verification"]
    allowed = verification["tolerance_m"]
    open_loop, closed = (
        max(verification[f"{how}_error_m"].values(), default=0.0) for how in ("replay", "followed")
    )
    exceeded = [v for v in verification["violations"] if v["amount"] > v["allowed"]]
    words = f"A motion of {summary['duration_s']:.4g} s with the cost {summary['cost']:.4g}. "
    if min(open_loop, closed) <= allowed and not exceeded:
        words += f"Verified: its simulation ends {1e3 * min(open_loop, closed):.2g} mm from the plan"
        words += f" ({1e3 * allowed:g} mm are allowed), and all limits hold between the points of the mesh."
    elif exceeded:
        worst = exceeded[0]
        words += f"Not verified: {worst['name']} is violated by {worst['amount']:.2g} {worst['unit']}."
    else:
        words += f"Not verified: its simulation ends {1e3 * min(open_loop, closed):.2g} mm from the plan."
    if verification["second_order"] == "saddle point":
        words += " It is a saddle point: nearby motions cost less."
    text = f"<p class='outcome'>{escape(words)}</p>"
    return text + playable(animated({**data, "autoplay": True}), [still_png(flown)], 720)


def binding(plan: xr.Dataset) -> Iterator[tuple[str, str, list[tuple[float, float]]]]:
    """Active limits: quantity, limit, and the periods [s] in which it is active.

    Args:
        plan: Data of ``plan.nc``.
    """
    time = plan.time.values
    for variable, (word, limits) in LIMITED.items():
        if limits not in plan:
            continue
        for joint in plan.joint.values:
            values, ends = plan[variable].sel(joint=joint).values, plan[limits].sel(joint=joint).values
            yield from _active(f"{word} of {joint}", time, values, ends, str(plan[variable].attrs["units"]))
    for name in plan.constraint_name.values if "constraint" in plan else ():
        constraint = plan.sel(constraint_name=name)
        unit = str(constraint.constraint_unit.values)
        yield from _active(
            str(name), time, constraint.constraint.values, constraint.constraint_limit.values, unit
        )


def _active(
    name: str, time: Array, values: Array, limits: Array, unit: str
) -> Iterator[tuple[str, str, list[tuple[float, float]]]]:
    finite = limits[np.isfinite(limits)]
    size = max(float(np.abs(finite).max(initial=0.0)), float(np.ptp(finite)) if len(finite) else 0.0)
    for side, limit in zip(("lower", "upper"), limits, strict=True):
        near = (
            np.abs(values - limit) <= ACTIVE * size
            if np.isfinite(limit) and size
            else np.zeros(len(time), bool)
        )
        if not near.any():
            continue
        factor, unit_label = unit_scale(unit)
        # where periods of active points begin and end
        steps = np.flatnonzero(np.diff(np.concatenate([[0], near.astype(int), [0]])))
        yield (
            name,
            f"{side}, {factor * limit:.4g} {unit_label}",
            [(float(time[a]), float(time[b - 1])) for a, b in steps.reshape(-1, 2)],
        )


def _limits(plan: xr.Dataset) -> str:
    rows = [
        [name, limit, ", ".join(f"{a:.3g} s" if a == b else f"{a:.3g} to {b:.3g} s" for a, b in periods)]
        for name, limit, periods in binding(plan)
    ]
    if not rows:
        return "<p>No limit is active: the motion would be the same without them.</p>"
    return table(["limit of", "bound", "active at"], rows)


def _cost(summary: Mapping[str, Any]) -> str:
    text = cost_table(summary).html()
    slopes = sensitivity_table(summary)
    if slopes is not None:
        return text + slopes.html()
    return (
        f"{text}<p>Sensitivities of the optimal cost are listed here after "
        "<code>spacerobot plan SCENARIO --out DIR --sensitivities PATH,PATH</code>.</p>"
    )


def _replay(summary: Mapping[str, Any]) -> str:
    tables = (replay_table(summary), violation_table(summary))
    return "".join(one.html() for one in tables if one is not None)


def _mesh(summary: Mapping[str, Any]) -> str:
    return f"<p>{escape(mesh_text(summary))}.</p>{solver_table(summary).html()}"
