"""Tables of a campaign's summary, for the terminal, pages and notebooks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from optim.campaign.analysis.sentences import (
    cause_of,
    depends,
    drawn,
    failing,
    mixed,
    place_of,
    quantity_of,
    stepping,
    why_worst,
)
from spacerobot.common.tables import Content, Table, unit_scale
from spacerobot.quantities import limited

MARKS = {
    "": ("+", "success"),
    "unclosed": ("O", "open at the start"),
    "diverged": ("D", "diverged"),
    "missed": ("N", "not captured"),
}
"""Letter and meaning of each outcome in the map of a campaign, limits of quantities aside."""


def campaign_content(summary: Mapping[str, Any], *, narrow: bool = False) -> list[Content]:
    """Probabilities of failure, percentiles, sensitivities and worst samples of a campaign.

    Args:
        summary: Data of ``summary.json``.
        narrow: Whether the intervals of percentiles are omitted.
    """
    content: list[Content] = [failing(name, of_set, summary) for name, of_set in summary["gains"].items()]
    content.append(failure_table(summary))
    for name, of_set in summary["gains"].items():
        content.append(percentile_table(name, of_set, summary, narrow=narrow))
        if of_set["plans"] is not None:
            content.append(f"{name}: {plan_text(of_set['plans'])}")
        content.append(f"{name}: sensitivity, as rank correlation or share of the variance")
        content += [depends(metric, entry) for metric, entry in of_set["matters"].items()]
        if of_set["map"] is not None:
            content.append(outcome_table(name, of_set["map"], summary["parameters"]))
        worst = of_set["worst"][0]
        draws = ", ".join(f"{key} {drawn(summary, key, value)}" for key, value in worst["draw"].items())
        why = why_worst(worst) or f"by its {quantity_of(worst['metric'])}"
        content.append(f"{name}: worst sample, {worst['sample']}, {why}: {draws}")
    content += filter(None, (mixed(summary), stepping(summary)))
    if summary["against"]:
        content.append(pair_table(summary))
    return content


def plan_text(plans: Mapping[str, Any]) -> str:
    """Number and solution times of the plans of model predictive control, in words."""
    times = ", ".join(f"{word} {_number(plans[f'{word}_solve_s'])} s" for word in ("median", "longest"))
    without = f", {plans['without_plan']} samples without a first plan" if plans["without_plan"] else ""
    failures = f"{plans['missed']} not found, {plans['unfinished']} flown unconverged{without}"
    return f"{plans['plans']} plans solved in flight, {failures}; solution time {times}"


def marks() -> dict[str, tuple[str, str]]:
    """Letter and meaning of every outcome in the map of a campaign, by its cause."""
    return MARKS | {key: (each.symbol, each.label) for key, each in limited().items() if each.symbol}


def failure_table(summary: Mapping[str, Any]) -> Table:
    """Probability of failure by gains and cause, and that of capture where grasps begin open."""
    gains = summary["gains"]
    causes = list(next(iter(gains.values()))["failure"])
    rows = [
        [name, *(_estimate(entry["failure"][cause], 100) for cause in causes)]
        for name, entry in gains.items()
    ]
    heads = ["gains", *(f"{cause_of(cause)} [%]" for cause in causes)]
    captured = [entry["captured"] for entry in gains.values()]
    if None not in captured:
        heads.append("P(capture) [%]")
        rows = [[*row, _estimate(one, 100)] for row, one in zip(rows, captured, strict=True)]
    level = f"{100 * summary['confidence']:g} %"
    kind = f"probability of failure and its {level} interval" if summary["intervals"] else "share of failures"
    return Table(f"{summary['name']}: {summary['samples']} samples, {summary['design']}; {kind}", heads, rows)


def percentile_table(
    name: str, entry: Mapping[str, Any], summary: Mapping[str, Any], *, narrow: bool = False
) -> Table:
    """Percentiles of every metric with one set of gains, with their intervals unless ``narrow``."""
    metrics = entry["metrics"]
    heads = ["", *(f"{q['percent']:g} %" for q in metrics[0]["percentiles"]), "largest"]
    rows = []
    for row in metrics:
        factor, unit = unit_scale(str(row["unit"]))
        if narrow:
            estimates = [_number(q["value"], factor) for q in row["percentiles"]]
        else:
            estimates = [_estimate(q, factor).replace(" (", "\n(") for q in row["percentiles"]]
        place = f"{place_of(row['metric'], row['of'])} [{unit}]"
        rows.append([place, *estimates, _number(row["largest"], factor)])
    level = f"{100 * summary['confidence']:g} %"
    intervals = f", {level} intervals in brackets (one-sided where the samples give no bound)"
    if narrow:
        intervals = f"; the report has their {level} intervals"
    return Table(f"{name}: percentiles{intervals if summary['intervals'] else ''}", heads, rows)


def outcome_table(name: str, outcomes: Mapping[str, Any], parameters: list[str]) -> Table:
    """Map of the outcome over two parameters, by letters."""
    letters = marks()
    causes = {cause for row in outcomes["failed"] for cause in row}
    legend = ", ".join(f"{letter} {words}" for cause, (letter, words) in letters.items() if cause in causes)
    heads = [f"{parameters[0]} \\ {parameters[1]}", *(f"{value:.4g}" for value in outcomes["second"])]
    rows = [
        [f"{value:.4g}", *(letters.get(cause, ("?",))[0] for cause in row)]
        for value, row in zip(outcomes["first"], outcomes["failed"], strict=True)
    ]
    return Table(f"{name}: outcome over two parameters ({legend})", heads, rows)


def pair_table(summary: Mapping[str, Any]) -> Table:
    """Table that compares pairs of sets of gains on the same samples.

    A row has the percentage of samples with the smaller metric under the first set, or the numbers of samples
    that fail under one set only.
    """
    rows = []
    for row in summary["against"]:
        pair = [row["first"], row["second"]]
        if "fails_alone" in row:
            alone = ", ".join(f"{row['fails_alone'][name]} with {name}" for name in pair)
            rows.append([*pair, "samples that fail with one set alone", alone])
        else:
            better = row["first_is_better"]
            share = "always the same" if better is None else _estimate(better, 100)
            rows.append([*pair, quantity_of(row["metric"]), share])
    level = f"{100 * summary['confidence']:g} %"
    heads = ("first", "second", "", "smaller with the first [% of samples]")
    return Table(f"on the same samples, {level} intervals in brackets", heads, rows)


def _estimate(estimate: Mapping[str, Any], factor: float) -> str:
    """A number times a factor, with its interval if it has one."""
    text = _number(estimate["value"], factor)
    if estimate["low"] is None and estimate["high"] is None:
        return text
    low, high = (_number(estimate[end], factor, "") for end in ("low", "high"))
    return f"{text} ({low}..{high})"


def _number(value: float | None, factor: float = 1.0, missing: str = "no value") -> str:
    return missing if value is None else f"{factor * value:.3g}"
