"""Design study: optimal cost over each variable, with the derivatives of the Lagrangian as tangents."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np

from viz.figures.style import COLOURS, Drawing, legend_over, panels, styled

TANGENT = 0.35
"""Half a tangent's width, in distances between two designs."""


@styled
def study(data: Mapping[str, Any]) -> Drawing:
    """Optimal cost over each variable, the others at their optimum.

    Each design has a tangent; refused ones are dotted vertical lines.

    Args:
        data: Data of ``design.json``.
    """
    names = list(data["variables"])
    figure, axes = panels(1, len(names), height_in=2.8)
    for k, (panel, name) in enumerate(zip(axes[0], names, strict=True)):
        variable, sweep = data["variables"][name], data["sweeps"][name]
        good = [trial for trial in sweep if not trial["failure"]]
        places = [trial["values"][k] for trial in good]
        costs = [trial["cost"] for trial in good]
        panel.plot(places, costs, "o", markersize=3.5, color=COLOURS[0], label="optimal cost")
        panel.plot(
            variable["optimum"], data["cost"]["optimum"], "*", markersize=9, color=COLOURS[1], label="optimum"
        )
        steps = [b["values"][k] - a["values"][k] for a, b in itertools.pairwise(sweep)]
        for place, cost, trial in zip(places, costs, good, strict=True):
            best_index = sweep.index(trial)
            half = TANGENT * min(steps[max(best_index - 1, 0) : best_index + 1])
            away = np.linspace(-half, half, 9)  # no straight line over a log scale
            label = "slope" if trial is good[0] else None
            tangent = cost + away * trial["slopes"][k]
            panel.plot(place + away, tangent, color=COLOURS[2], linewidth=1.2, label=label)
        for trial in sweep:
            if trial["failure"]:
                panel.axvline(trial["values"][k], color="#B00020", linewidth=0.9, linestyle=":")
        if variable["scale"] == "log":
            panel.set_xscale("log")
            panel.set_xticks(np.geomspace(variable["lower"], variable["upper"], 3))
            panel.xaxis.set_major_formatter("{x:.3g}")
            panel.xaxis.set_minor_formatter("")
        unit = "" if variable["unit"] == "1" else f" [{variable['unit']}]"
        panel.set(xlabel=f"{name.replace('_', ' ')}{unit}", ylabel="optimal cost" if k == 0 else "")
    axes[0, 0].set_title(f"{data['scenario']}: optimal cost by design")
    legend_over(axes[0, 0], columns=3)
    return figure
