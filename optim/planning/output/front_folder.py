"""Files of a Pareto front: ``front.json``, and a plan's folder for each of its points."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from optim.json_files import plain, write_json
from optim.planning.formulation.costs import headings
from optim.planning.output.plan_folder import summary
from optim.planning.output.plan_folder import write as write_plan
from optim.planning.studies.pareto_front import ParetoFront
from spacerobot.common.files import StrPath
from spacerobot.common.tables import Table, unit_scale
from spacerobot.scene import build_scene

FRONT = "front.json"


def to_data(front: ParetoFront) -> dict[str, Any]:
    """Data of a Pareto front for JSON."""
    costs = front.costs
    return {
        "scenario": front.scene.scenario.name,
        "terms": list(front.names),
        "headings": headings(costs),
        "units": {name: cost.weighs.unit_in(front.scene) for name, cost in costs.items()},
        "points": [
            {
                "name": point.name,
                "status": point.status,
                "failure": point.failure,
                "changes": dict(point.changes),
                "values": dict(point.values),
            }
            | ({} if point.plan is None else {"plan": summary(point.plan)})
            for point in front.points
        ],
    }


def front_table(data: Mapping[str, Any]) -> Table:
    """Table of a front: values and cost of each point, and the reason for a missing plan.

    Args:
        data: Data of :func:`to_data`.
    """
    terms = data["terms"]
    scales = {name: unit_scale(data["units"][name]) for name in terms}
    headings = (f"{data['headings'][name]} [{scales[name][1]}]" for name in terms)
    rows = []
    for point in data["points"]:
        plan, values = point.get("plan"), point["values"]
        cells = [f"{values[name] * scales[name][0]:.5g}" if name in values else "" for name in terms]
        cells += [f"{plan['cost']:.6g}", f"{plan['intervals']}"] if plan else ["", ""]
        status = "" if point["status"] == "efficient" else point["status"]
        if status == "refused":
            changes = ", ".join(f"{path} {value:.4g}" for path, value in point["changes"].items())
            status = f"refused ({changes}): {point['failure']}"
        rows.append([point["name"], *cells, status])
    return Table(f"Pareto front of {data['scenario']}", ("point", *headings, "cost", "intervals", ""), rows)


def write(front: ParetoFront, folder: StrPath) -> dict[str, Any]:
    """Write a front, and each plan into a subfolder; returns the content of ``front.json``.

    Raises:
        ResultError: If the folder cannot be written.
    """
    folder = Path(folder)
    data = plain(to_data(front))
    for point in front.points:
        if point.plan is not None:
            scene = build_scene(front.scene.scenario, dict(point.changes), source=front.scene.source)
            write_plan(dataclasses.replace(point.plan, scene=scene), folder / point.name)
    write_json(folder / FRONT, data)
    return dict(data)
