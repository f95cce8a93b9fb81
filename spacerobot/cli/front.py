"""``spacerobot plan --pareto``: the Pareto front of two terms of a plan's cost."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from spacerobot.cli.output import console, table

if TYPE_CHECKING:
    from optim.planning.studies.pareto_front import FrontRequest
    from spacerobot.scene import Scene


def wanted_front(terms: str, points: int) -> FrontRequest:
    """Which front is wanted, from two names between commas.

    Raises
    ------
    ScenarioError
        If these are not two.
    """
    from optim.planning.studies.pareto_front import FrontRequest
    from spacerobot.errors import ScenarioError

    names = tuple(part.strip() for part in terms.split(","))
    if len(names) != 2:
        message = f"found {terms!r}, allowed: two terms of the cost, as time,base_rotation"
        raise ScenarioError(message, where="--pareto")
    return FrontRequest(names, points)


def make(scene: Scene, wanted: FrontRequest, out: Path | None, **how: Any) -> dict[str, Any]:
    """Plan all points; written and drawn if a folder is given."""
    from optim.planning.output.front_folder import to_data, write
    from optim.planning.studies.pareto_front import make_front

    front = make_front(scene, wanted, **how)
    if out is None:
        return to_data(front)
    from viz.figures.pareto_front import front as drawn
    from viz.figures.style import write_drawings

    how["progress"]("writing the plans")
    data = write(front, out)
    write_drawings([("front", drawn(data))], out / "figures")
    return data


def show(data: dict[str, Any]) -> None:
    """Print a row for each point, and why those that are refused are."""
    heads = [
        "point",
        *(_head(data["headings"][name], data["units"][name]) for name in data["terms"]),
        "cost",
        "intervals",
    ]
    rows = []
    for point in data["points"]:
        found = point.get("plan")
        cells = [_value(point["values"], name, data["units"][name]) for name in data["terms"]]
        told = [f"{found['cost']:.6g}", f"{found['intervals']}"] if found else ["", ""]
        if point["status"] != "refused":
            words = "" if point["status"] == "efficient" else "dominated"
        else:
            where = ", ".join(f"{path} {value:.4g}" for path, value in point["changes"].items())
            words = f"refused ({where}): {point['failure']}"
        rows.append([point["name"], *cells, *told, words])
    title = f"Pareto front of {data['scenario']}"
    console().print(table(title, [*heads, ""], rows))


def _head(words: str, unit: str) -> str:
    return f"{words} [{'deg' if unit == 'rad' else unit}]"


def _value(values: dict[str, float], name: str, unit: str) -> str:
    import math

    if name not in values:
        return ""
    return f"{math.degrees(values[name]) if unit == 'rad' else values[name]:.5g}"
