"""A comparison of tuning methods in a report: what each found, what it cost, how it holds up."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from spacerobot.errors import ResultError
from spacerobot.result import load
from viz.report import SECTIONS, Section, report
from viz.report_sections import escape, picture, table

COMPARISON = "comparison.json"
DRAWINGS = {
    "convergence_cost": "Best objective so far over cost",
    "convergence_time": "Best objective so far over time",
    "sensitivities": "How far the objective moves if a gain crosses its range",
    "robustness": "Objective on plants never tuned for",
}
HEADINGS = ("method", "best", "median", "on other plants (worst)", "cost [rollouts]", "torque [N m]", "gains")


def comparison_section(folder: Path) -> Section:
    """Section of a report about the comparison in a folder.

    Parameters
    ----------
    folder
        What ``spacerobot compare`` wrote.

    Raises
    ------
    ResultError
        If it holds no comparison that can be shown.
    """
    try:
        contests = _read(folder)["contests"]
        text = "".join(_contest(contest, folder / contest["name"] / "figures") for contest in contests)
    except (OSError, ValueError, KeyError, TypeError) as fault:
        raise ResultError(f"holds no comparison that can be shown: {fault}", source=folder) from None
    return Section("comparison", "Tuning methods, compared", lambda _: text)


def comparison_report(folder: Path) -> str:
    """HTML of a report about a comparison; shown are the first problem's untuned and best designs.

    Raises
    ------
    ResultError
        If the folder holds no comparison that can be shown.
    """
    section = comparison_section(folder)
    contest = _read(folder)["contests"][0]
    best = min(contest["methods"], key=lambda name: contest["methods"][name]["objective"]["best"])
    shown = [load(folder / contest["name"] / name) for name in ("baseline", best)]
    title = f"Tuning methods compared; shown: {contest['name']}, untuned and {best}"
    return report(*shown, title=title, sections=[section, *SECTIONS])


def _read(folder: Path) -> Any:
    return json.loads((folder / COMPARISON).read_text(encoding="utf-8"))


def _contest(contest: Mapping[str, Any], figures: Path) -> str:
    baseline = contest["baseline"]
    rows = [
        ["untuned", _number(baseline["nominal_objective"]), "", _plants(baseline), "", _torque(baseline), ""]
    ]
    for name, method in contest["methods"].items():
        best, objective = method["best"], method["objective"]
        gains = ", ".join(
            f"{gain} {value:.4g}{'*' if gain in best['active_bounds'] else ''}"
            for gain, value in best["gains"].items()
        )
        cost = f"{method['spent']['equivalent_rollouts']:.0f}"
        found = _number(objective["best"]), _number(objective["median"])
        rows.append([name, *found, _plants(best), cost, _torque(best), gains])
    kind, gradient = contest["objective"]["kind"], contest["gradient_cost_rollouts"]
    note = f"Objective: {kind}, in SI units. * at a bound. A gradient counts {gradient:.0f}"
    return (
        f"<h3>{escape(contest['name'])}</h3>{table(HEADINGS, rows)}"
        f"<p>{escape(note)} rollouts, its measured cost.</p>{_drawings(figures)}"
    )


def _number(value: float | None) -> str:
    return "diverged" if value is None else f"{value:.4g}"


def _plants(design: Mapping[str, Any]) -> str:
    others = design.get("other_plants")
    if not others or others["objective"] is None:
        return ""
    return f"{_number(others['objective']['median'])} ({_number(others['objective']['worst'])})"


def _torque(design: Mapping[str, Any]) -> str:
    peaks = design.get("peaks") or {}
    return _number(peaks["joint_torque_peak"]) if "joint_torque_peak" in peaks else ""


def _drawings(figures: Path) -> str:
    text = ""
    for name, title in DRAWINGS.items():
        file = figures / f"{name}.svg"
        if file.is_file():
            text += picture(f"{figures.parent.name}-{name}", title, file.read_bytes())
    return text
