"""Files of a comparison: its data, and each method's best design as an ordinary result."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from optim.comparison.benchmark_problem import ProblemComparison
from optim.comparison.compare import Comparison
from optim.comparison.report import to_data
from optim.json_files import write_json
from spacerobot.common.files import StrPath
from spacerobot.result import Result
from spacerobot.simulation import simulate_designs


def write(comparison: Comparison, folder: StrPath) -> dict[str, Any]:
    """Write ``comparison.json`` and, under ``problem/method``, each evaluated design as a result.

    Args:
        comparison: Comparison to be written.
        folder: Folder; created if it does not exist.

    Returns:
        dict: The content of ``comparison.json``.

    Raises:
        ResultError: If something cannot be written.
    """
    folder, data = Path(folder), to_data(comparison)
    for benchmark, problem_data in zip(comparison.problems, data["problems"], strict=True):
        for method, method_result in results_of(benchmark):
            result = method_result.save(folder / benchmark.name / method)
            entry = (
                problem_data["baseline"] if method == "baseline" else problem_data["methods"][method]["best"]
            )
            entry["result"] = f"{benchmark.name}/{method}"
            # over tips and axes; none if it diverged
            errors = result.summary["tip_error"].values() if result.completed else ()
            axes = [axis for tip in errors for name, axis in tip.items() if name != "norm"]
            largest = max((max(-axis["min_m"], axis["max_m"]) for axis in axes), default=None)
            entry["largest_error_checked_m"] = None if largest is None else float(largest)
            status = result.summary["status"]
            entry |= {name: status[name] for name in ("trusted", "open", "deep") if name in status}
    write_json(folder / "comparison.json", data)
    return data


def results_of(benchmark: ProblemComparison) -> Iterator[tuple[str, Result]]:
    """Simulations of the untuned design and of each method's best design, with the scenario's step.

    The designs share one closed loop, which saves time; ``simulate`` of a design's scenario gives the same
    result. Empty if the designs were not assessed.

    Yields:
        tuple: ``baseline`` or the name of the method, and the result.
    """
    if benchmark.baseline is None:
        return
    judged = {"baseline": benchmark.baseline} | benchmark.assessments
    designs = {method: assessed.design for method, assessed in judged.items()}
    yield from simulate_designs(benchmark.nominal.scene, benchmark.nominal.loop, designs)
