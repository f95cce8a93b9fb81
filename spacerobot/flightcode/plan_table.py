"""A plan as C arrays with the follower that interpolates them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.elements.references.knot_motion import nodes_of, slices_of
from spacerobot.elements.references.plan_file import parted, points_of
from spacerobot.flightcode.c_text import comment_text, number_literal

if TYPE_CHECKING:
    import xarray as xr

TABLES = {
    "joint_position": "positions of joints [rad or m]",
    "joint_rate": "rates of joints [rad/s or m/s]",
    "torque": "torques and forces of joints [N m or N]",
    "base_wrench": "forces and torques commanded of bases, in their own axes [N or N m]",
    "base_rate": "velocities and spins of bases along and about these axes [m/s or rad/s]",
    "grip_wrench": "forces and torques of grasps on tips, world axes [N or N m]",
}
"""Variables of a plan that become arrays, with their descriptions."""

FOLLOWER = """\
/* Interval of a time, and the part of it that has passed; after the end the last point. */
static uint32_t interval_at(double time, double *part)
{
    uint32_t k = 0u;
    while ((k + 1u < PLAN_INTERVALS) && (time >= plan_time[plan_first_row[k + 1u]])) {
        ++k;
    }
    *part = (time - plan_time[plan_first_row[k]])
        / (plan_time[plan_first_row[k] + PLAN_POINTS - 1u] - plan_time[plan_first_row[k]]);
    return k;
}

/* Lagrange polynomial of a point and its derivative. */
static double polynomial(uint32_t j, double u, double *rate)
{
    double value = plan_scale[j];
    uint32_t k;
    *rate = 0.0;
    for (k = 0u; k < PLAN_POINTS; ++k) {
        if (k != j) {
            *rate = (*rate * (u - plan_node[k])) + value;
            value = value * (u - plan_node[k]);
        }
    }
    return value;
}

void plan_force_at(double time, const double *table, uint32_t columns, double *force)
{
    double u;
    const uint32_t row = plan_first_row[interval_at(time, &u)];
    uint32_t i;
    uint32_t j;
    for (i = 0u; i < columns; ++i) {
        force[i] = 0.0;
        for (j = 0u; (j < PLAN_POINTS) && (time <= PLAN_DURATION); ++j) {
            double rate;
            force[i] += polynomial(j, u, &rate) * table[((row + j) * columns) + i];
        }
    }
}

void plan_motion_at(double time, double *position, double *rate)
{
    const double at = (time < PLAN_DURATION) ? time : PLAN_DURATION;
    double u;
    const uint32_t k = interval_at(at, &u);
    const uint32_t row = plan_first_row[k];
    const double width = plan_time[row + PLAN_POINTS - 1u] - plan_time[row];
    uint32_t i;
    uint32_t j;
    for (i = 0u; i < PLAN_JOINTS; ++i) {
        position[i] = 0.0;
        rate[i] = 0.0;
        for (j = 0u; j < PLAN_POINTS; ++j) {
            double d;
            const double l = polynomial(j, u, &d);
            const double away = u - plan_node[j];
            const double steep = 1.0 - (plan_steep[j] * away);
            const double value = plan_joint_position[row + j][i];
            const double slope = width * plan_joint_rate[row + j][i];
            position[i] += (l * l) * ((steep * value) + (away * slope));
            rate[i] += (((2.0 * steep * l * d) - (plan_steep[j] * l * l)) * value)
                + (((l * l) + (2.0 * away * l * d)) * slope);
        }
        rate[i] = (time < PLAN_DURATION) ? (rate[i] / width) : 0.0;
    }
}
"""
"""Follower: Hermite polynomials of values and rates for motion, Lagrange polynomials for forces."""


def plan_sources(data: xr.Dataset) -> dict[str, str]:
    """Return header and source of a plan by file name.

    Args:
        data: Data of a plan, as of :class:`spacerobot.PlanResult`.
    """
    plan = parted(data)
    times, points = plan.time.values, points_of(plan)
    intervals, nodes = slices_of(times, points), nodes_of(times, points)
    scales = [float(1 / np.prod(node - np.delete(nodes, j))) for j, node in enumerate(nodes)]
    steep = [float(2 * (1 / (node - np.delete(nodes, j))).sum()) for j, node in enumerate(nodes)]
    joints = [str(label) for label in plan.joint.values]
    tables = {name: text for name, text in TABLES.items() if name in plan}
    sizes = {name: int(plan[name].sizes[_dimension(plan[name])]) for name in tables}
    header = [
        "/* A plan: values at its points, and the follower that interpolates them. */",
        "#ifndef PLAN_H",
        "#define PLAN_H",
        "",
        "#include <stdint.h>",
        "",
        f"#define PLAN_ROWS {len(times)}u",
        f"#define PLAN_INTERVALS {len(intervals)}u",
        f"#define PLAN_POINTS {points}u",
        f"#define PLAN_JOINTS {len(joints)}u",
        f"#define PLAN_DURATION {number_literal(times[-1])}",
        "",
        f"/* Joints: {comment_text(', '.join(joints))} */",
        "extern const double plan_time[PLAN_ROWS]; /* [s] */",
    ]
    for name, text in tables.items():
        labels = [str(label) for label in plan[_dimension(plan[name])].values]
        header.append(f"/* {text}: {comment_text(', '.join(labels))} */")
        header.append(f"extern const double plan_{name}[PLAN_ROWS][{sizes[name]}];")
    header += [
        "",
        "/* Positions and rates of the joints at a time [s]; at rest after the end. */",
        "void plan_motion_at(double time, double *position, double *rate);",
        "",
        "/* Forces of a table, &plan_torque[0][0], of so many columns at a time [s]; zero after the end. */",
        "void plan_force_at(double time, const double *table, uint32_t columns, double *force);",
        "",
        "#endif",
        "",
    ]
    firsts = ", ".join(f"{interval.start}u" for interval in intervals)
    source = [
        '#include "plan.h"',
        "",
        f"const double plan_time[PLAN_ROWS] = {_row(times)};",
        f"static const uint32_t plan_first_row[PLAN_INTERVALS] = {{{firsts}}};",
        f"static const double plan_node[PLAN_POINTS] = {_row(nodes)};",
        f"static const double plan_scale[PLAN_POINTS] = {_row(np.array(scales))};",
        f"static const double plan_steep[PLAN_POINTS] = {_row(np.array(steep))};",
    ]
    for name in tables:
        rows = ",\n".join(f"    {_row(row)}" for row in plan[name].transpose("time", ...).values)
        source.append(f"const double plan_{name}[PLAN_ROWS][{sizes[name]}] = {{\n{rows}\n}};")
    return {"plan.h": "\n".join(header), "plan.c": "\n".join([*source, "", FOLLOWER])}


def _dimension(variable: xr.DataArray) -> str:
    """Dimension of a variable apart from time."""
    return next(str(dim) for dim in variable.dims if dim != "time")


def _row(values: Array) -> str:
    """Numbers as a C initialiser."""
    return "{" + ", ".join(number_literal(value) for value in values.tolist()) + "}"
