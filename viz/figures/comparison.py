"""Figures of a comparison of tuning methods, from the data of ``comparison.json``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from spacerobot.common.files import write_bytes
from viz.figures import Drawing, robustness, sensitivities, to_bytes
from viz.figures.tuning import convergence, data_profiles, running_times

Data = Mapping[str, Any]
PROFILES = "data_profiles"


def write_figures(data: Data, folder: Path) -> None:
    """Write the data profiles to ``figures``, and each problem's figures to ``problem/figures``, as SVG.

    Raises:
        ResultError: If a file cannot be written.
    """
    profiles = data["profiles"]
    if profiles["methods"]:
        figure = data_profiles(profiles["budgets"], profiles["methods"])
        write_bytes(folder / "figures" / f"{PROFILES}.svg", to_bytes(figure, "svg"))
    for benchmark in data["problems"]:
        for name, figure in figures_of(benchmark, data["precisions"]):
            write_bytes(folder / benchmark["name"] / "figures" / f"{name}.svg", to_bytes(figure, "svg"))


def figures_of(benchmark: Data, precisions: list[float]) -> Iterator[tuple[str, Drawing]]:
    """Figures of one problem, with their names: running times, convergence, and properties of the designs."""
    ranked = {name: method for name, method in benchmark["methods"].items() if method["running_times"]}
    if ranked:
        times = {
            name: [[time[k] for k in ("expected", "low", "high")] for time in method["running_times"]]
            for name, method in ranked.items()
        }
        yield "running_times", running_times(times, targets=[f"{100 * p:g} %" for p in precisions])
        best = benchmark["best_known"]
        # cost and distance from the best known value, relative to it
        gaps = {
            name: [
                [(cost, (value - best) / abs(best) if best else value) for cost, value in trial["history"]]
                for trial in method["trials"]
            ]
            for name, method in ranked.items()
        }
        ends = {name: [trial["spent"] for trial in m["trials"]] for name, m in ranked.items()}
        yield "convergence", convergence(gaps, targets=precisions, ends=ends)
    if benchmark["sensitivity"] is not None:
        shares = {
            where: np.array(values, dtype=float)
            for where, values in benchmark["sensitivity"]["over_range"].items()
        }
        yield "sensitivities", sensitivities(list(benchmark["variables"]), shares, quantity="the objective")
    if benchmark["baseline"] is not None:
        factor, unit = benchmark["unit"]["factor"], benchmark["unit"]["name"]
        designs = {"untuned": benchmark["baseline"]}
        designs |= {name: method["best"] for name, method in benchmark["methods"].items()}
        samples = {
            name: factor * np.array(design["other_plants"]["values"], dtype=float)
            for name, design in designs.items()
        }
        yield "robustness", robustness(samples, quantity="objective", unit=unit)
