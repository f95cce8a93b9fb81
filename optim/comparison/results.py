"""What a comparison writes: its data, and each method's best design as an ordinary result."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from optim.comparison.benchmark_problem import ProblemComparison
from optim.comparison.compare import Comparison
from optim.comparison.report import to_data
from spacerobot.files import StrPath, write_text
from spacerobot.result import Result, save
from spacerobot.simulation import simulate_designs


def write(comparison: Comparison, folder: StrPath) -> dict[str, Any]:
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
    folder, data = Path(folder), to_data(comparison)
    for contest, found in zip(comparison.contests, data["contests"], strict=True):
        for method, made in results_of(contest):
            result = save(made, folder / contest.name / method)
            entry = found["baseline"] if method == "baseline" else found["methods"][method]["best"]
            entry["result"] = f"{contest.name}/{method}"
            entry["largest_error_checked_m"] = largest_error(result)
            entry["trusted"], entry["open"] = (result.summary["status"][name] for name in ("trusted", "open"))
    write_text(folder / "comparison.json", json.dumps(data, indent=1, allow_nan=False) + "\n")
    return data


def results_of(contest: ProblemComparison) -> Iterator[tuple[str, Result]]:
    """The untuned design and each method's best, if they were judged, simulated at the scenario's own step.

    They share one closed loop, so that they are quick; ``simulate`` on the scenario of one gives the same.
    """
    if contest.baseline is None:
        return
    judged = {"baseline": contest.baseline} | contest.assessments
    designs = {method: assessed.design for method, assessed in judged.items()}
    yield from simulate_designs(contest.nominal.scene, contest.nominal.loop, designs)


def largest_error(result: Result) -> float | None:
    """Largest absolute tip error over tips and axes (m); None if it diverged."""
    if not result.completed:
        return None
    errors = result.summary["tip_error"].values()
    axes = [axis for tip in errors for name, axis in tip.items() if name != "norm"]
    return float(max(max(-axis["min_m"], axis["max_m"]) for axis in axes))
