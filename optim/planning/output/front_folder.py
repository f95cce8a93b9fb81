"""Files of a Pareto front: ``front.json``, and a plan's folder for each of its points."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

from optim.json_values import plain
from optim.planning.formulation.costs import headings
from optim.planning.output.plan_folder import summary
from optim.planning.output.plan_folder import write as write_plan
from optim.planning.studies.pareto_front import ParetoFront
from spacerobot.files import StrPath, write_text
from spacerobot.scene import build_scene

FRONT = "front.json"


def to_data(front: ParetoFront) -> dict[str, Any]:
    """A front, plain."""
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


def write(front: ParetoFront, folder: StrPath) -> dict[str, Any]:
    """Write a front, and each plan into a folder of its own; gives what stands in ``front.json``.

    Raises
    ------
    ResultError
        If the folder cannot be written.
    """
    folder = Path(folder)
    data = plain(to_data(front))
    for point in front.points:
        if point.plan is not None:
            scene = build_scene(front.scene.scenario, dict(point.changes), source=front.scene.source)
            write_plan(dataclasses.replace(point.plan, scene=scene), folder / point.name)
    write_text(folder / FRONT, json.dumps(data, indent=1, allow_nan=False) + "\n")
    return dict(data)
