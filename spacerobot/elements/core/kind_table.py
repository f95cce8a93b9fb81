"""Table of all kinds of elements, for documentation and command line."""

from __future__ import annotations

import inspect
import re
from typing import Any

from spacerobot.common.section import Section
from spacerobot.elements.core.registry import FAMILIES, PLANS, kinds

PLACES = {
    "reference": "`robots.*.tips.*.reference`, `target.reference`",
    "grasp": "`grasps.*`",
    "contact": "`contacts.*`",
    "tip_controller": "`robots.*.tips.*.controllers.*`, `pid`, `orientation_pid`",
    "robot_controller": "`robots.*.controllers.*`, `joint_pd`",
    "actuator": "`robots.*.actuators.*`; `robots.*.torque_limits: true` is a `torque_limit` of all joints "
    "but those that are wheels",
    "sensor": "`robots.*.sensors.*`",
    "estimator": "`robots.*.estimators.*`",
    "environment": "`environment.*`",
    "flexible_link": "`robots.*.flexible.*`, `target.flexible.*`",
    "shape": "`pads.*`",
    "goal": "`plan.goals.*`; the kind follows from `attitude`, `frame`, `position`, `joints` or `still`",
    "plan_limit": "`plan.limits.*`; the name is the kind if the section gives none; `plan.keep_out.*`, "
    "`.approach_cones.*`, `.line_of_sight.*`",
}
"""Dotted path of each family's sections in a scenario."""


def summary_of(kind: type[Section]) -> str:
    """First sentence of a kind's documentation, in one line."""
    text = " ".join(inspect.cleandoc(kind.__doc__ or "").split("\n\n")[0].split())
    return text.rstrip(".")


def fields_of(kind: type[Section]) -> list[tuple[str, str, str]]:
    """Keys of a kind's section: name, default (or ``required``), description with unit."""
    rows = []
    for name, field in kind.model_fields.items():
        if name != "kind":
            default = "required" if field.is_required() else _text(field.default)
            rows.append((name, default, re.sub(r"\s+", " ", field.description or "")))
    return rows


def markdown() -> str:
    """Table of every kind by family, for the documentation."""
    lines = []
    for family in FAMILIES | PLANS:
        lines += [f"### {family.replace('_', ' ').capitalize()}", "", f"Location: {PLACES[family]}.", ""]
        lines += ["| kind | what it is | keys |", "|---|---|---|"]
        for name, kind in kinds(family).items():
            keys = ", ".join(f"`{key}`" for key, _, _ in fields_of(kind)) or "none"
            lines.append(f"| `{name}` | {summary_of(kind)} | {keys} |")
        lines.append("")
    return "\n".join(lines)


def _text(value: Any) -> str:
    if isinstance(value, tuple):
        return " ".join(_text(item) for item in value)
    return f"{value:g}" if isinstance(value, float) else str(value).lower()
