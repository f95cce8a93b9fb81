"""What a comparison writes: its data, and each method's best design as an ordinary result."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from optim.comparison.compare import Comparison
from optim.comparison.contest import Contest
from optim.comparison.report import to_data
from spacerobot.files import write_text
from spacerobot.result import Result, save
from spacerobot.result.dataset import build_dataset
from spacerobot.result.summary import build_summary
from spacerobot.rollout import build_rollout
from spacerobot.scene import build_scene


def write(comparison: Comparison, folder: Path) -> dict[str, Any]:
    """Write ``comparison.json`` and, under ``contest/method``, each design that was judged, as a result.

    Parameters
    ----------
    comparison
        What to write.
    folder
        Where; made if it is not there.

    Returns
    -------
    dict
        What stands in ``comparison.json``.

    Raises
    ------
    ResultError
        If something cannot be written.
    """
    data = to_data(comparison)
    for contest, found in zip(comparison.contests, data["contests"], strict=True):
        for method, made in results_of(contest):
            result = save(made, folder / contest.name / method)
            entry = found["baseline"] if method == "baseline" else found["methods"][method]["best"]
            entry["result"] = f"{contest.name}/{method}"
            entry["largest_error_checked_m"] = largest_error(result)
    write_text(folder / "comparison.json", json.dumps(data, indent=1, allow_nan=False) + "\n")
    return data


def results_of(contest: Contest) -> Iterator[tuple[str, Result]]:
    """The untuned design and each method's best, if they were judged, simulated at the scenario's own step.

    They share one closed loop, so that they are quick; ``simulate`` on the scenario of one gives the same.
    """
    if contest.baseline is None:
        return
    scene, loop = contest.nominal.scene, contest.nominal.loop
    simulation = scene.scenario.simulation
    rollout = build_rollout(
        loop,
        duration_s=simulation.duration,
        step_s=simulation.step,
        output_step_s=simulation.output_step,
        tolerance=simulation.tolerance,
        method=simulation.method,
    )
    for method, assessed in ({"baseline": contest.baseline} | contest.assessments).items():
        begin = time.perf_counter()
        trajectory = rollout.run(assessed.design)
        own = build_scene(scene.scenario, assessed.design, source=scene.source)
        data = build_dataset(own, trajectory, loop)
        timing = {"closed_loop": 0.0, "compile_or_load": 0.0, "rollout": trajectory.wall_s}
        timing["total"] = time.perf_counter() - begin
        summary = build_summary(own, data, trajectory, timing, {"toolchain": rollout.summary})
        yield method, Result(own.scenario, data, summary)


def largest_error(result: Result) -> float | None:
    """Largest absolute tip error over tips and axes (m); None if it diverged."""
    if not result.completed:
        return None
    errors = result.summary["tip_error"].values()
    axes = [axis for tip in errors for name, axis in tip.items() if name != "norm"]
    return float(max(max(-axis["min_m"], axis["max_m"]) for axis in axes))
