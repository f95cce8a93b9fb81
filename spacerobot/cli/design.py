"""``spacerobot plan --design``: simultaneous optimisation of design and trajectory."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from spacerobot.cli.output import console, pairs, table

if TYPE_CHECKING:
    from optim.planning.studies.design_study import DesignStudy
    from spacerobot.scene import Scene


def make(scene: Scene, points: int, out: Path | None, **how: Any) -> tuple[DesignStudy, dict[str, Any]]:
    """Make a study; written and drawn if a folder is given."""
    from optim.planning.output.study_folder import to_data, write
    from optim.planning.studies.design_study import make_study

    study = make_study(scene, points, **how)
    if out is None:
        return study, to_data(study)
    from viz.figures.design_study import study as drawn
    from viz.figures.style import write_drawings

    how["progress"]("writing the design and its plan")
    data = write(study, out)
    write_drawings([("design", drawn(data))], out / "figures")
    return study, data


def show(data: dict[str, Any]) -> None:
    """Print the optimum, and the optimal cost over each variable."""
    cost, trials = data["cost"], data["trials"]
    rows = [
        ("optimal cost", f"{cost['start']:.6g} in the scenario, {cost['found']:.6g} at the optimum"),
        ("designs", f"{len(trials)}, {sum(trial['iterations'] for trial in trials)} iterations"),
        ("status", data["ended"]),
    ]
    console().print(pairs(f"design of {data['scenario']}", rows))
    heads = ["variable", "unit", "from", "to", "scenario", "optimum", "sensitivity", ""]
    cells = [
        [
            name,
            one["unit"],
            *(f"{one[key]:.6g}" for key in ("lower", "upper", "start", "found")),
            f"{one['slope']:+.4g}",
            one["where"],
        ]
        for name, one in data["variables"].items()
    ]
    console().print(table("variables", heads, cells))
    for k, (name, sweep) in enumerate(data["sweeps"].items()):
        cells = [_cells(trial, k) for trial in sweep]
        title = f"optimal cost over {name}, the other variables at their optimum"
        console().print(
            table(title, [f"{name} [{data['variables'][name]['unit']}]", "cost", "sensitivity"], cells)
        )


def _cells(trial: dict[str, Any], k: int) -> list[str]:
    value = f"{trial['values'][k]:.6g}"
    if trial["failure"]:
        return [value, trial["failure"], ""]
    return [value, f"{trial['cost']:.6g}", f"{trial['slopes'][k]:+.5g}"]
