"""A comparison as data: rows for tables, ``comparison.json``, and a result folder for each method's best."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from optim.compare import Comparison, Contest, Verdict
from optim.evolutionary import METHODS as EVOLUTIONARY
from optim.methods import Outcome
from optim.objectives import OBJECTIVE
from optim.protocol import Array, Cost
from optim.search import Run
from spacerobot.files import write_text
from spacerobot.result import Result, save
from spacerobot.result.dataset import build_dataset
from spacerobot.result.summary import build_summary
from spacerobot.rollout import build_rollout
from spacerobot.scene import build_scene

FORMAT = 1
MOST_MOMENTS = 200  # of each run's history that is kept


def spent(outcome: Outcome) -> Cost:
    """What all runs of a method spent together."""
    return sum((run.cost for run in outcome.runs), Cost())


def claim(contest: Contest) -> dict[str, Any] | None:
    """Whether the NLP is as good as all evolutionary runs at a tenth of their cost, or None."""
    rivals = [contest.outcomes[name] for name in EVOLUTIONARY if name in contest.outcomes]
    if "nlp" not in contest.outcomes or not rivals:
        return None
    nlp = contest.outcomes["nlp"]
    best = min((r.best.objective for r in rivals if r.best.feasible), default=np.nan)
    theirs = sum(spent(r).equivalent(contest.gradient_cost) for r in rivals)
    ours = spent(nlp).equivalent(contest.gradient_cost)
    return {
        "nlp_objective": nlp.best.objective,
        "evolutionary_objective": best,
        "objective_ratio": nlp.best.objective / best,
        "cost_ratio": ours / theirs,
        "met": bool(nlp.best.feasible and nlp.best.objective <= best * (1 + 1e-3) and ours <= 0.1 * theirs),
        "tolerance": 1e-3,
    }


def to_json(comparison: Comparison) -> dict[str, Any]:
    """Everything, as plain values; what is no number is null."""
    found: dict[str, Any] = plain(
        {
            "format": FORMAT,
            "scenario": comparison.scene.scenario.name,
            "interrupted": comparison.interrupted,
            "wall_s": comparison.wall_s,
            "contests": [_contest(contest) for contest in comparison.contests],
        }
    )
    return found


def write(comparison: Comparison, folder: Path, *, results: bool = True) -> dict[str, Result]:
    """Write ``comparison.json`` and, under ``contest/method``, each best design as an ordinary result.

    Parameters
    ----------
    comparison
        What to write.
    folder
        Where; made if it is not there.
    results
        Whether to simulate and save the best designs too, at the scenario's own step.

    Returns
    -------
    dict
        The results by ``contest/method``; a design that diverges has a result up to there.

    Raises
    ------
    ResultError
        If something cannot be written.
    """
    data, found = to_json(comparison), {}
    if results:
        for contest, plain in zip(comparison.contests, data["contests"], strict=True):
            for method, made in results_of(contest):
                name = f"{contest.name}/{method}"
                result = save(made, folder / contest.name / method)
                found[name] = result
                entry = plain["baseline"] if method == "baseline" else plain["methods"][method]["best"]
                entry["result"] = name
                entry["largest_error_checked_m"] = largest_error(result)
    write_text(folder / "comparison.json", json.dumps(data, indent=1, allow_nan=False) + "\n")
    return found


def results_of(contest: Contest) -> Iterator[tuple[str, Result]]:
    """The untuned design and each method's best, simulated anew at the scenario's own step.

    They share one closed loop, so that they are quick; ``simulate`` on the scenario of one gives the same.
    """
    scene, loop = contest.problem.scene, contest.problem.loop
    simulation = scene.scenario.simulation
    rollout = build_rollout(
        loop,
        duration_s=simulation.duration,
        step_s=simulation.step,
        output_step_s=simulation.output_step,
        tolerance=simulation.tolerance,
    )
    for method, verdict in ({"baseline": contest.baseline} | contest.verdicts).items():
        begin = time.perf_counter()
        trajectory = rollout.run(verdict.design)
        own = build_scene(scene.scenario, verdict.design, source=scene.source)
        data = build_dataset(own, trajectory, loop.state_names)
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


def _contest(contest: Contest) -> dict[str, Any]:
    problem, tuning = contest.problem, contest.problem.scene.scenario.tuning
    variables = problem.variables
    return {
        "name": contest.name,
        "reading": contest.reading,
        "set": contest.chosen,
        "objective": tuning.objective.model_dump() if tuning else None,
        "constraints": tuning.constraints.model_dump() if tuning else None,
        "variables": {
            name: {"paths": paths, "lower": a, "upper": b, "log": bool(log)}
            for name, paths, a, b, log in zip(
                variables.names,
                variables.paths,
                variables.lower,
                variables.upper,
                variables.log,
                strict=True,
            )
        },
        "step_s": problem.rollout.grid.step_s,
        "engine": problem.rollout.summary,
        "rollout_core_s": contest.rollout_s,
        "gradient_cost_rollouts": contest.gradient_cost,
        "directions": directions(contest),
        "baseline": verdict_data(contest.baseline),
        "methods": {name: method_data(contest, name) for name in contest.outcomes},
        "nlp_against_evolutionary": claim(contest),
        "sensitivity": None
        if contest.sensitivity is None
        else {"relative": contest.sensitivity.relative, "over_range": contest.sensitivity.over_range},
    }


def directions(contest: Contest) -> list[str]:
    """Tip and axis of each entry of a contest's errors."""
    scene = contest.problem.scene
    return [f"{tip.label} {'xyz'[axis]}" for tip in scene.tips for axis in scene.translation_axes]


def method_data(contest: Contest, name: str) -> dict[str, Any]:
    """What a method found and spent, as it stands in ``comparison.json``."""
    outcome, variables = contest.outcomes[name], contest.problem.variables
    values = np.array([run.objective for run in outcome.searches or outcome.runs])
    cost = spent(outcome)
    return {
        "objective": statistics(values),
        "largest_errors_m": {
            where: statistics(column)
            for where, column in zip(directions(contest), contest.errors[name].T, strict=True)
        },
        "spent": {
            "rollouts": cost.rollouts,
            "gradients": cost.gradients,
            "equivalent_rollouts": cost.equivalent(contest.gradient_cost),
            "wall_s": sum(run.seconds for run in outcome.runs),
        },
        "best": {
            "objective": outcome.best.objective,
            "feasible": outcome.best.feasible,
            "gains": variables.as_mapping(variables.values(outcome.best.u)),
            "active_bounds": contest.active(name),
            "kkt": outcome.best.kkt,
            **verdict_data(contest.verdicts[name]),
        },
        "runs": [_run(contest, run) for run in outcome.runs],
    }


def verdict_data(verdict: Verdict) -> dict[str, Any]:
    """How a design does on the nominal plant and on others, as it stands in ``comparison.json``."""
    peaks = {name: values for name, values in verdict.nominal.items() if name.endswith(("peak", "peak_deg"))}
    varied = verdict.varied[OBJECTIVE]
    finite = varied[np.isfinite(varied)]
    return {
        "nominal_objective": float(verdict.nominal[OBJECTIVE]),
        "peaks": {name: float(np.max(values, initial=0.0)) for name, values in peaks.items()},
        "other_plants": {
            "plants": len(varied),
            "diverged": len(varied) - len(finite),
            "objective": statistics(varied),
            "values": varied,
        },
    }


def _run(contest: Contest, run: Run) -> dict[str, Any]:
    variables = contest.problem.variables
    return {
        "method": run.method,
        "index": run.index,
        "seed": run.seed,
        "objective": run.objective,
        "violation": run.violation,
        "gains": variables.as_mapping(variables.values(run.u)),
        "rollouts": run.cost.rollouts,
        "gradients": run.cost.gradients,
        "slopes": run.cost.slopes,
        "seconds": run.seconds,
        "status": run.status,
        "message": run.message,
        "kkt": run.kkt,
        "history": convergence(run, contest.gradient_cost),
        "log": run.log,
    }


def convergence(run: Run, gradient_cost: float) -> list[tuple[float, float, float]]:
    """Equivalent rollouts, seconds and best objective, wherever it improved; thinned if there are many."""
    kept: list[tuple[float, float, float]] = []
    for moment in run.history:
        if np.isfinite(moment.objective) and (not kept or moment.objective < kept[-1][2]):
            kept.append((moment.cost.equivalent(gradient_cost), moment.seconds, moment.objective))
    if len(kept) > MOST_MOMENTS:
        kept = [kept[i] for i in np.linspace(0, len(kept) - 1, MOST_MOMENTS).astype(int)]
    return kept


def statistics(values: Array) -> dict[str, float | int | None]:
    """Best, median, quartiles and worst; a value that is no number counts as worse than any other."""
    if not len(values):
        return {"best": None, "median": None, "lower": None, "upper": None, "worst": None}
    ranked = np.where(np.isfinite(values), values, np.inf)
    lower, median, upper = np.quantile(ranked, (0.25, 0.5, 0.75), method="nearest")
    return {
        "best": float(ranked.min()),
        "median": float(median),
        "lower": float(lower),
        "upper": float(upper),
        "worst": float(ranked.max()),
    }


def plain(value: Any) -> Any:
    """Plain lists, mappings and numbers, as JSON takes them; what is no number is None."""
    if isinstance(value, dict) or hasattr(value, "items"):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return [plain(item) for item in value.tolist()]
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value
