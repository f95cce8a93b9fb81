"""A comparison as plain data: the content of ``comparison.json``, from which tables and figures are made."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from optim.comparison.benchmark_problem import Assessment, ProblemComparison
from optim.comparison.compare import Comparison
from optim.comparison.conclusion import conclusion
from optim.comparison.profiles import budgets_of, profile
from optim.comparison.running_time import LEVEL, PRECISIONS, running_time, target_of
from optim.comparison.statistics import statistics
from optim.json_files import plain
from optim.methods.run_method import MethodOutcome
from optim.problem.objectives import OBJECTIVE, reading
from optim.problem.problem import EvaluationCost
from spacerobot.common.arrays import Array
from spacerobot.common.registry import TUNING_METHODS

FORMAT = 3
MOST_MOMENTS = 200  # of each trial's history that are kept


def to_data(comparison: Comparison) -> dict[str, Any]:
    """The comparison as plain values; null where a number is not finite."""
    # data profiles of the ranked methods over the problems that they took part in
    hits: dict[str, list[Array]] = {}
    for benchmark in comparison.problems:
        targets = _targets(benchmark)
        for name in benchmark.ranked:
            table = [[trial.hit(target) for target in targets] for trial in benchmark.trials(name)]
            if table:
                hits.setdefault(name, []).append(np.array(table))
    budgets = budgets_of(hits)
    profiles_by_problem = {name: asdict(profile(tables, budgets)) for name, tables in hits.items()}
    for one in profiles_by_problem.values():
        del one["budgets"]
    profiles = {"budgets": budgets, "methods": profiles_by_problem}
    data = {
        "format": FORMAT,
        "name": comparison.name,
        "interrupted": comparison.interrupted,
        "wall_s": comparison.wall_s,
        "precisions": PRECISIONS,
        "interval": LEVEL,
        "problems": [_benchmark(benchmark) for benchmark in comparison.problems],
        "profiles": profiles,
    }
    document: dict[str, Any] = plain(data)
    return {"conclusion": conclusion(document), **document}


def spent(outcome: MethodOutcome) -> EvaluationCost:
    """Cost of all runs of a method together."""
    return sum((run.cost for run in outcome.runs), EvaluationCost())


def directions(benchmark: ProblemComparison) -> list[str]:
    """Tip and axis of each entry of a problem's errors."""
    scene = benchmark.nominal.scene
    return [f"{tip.label} {'xyz'[axis]}" for tip in scene.tips for axis in scene.translation_axes]


def _targets(benchmark: ProblemComparison) -> list[float]:
    return [target_of(benchmark.best_known, precision) for precision in PRECISIONS]


def _benchmark(benchmark: ProblemComparison) -> dict[str, Any]:
    nominal, variables = benchmark.nominal, benchmark.nominal.variables
    tuning = nominal.scene.scenario.tuning
    _, factor, unit = reading(tuning.objective) if tuning is not None else (OBJECTIVE, 1.0, "SI")
    return {
        "name": benchmark.name,
        "objective": tuning.objective.model_dump() if tuning else None,
        "unit": {"factor": factor, "name": unit},
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
        "step_s": nominal.rollout.grid.step_s,
        "engine": nominal.rollout.summary,
        "cost_unit": asdict(benchmark.cost_unit),
        "compile_or_load": asdict(benchmark.readiness),
        "directions": directions(benchmark),
        "start_objective": benchmark.start,
        "best_known": benchmark.best_known,
        "targets": _targets(benchmark),
        "baseline": None if benchmark.baseline is None else _assessment(benchmark.baseline),
        "methods": {name: _method(benchmark, name) for name in benchmark.outcomes},
        "sensitivity": None
        if benchmark.sensitivity is None
        else {"relative": benchmark.sensitivity.relative, "over_range": benchmark.sensitivity.over_range},
    }


def _method(benchmark: ProblemComparison, name: str) -> dict[str, Any]:
    """Results and costs of one method."""
    outcome, variables = benchmark.outcomes[name], benchmark.nominal.variables
    values = np.array([run.objective for run in outcome.runs])
    best, assessed = outcome.best, benchmark.assessments.get(name)
    ranked = name in benchmark.ranked
    trials = benchmark.trials(name) if ranked else []
    # a trial as it is drawn: cost and best objective wherever it improved, thinned if there are many
    curves = []
    for trial in trials:
        history = np.column_stack([trial.costs, trial.objectives])
        indices = np.unique(np.linspace(0, max(len(history) - 1, 0), MOST_MOMENTS).astype(int))
        curves.append({"spent": trial.spent, "history": history[indices[: len(history)]]})
    cost, wall_s = spent(outcome), sum(run.seconds for run in outcome.runs)
    ready = benchmark.readiness
    readied_s = ready.rollout_s + (
        ready.gradient_s if TUNING_METHODS.find(outcome.method).uses_gradients else 0.0
    )
    effort = {
        "equivalent_rollouts": benchmark.cost_unit.rollouts(cost),
        **asdict(cost),
        "wall_s": wall_s,
        "wall_with_compilation_s": wall_s + readied_s,
    }
    return {
        "ranked": ranked,
        "running_times": [asdict(running_time(trials, target)) for target in _targets(benchmark)]
        if trials
        else [],
        "objective": statistics(values),
        "largest_errors_m": {
            where: statistics(column)
            for where, column in zip(directions(benchmark), benchmark.errors[name].T, strict=True)
        },
        "spent": effort,
        "best": {
            "objective": best.objective,
            "feasible": best.feasible,
            "gains": variables.as_mapping(variables.values(best.u)),
            "active_bounds": benchmark.active(name),
            "kkt": best.kkt,
            "status": best.status,
            "message": best.message,
            **({} if assessed is None else _assessment(assessed)),
        },
        "trials": curves,
        "runs": [
            {
                "method": run.method,
                "index": run.index,
                "seed": run.seed,
                "objective": run.objective,
                "violation": run.violation,
                "gains": variables.as_mapping(variables.values(run.u)),
                "equivalent_rollouts": benchmark.cost_unit.rollouts(run.cost),
                **asdict(run.cost),
                "seconds": run.seconds,
                "status": run.status,
                "message": run.message,
                "kkt": run.kkt,
                "log": run.log,
            }
            for run in outcome.runs
        ],
    }


def _assessment(assessment: Assessment) -> dict[str, Any]:
    """Convert the results of a design on the nominal plant and on others."""
    peaks = {
        name: values for name, values in assessment.nominal.items() if name.endswith(("peak", "peak_deg"))
    }
    varied = assessment.varied[OBJECTIVE]
    finite = varied[np.isfinite(varied)]
    return {
        "nominal_objective": float(assessment.nominal[OBJECTIVE]),
        "peaks": {name: float(np.max(values, initial=0.0)) for name, values in peaks.items()},
        "other_plants": {
            "plants": len(varied),
            "diverged": len(varied) - len(finite),
            "objective": statistics(varied),
            "values": varied,
        },
    }
