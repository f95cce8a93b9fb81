"""Figure of the feasible range of one number of a scenario: optimal cost and use of limits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from viz.figures.style import COLOURS, DASHES, Drawing, legend_over, panels, styled

MAX_DRIVES = 5
"""Number of drives in the figure, those closest to their limits."""
INFEASIBLE_COLOUR = "#B00020"


@styled
def feasible_range(data: Mapping[str, Any]) -> Drawing:
    """Figure of the optimal cost with slopes, and of the drives' use of limits; infeasible values as lines.

    Args:
        data: ``scenario``, ``axis`` (label of the number) and ``rows``: for each ``value`` whether it is
            ``feasible``; then ``cost``, ``slope`` and ``used`` (share of its limit by drive).
    """
    figure, axes = panels(1, 2, height_in=2.8)
    rows = sorted(data["rows"], key=lambda row: float(row["value"]))
    good = [row for row in rows if row["feasible"]]
    values = np.array([row["value"] for row in good])
    cost, use = axes[0]
    cost.plot(values, [row["cost"] for row in good], "o", markersize=3.5, color=COLOURS[0], label="feasible")
    gaps = np.diff(values, prepend=2 * values[0] - values[1], append=2 * values[-1] - values[-2])
    for row, half in zip(good, 0.25 * np.minimum(gaps[:-1], gaps[1:]), strict=True):
        ends = np.array([-half, half])
        label = "slope" if row is good[0] else None
        cost.plot(row["value"] + ends, row["cost"] + row["slope"] * ends, color=COLOURS[2], label=label)
    largest = {name: max(row["used"][name] for row in good) for name in good[0]["used"]}
    for k, name in enumerate(sorted(largest, key=lambda name: -largest[name])[:MAX_DRIVES]):
        look: dict[str, Any] = {"color": COLOURS[k], "linestyle": DASHES[k % len(DASHES)]}
        use.plot(values, [row["used"][name] for row in good], label=name.rpartition("/")[2], **look)
    for panel in (cost, use):
        for k, row in enumerate(row for row in rows if not row["feasible"]):
            label = "none found" if k == 0 and panel is cost else None
            panel.axvline(row["value"], color=INFEASIBLE_COLOUR, linewidth=0.9, linestyle=":", label=label)
        panel.set(xlabel=data["axis"])
    cost.set(ylabel="optimal cost", yscale="log")
    cost.yaxis.set_major_formatter("{x:g}")
    cost.yaxis.set_minor_formatter("{x:g}")
    use.set(ylabel="largest force or torque / its limit")
    cost.set_title(f"{data['scenario']}: optimal cost")
    use.set_title("Use of limits")
    legend_over(cost, columns=3)
    legend_over(use, columns=2)
    return figure
