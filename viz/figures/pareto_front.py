"""The Pareto front of two terms of a plan's cost."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from spacerobot.common.tables import unit_scale
from viz.figures.style import COLOURS, Drawing, legend_over, panels, styled


@styled
def front(data: Mapping[str, Any]) -> Drawing:
    """One term over the other: plans on the front as a line, dominated ones hollow, refused ones dotted.

    Args:
        data: Data of ``front.json``.
    """
    figure, axes = panels(1, 1, height_in=2.8)
    panel, names = axes[0, 0], data["terms"]
    scales = [unit_scale(data["units"][name]) for name in names]
    points = data["points"]

    def places(status: str) -> list[list[float]]:
        """Values of both terms for the points of a status."""
        rows = [p["values"] for p in points if p["status"] == status]
        return [[row[name] * scale for row in rows] for name, (scale, _) in zip(names, scales, strict=True)]

    first, second = places("efficient")
    order = sorted(range(len(first)), key=first.__getitem__)
    panel.plot(
        [first[k] for k in order],
        [second[k] for k in order],
        marker="o",
        markersize=4,
        color=COLOURS[0],
        label="on the front",
    )
    if any(p["status"] == "dominated" for p in points):
        look: dict[str, Any] = {"linestyle": "", "marker": "o", "markersize": 4, "fillstyle": "none"}
        panel.plot(*places("dominated"), color=COLOURS[1], label="dominated", **look)
    refused = [p["changes"].get("plan.duration") for p in points if p["status"] == "refused"]
    for k, duration in enumerate(refused):
        if duration is not None and names[0] == "time":
            label = "refused" if k == 0 else None
            panel.axvline(duration, color="#B00020", linewidth=0.9, linestyle=":", label=label)
    for point in points:
        if point["status"] != "refused":
            at = [point["values"][name] * scale for name, (scale, _) in zip(names, scales, strict=True)]
            panel.annotate(
                point["name"].rpartition("_")[2], at, (3, 3), textcoords="offset points", fontsize=7
            )
    for name, (_, unit), side in zip(names, scales, ("x", "y"), strict=True):
        panel.set(**{f"{side}label": f"{data['headings'][name]} [{unit}]"})
    panel.set_title(f"{data['scenario']}: {' and '.join(name.replace('_', ' ') for name in names)}")
    legend_over(panel, columns=3)
    return figure
