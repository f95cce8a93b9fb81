"""Tables printed by ``spacerobot campaign``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from spacerobot.cli.output import console, prose, table, warn

MARKS = {
    "": ("+", "success"),
    "unclosed": ("O", "open at the start"),
    "diverged": ("D", "diverged"),
    "missed": ("N", "not captured"),
}
"""Letter and meaning of each outcome in the map of a campaign, limits of quantities aside."""


def marks() -> dict[str, tuple[str, str]]:
    """Letter and meaning of every outcome in the map of a campaign, by its cause."""
    from spacerobot.quantities import limited

    return MARKS | {key: (each.symbol, each.label) for key, each in limited().items() if each.symbol}


def show(summary: Mapping[str, Any]) -> None:
    """Print the results of a campaign: probability of failure, percentiles, sensitivities, worst samples."""
    from viz.report.campaign_text import (
        depends,
        drawn,
        failing,
        mixed,
        quantity_of,
        stepping,
        unfinished,
        why_worst,
    )

    for name, told in summary["gains"].items():
        prose(failing(name, told, summary))
    level = f"{100 * summary['confidence']:g} %"
    for warning in (unfinished(summary), *summary["doubts"]):
        if warning:
            warn(warning)
    head = f"{summary['name']}: {summary['samples']} samples, {summary['design']}"
    asked = (
        f"probability of failure and its {level} interval" if summary["intervals"] else "share of failures"
    )
    console().print(table(f"{head}; {asked}", *_failures(summary)))
    for name, told in summary["gains"].items():
        sure = f", {level} intervals in brackets (one-sided where the samples give no bound)"
        title = f"{name}: percentiles{sure if summary['intervals'] else ''}"
        console().print(table(title, *_percentiles(told)))
        if told["plans"] is not None:
            # plans of model predictive control
            made = told["plans"]
            times = ", ".join(
                f"{word} {_number(made[f'{word}_solve_s'], 1.0)} s" for word in ("median", "longest")
            )
            failures = f"{made['missed']} not found, {made['unfinished']} flown unconverged"
            none = f", {made['without_plan']} samples without a first plan" if made["without_plan"] else ""
            flown = f"{made['plans']} plans solved in flight, {failures}{none}"
            prose(f"{name}: {flown}; solution time {times}")
        prose(f"{name}: sensitivity, as rank correlation or share of the variance")
        for metric, entry in told["matters"].items():
            prose(depends(metric, entry), indent=2)
        if told["map"] is not None:
            found = {cause for row in told["map"]["failed"] for cause in row}
            legend = ", ".join(
                f"{letter} {words}" for cause, (letter, words) in marks().items() if cause in found
            )
            title = f"{name}: outcome over two parameters ({legend})"
            console().print(table(title, *_map(told["map"], summary["parameters"])))
        worst = told["worst"][0]
        draws = ", ".join(f"{key} {drawn(summary, key, value)}" for key, value in worst["draw"].items())
        why = why_worst(worst) or f"by its {quantity_of(worst['metric'])}"
        console().print()
        prose(f"{name}: worst sample, {worst['sample']}, {why}: {draws}")
        # to be copied as one line
        console().print(f"reproduce: {worst['command']}\n", markup=False, soft_wrap=True)
    for note in filter(None, (mixed(summary), stepping(summary))):
        prose(note)
        console().print()
    if summary["against"]:
        console().print(table(f"on the same samples, {level} intervals in brackets", *_against(summary)))


Rows = tuple[list[str], list[list[str]]]


def _failures(summary: Mapping[str, Any]) -> Rows:
    causes = list(next(iter(summary["gains"].values()))["failure"])
    rows = [
        [name, *(_estimate(told["failure"][cause], "%", 100) for cause in causes)]
        for name, told in summary["gains"].items()
    ]
    head = ["gains", *(f"{cause} [%]" for cause in causes)]
    captured = [told["captured"] for told in summary["gains"].values()]
    if None not in captured:
        head.append("P(capture) [%]")
        rows = [[*row, _estimate(one, "%", 100)] for row, one in zip(rows, captured, strict=True)]
    return head, rows


def _percentiles(told: Mapping[str, Any]) -> Rows:
    from viz.report.campaign_text import place_of

    metrics = told["metrics"]
    head = ["", *(f"{q['percent']:g} %" for q in metrics[0]["percentiles"]), "largest"]
    rows = []
    for row in metrics:
        told_of = [_estimate(q, row["unit"]).replace(" (", "\n(") for q in row["percentiles"]]
        largest = _number(row["largest"], _factor(row["unit"]))
        unit = "mm" if row["unit"] == "m" else str(row["unit"])
        rows.append([f"{place_of(row['metric'], row['of'])} [{unit}]", *told_of, largest])
    return head, rows


def _map(told: Mapping[str, Any], parameters: list[str]) -> Rows:
    letters = marks()
    head = [f"{parameters[0]} \\ {parameters[1]}", *(f"{value:.4g}" for value in told["second"])]
    rows = [
        [f"{value:.4g}", *(letters.get(cause, ("?",))[0] for cause in causes)]
        for value, causes in zip(told["first"], told["failed"], strict=True)
    ]
    return head, rows


def _against(summary: Mapping[str, Any]) -> Rows:
    from viz.report.campaign_text import quantity_of

    rows = []
    for row in summary["against"]:
        two = [row["first"], row["second"]]
        if "fails_alone" in row:
            rows.append([*two, "fails only here", " / ".join(str(row["fails_alone"][name]) for name in two)])
        elif row["first_is_better"] is not None:
            rows.append([*two, quantity_of(row["metric"]), _estimate(row["first_is_better"], "%", 100)])
    return ["first", "second", "", "first is smaller [%], or samples that fail only here"], rows


def _estimate(told: Mapping[str, Any], unit: str, factor: float | None = None) -> str:
    scale = _factor(unit) if factor is None else factor
    text = _number(told["value"], scale)
    if told["low"] is None and told["high"] is None:
        return text
    low, high = (_number(told[end], scale, "") for end in ("low", "high"))
    return f"{text} ({low}..{high})"


def _number(value: float | None, factor: float, nothing: str = "no value") -> str:
    return nothing if value is None else f"{factor * value:.3g}"


def _factor(unit: str) -> float:
    return 1e3 if unit == "m" else 1.0
