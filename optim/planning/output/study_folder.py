"""Files of a design study: ``design.json`` and the files of the best design's plan."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from optim.json_files import plain, write_json
from optim.planning.output.plan_folder import summary
from optim.planning.output.plan_folder import write as write_plan
from optim.planning.studies.design_study import DesignStudy
from optim.problem.variables import at_bound
from spacerobot.common.files import StrPath
from spacerobot.common.tables import Table
from spacerobot.scenario.units import unit_at

DESIGN = "design.json"


def to_data(study: DesignStudy) -> dict[str, Any]:
    """Data of a design study for JSON; null where no plan was found."""
    variables = study.variables
    held = at_bound(variables.names, variables.unit(study.optimum.values))
    variable_data = {
        name: {
            "paths": list(variables.paths[k]),
            "unit": unit_at(study.scene.scenario, variables.paths[k][0]),
            "lower": variables.lower[k],
            "upper": variables.upper[k],
            "scale": "log" if variables.log[k] else "linear",
            "start": variables.start[k],
            "optimum": study.optimum.values[k],
            "slope": study.optimum.slopes[k],
            "where": held.get(name, ""),
        }
        for k, name in enumerate(variables.names)
    }
    data = {
        "scenario": study.scene.scenario.name,
        "variables": variable_data,
        "cost": {"start": study.trials[0].cost, "optimum": study.optimum.cost},
        "status": study.status,
        "trials": [vars(trial) for trial in study.trials],
        "sweeps": {name: [vars(trial) for trial in sweep] for name, sweep in study.sweeps.items()},
        "plan": summary(study.plan),
    }
    return dict(plain(data))


def study_tables(data: Mapping[str, Any]) -> list[Table]:
    """Tables of a study: the optimum, its variables, and the optimal cost over each variable.

    Args:
        data: Data of :func:`to_data`.
    """
    cost, trials, variables = data["cost"], data["trials"], data["variables"]
    rows = [
        ("optimal cost", f"{cost['start']:.6g} in the scenario, {cost['optimum']:.6g} at the optimum"),
        ("designs", f"{len(trials)}, {sum(trial['iterations'] for trial in trials)} iterations"),
        ("status", data["status"]),
    ]
    heads = ("variable", "unit", "from", "to", "scenario", "optimum", "sensitivity", "")
    cells = [
        [
            name,
            one["unit"],
            *(f"{one[key]:.6g}" for key in ("lower", "upper", "start", "optimum")),
            f"{one['slope']:+.4g}",
            one["where"],
        ]
        for name, one in variables.items()
    ]
    tables = [Table.of_pairs(f"design of {data['scenario']}", rows), Table("variables", heads, cells)]
    for k, (name, sweep) in enumerate(data["sweeps"].items()):
        points = [
            [f"{trial['values'][k]:.6g}"]
            + (
                [trial["failure"], ""]
                if trial["failure"]
                else [f"{trial['cost']:.6g}", f"{trial['slopes'][k]:+.5g}"]
            )
            for trial in sweep
        ]
        title = f"optimal cost over {name}, the other variables at their optimum"
        tables.append(Table(title, (f"{name} [{variables[name]['unit']}]", "cost", "sensitivity"), points))
    return tables


def write(study: DesignStudy, folder: StrPath) -> dict[str, Any]:
    """Write a study and the plan of its best design; returns the content of ``design.json``.

    Raises:
        ResultError: If the folder cannot be written.
    """
    folder = Path(folder)
    data = to_data(study)
    write_plan(study.plan, folder)
    write_json(folder / DESIGN, data)
    return data
