"""Files of a design study: ``design.json`` and the files of the best design's plan."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from optim.json_values import plain
from optim.planning.output.plan_folder import summary
from optim.planning.output.plan_folder import write as write_plan
from optim.planning.studies.design_study import DesignStudy
from optim.problem.variables import at_bound
from spacerobot.files import StrPath, write_text
from spacerobot.scenario.units import unit_at

DESIGN = "design.json"


def to_data(study: DesignStudy) -> dict[str, Any]:
    """A study, plain; no number where no plan was found."""
    variables = study.variables
    held = at_bound(variables.names, variables.unit(study.found.values))
    variable_data = {
        name: {
            "paths": list(variables.paths[k]),
            "unit": unit_at(study.scene.scenario, variables.paths[k][0]),
            "lower": variables.lower[k],
            "upper": variables.upper[k],
            "scale": "log" if variables.log[k] else "linear",
            "start": variables.start[k],
            "found": study.found.values[k],
            "slope": study.found.slopes[k],
            "where": held.get(name, ""),
        }
        for k, name in enumerate(variables.names)
    }
    data = {
        "scenario": study.scene.scenario.name,
        "variables": variable_data,
        "cost": {"start": study.trials[0].cost, "found": study.found.cost},
        "ended": study.ended,
        "trials": [vars(trial) for trial in study.trials],
        "sweeps": {name: [vars(trial) for trial in sweep] for name, sweep in study.sweeps.items()},
        "plan": summary(study.plan),
    }
    return dict(plain(data))


def write(study: DesignStudy, folder: StrPath) -> dict[str, Any]:
    """Write a study, and the plan of the design that it found; gives what stands in ``design.json``.

    Raises
    ------
    ResultError
        If the folder cannot be written.
    """
    folder = Path(folder)
    data = to_data(study)
    write_plan(study.plan, folder)
    write_text(folder / DESIGN, json.dumps(data, indent=1, allow_nan=False) + "\n")
    return data
