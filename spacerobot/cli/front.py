"""``spacerobot plan --pareto``: the Pareto front of two terms of a plan's cost."""

from __future__ import annotations

import math
from typing import Any

from spacerobot.cli.output import console, table


def show(data: dict[str, Any]) -> None:
    """Print a row for each point, and why those that are refused are."""
    units = {name: data["units"][name] for name in data["terms"]}
    shown = {name: ("deg", math.degrees(1)) if unit == "rad" else (unit, 1.0) for name, unit in units.items()}
    heads = [
        "point",
        *(f"{data['headings'][name]} [{shown[name][0]}]" for name in data["terms"]),
        "cost",
        "intervals",
    ]
    rows = []
    for point in data["points"]:
        found = point.get("plan")
        values = point["values"]
        cells = [f"{values[name] * shown[name][1]:.5g}" if name in values else "" for name in data["terms"]]
        told = [f"{found['cost']:.6g}", f"{found['intervals']}"] if found else ["", ""]
        if point["status"] != "refused":
            words = "" if point["status"] == "efficient" else "dominated"
        else:
            where = ", ".join(f"{path} {value:.4g}" for path, value in point["changes"].items())
            words = f"refused ({where}): {point['failure']}"
        rows.append([point["name"], *cells, *told, words])
    title = f"Pareto front of {data['scenario']}"
    console().print(table(title, [*heads, ""], rows))
