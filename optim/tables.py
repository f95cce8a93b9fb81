"""A contest as rows of text, for terminals and documents."""

from __future__ import annotations

from typing import Any

import numpy as np

from optim.compare import Contest, Verdict
from optim.objectives import OBJECTIVE
from optim.report import directions, method_data, plain, verdict_data

COST_HEADINGS = ("method", "best", "median", "spread", "rollouts", "gradients", "cost", "time [s]", "ended")
"""Columns of :func:`cost_rows`."""


def unit_of(contest: Contest) -> tuple[float, str]:
    """Factor and unit in which a contest's objective reads well."""
    tuning = contest.problem.scene.scenario.tuning
    if tuning is not None and tuning.objective.kind == "minimax":
        return 1e3, "mm"
    return 1.0, "SI"


def cost_rows(contest: Contest) -> list[list[str]]:
    """What each method reached and spent, the baseline first; lengths in mm where the objective is one."""
    number = _number(unit_of(contest)[0])
    rows = [["untuned", number(float(contest.baseline.nominal[OBJECTIVE])), *[""] * 7]]
    for name, outcome in contest.outcomes.items():
        method = plain(method_data(contest, name))
        objective, used, best = method["objective"], method["spent"], outcome.best
        rows.append(
            [
                name,
                number(best.objective) + ("" if best.feasible else " (infeasible)"),
                number(objective["median"]),
                f"{number(objective['lower'])} .. {number(objective['upper'])}",
                str(used["rollouts"]),
                str(used["gradients"]),
                f"{used['equivalent_rollouts']:.0f}",
                f"{used['wall_s']:.1f}",
                best.message or best.status,
            ]
        )
    return rows


def gain_rows(contest: Contest) -> list[list[str]]:
    """Gains of each method's best, and which of them are at a bound."""
    variables, rows = contest.problem.variables, []
    for name, outcome in contest.outcomes.items():
        values = variables.values(outcome.best.u)
        active = " ".join(contest.active(name)) or "none"
        rows.append([name, *(f"{value:.5g}" for value in values), active])
    return rows


def design_headings(contest: Contest) -> list[str]:
    """Columns of :func:`design_rows`."""
    errors = [where.replace("/tip", "") for where in directions(contest)]
    return ["errors [mm]", *errors, "torque [N m]", "grip [N]", "other plants"]


def design_rows(contest: Contest) -> list[list[str]]:
    """The best designs: largest error by tip and axis, loads, other plants."""
    number, rows = _number(unit_of(contest)[0]), []
    for name, verdict in ({"untuned": contest.baseline} | contest.verdicts).items():
        entry = plain(verdict_data(verdict))
        rows.append([name, *_errors_mm(verdict), *_loads(entry), _plants(entry, number)])
    return rows


def sensitivity_rows(contest: Contest) -> list[list[str]]:
    """Relative change of the objective, to first order, if a variable crossed all of its range."""
    if contest.sensitivity is None:
        return []
    found = contest.sensitivity.over_range
    return [[f"at {where}", *(f"{value:+.1e}" for value in across)] for where, across in found.items()]


def _errors_mm(verdict: Verdict) -> list[str]:
    peaks = verdict.nominal["tip_error_peak"]
    half = len(peaks) // 2
    return [_milli(value) for value in np.maximum(peaks[:half], peaks[half:])]


def _loads(entry: dict[str, Any]) -> list[str]:
    peaks = entry["peaks"]
    keys = ("joint_torque_peak", "grip_force_peak")
    return ["" if peaks.get(key) is None else f"{peaks[key]:.3g}" for key in keys]


def _plants(entry: dict[str, Any], number: Any) -> str:
    other = entry["other_plants"]
    lost = f", {other['diverged']} diverged" if other["diverged"] else ""
    return f"{number(other['objective']['median'])} (worst {number(other['objective']['worst'])}{lost})"


def _number(factor: float) -> Any:
    return lambda value: "diverged" if value is None or not np.isfinite(value) else f"{factor * value:.4g}"


def _milli(value: float | None) -> str:
    return "-" if value is None or not np.isfinite(value) else f"{1e3 * value:.3g}"


def markdown(data: dict[str, Any]) -> str:
    """A comparison, as it stands in ``comparison.json``, as tables for a document.

    Parameters
    ----------
    data
        Content of ``comparison.json``.
    """
    parts = []
    for contest in data["contests"]:
        factor, unit = (1e3, "mm") if contest["objective"]["kind"] == "minimax" else (1.0, "SI")
        number = _number(factor)
        axes = ", ".join(where.replace("/tip", "") for where in contest["directions"])
        heads = ["method", f"best [{unit}]", "median", "quartiles", "rollouts", "gradients", "cost"]
        heads += ["time [s]", "gains", "at a bound", f"errors [mm]: {axes}", "torque [N m]", "grip [N]"]
        heads.append(f"other plants [{unit}]")
        names = ", ".join(contest["variables"])
        rows = [heads, ["---"] * len(heads), ["untuned", number(contest["baseline"]["nominal_objective"])]]
        rows[-1] += [""] * 9 + [*_loads(contest["baseline"]), _plants(contest["baseline"], number)]
        rows += [_markdown_row(name, method, number) for name, method in contest["methods"].items()]
        parts.append(f"**{contest['name']}** (gains: {names})\n")
        parts.append("\n".join("| " + " | ".join(row) + " |" for row in rows) + "\n")
        said = contest["nlp_against_evolutionary"]
        if said is not None:
            parts.append(
                f"NLP over the best of all evolutionary runs: {said['objective_ratio']:.4f}, at "
                f"{said['cost_ratio']:.3f} of their cost.\n"
            )
    return "\n".join(parts)


def _markdown_row(name: str, method: dict[str, Any], number: Any) -> list[str]:
    objective, used, best = method["objective"], method["spent"], method["best"]
    errors = [_milli(found["best"]) for found in method["largest_errors_m"].values()]
    return [
        name,
        number(best["objective"]) + ("" if best["feasible"] else " (infeasible)"),
        number(objective["median"]),
        f"{number(objective['lower'])} .. {number(objective['upper'])}",
        str(used["rollouts"]),
        str(used["gradients"]),
        f"{used['equivalent_rollouts']:.0f}",
        f"{used['wall_s']:.0f}",
        ", ".join(f"{value:.4g}" for value in best["gains"].values()),
        ", ".join(best["active_bounds"]) or "none",
        ", ".join(errors),
        *_loads(best),
        _plants(best, number),
    ]
