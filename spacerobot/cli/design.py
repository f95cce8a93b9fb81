"""``spacerobot plan --design``: simultaneous optimisation of design and trajectory."""

from __future__ import annotations

from typing import Any

from spacerobot.cli.output import console, pairs, table


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
        cells = []
        for trial in sweep:
            told = [trial["failure"], ""]
            if not trial["failure"]:
                told = [f"{trial['cost']:.6g}", f"{trial['slopes'][k]:+.5g}"]
            cells.append([f"{trial['values'][k]:.6g}", *told])
        title = f"optimal cost over {name}, the other variables at their optimum"
        console().print(
            table(title, [f"{name} [{data['variables'][name]['unit']}]", "cost", "sensitivity"], cells)
        )
