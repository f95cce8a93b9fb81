"""Sentence on which method meets the targets at the lowest expected cost, from a comparison's data."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

JUDGED = (0.01, 0.001)  # precisions that the sentence speaks of
Data = Mapping[str, Any]


def conclusion(data: Data) -> str:
    """Sentence on the method that has the lowest expected running time on most problems.

    Args:
        data: A comparison, from :func:`optim.comparison.report.to_data`.

    Returns:
        str: The method, the number of problems, and the exceptions; another sentence if fewer than two
            methods can be ranked.
    """
    judged = [p for p in JUDGED if p in data["precisions"]]
    lowest = {
        (c["name"], p): lowest_of(c, data["precisions"].index(p)) for c in data["problems"] for p in judged
    }
    wins = Counter(method for method in lowest.values() if method is not None)
    named = {name for c in data["problems"] for name, m in c["methods"].items() if m["running_times"]}
    if len(named) < 2 or not wins:
        return "Fewer than two methods were run that can be ranked against each other."
    # the most wins; among equals the one that was run first
    order = [name for c in data["problems"] for name in c["methods"]]
    first = max(wins, key=lambda name: (wins[name], -order.index(name)))
    counts = [
        f"to {percent(p)} on {sum(lowest[c['name'], p] == first for c in data['problems'])}" for p in judged
    ]
    total = len(data["problems"])
    text = (
        f"{first} has the lowest expected running time {' and '.join(counts)} of {total} "
        f"benchmark problem{'s' * (total != 1)} (targets: relative gap to the best known value)"
    )
    others = [
        _elsewhere(benchmark, p, data["precisions"].index(p), first, lowest[benchmark["name"], p])
        for benchmark in data["problems"]
        for p in judged
        if lowest[benchmark["name"], p] != first
    ]
    return f"{text}; elsewhere: {'; '.join(others)}." if others else f"{text}."


def lowest_of(benchmark: Data, target: int) -> str | None:
    """The method with the lowest expected running time to a target, by its number; None if none met it."""
    times = {
        name: method["running_times"][target]["expected"]
        for name, method in benchmark["methods"].items()
        if method["running_times"] and method["running_times"][target]["expected"] is not None
    }
    return min(times, key=times.__getitem__) if times else None


def percent(fraction: float) -> str:
    """A fraction in words: ``1 %``."""
    return f"{100 * fraction:g} %"


def _elsewhere(benchmark: Data, precision: float, target: int, first: str, winner: str | None) -> str:
    """Name the fastest method of one problem, and why the overall winner is slower."""
    where = f"{benchmark['name']} to {percent(precision)}"
    if winner is None:
        return f"{where}, no method"
    ahead = benchmark["methods"][winner]["running_times"][target]
    if first not in benchmark["methods"] or not benchmark["methods"][first]["running_times"]:
        return f"{where}, {winner} ({first} was not run)"
    behind = benchmark["methods"][first]["running_times"][target]
    # the larger part of the cost: runs that meet the target, or runs that do not
    if not behind["met"]:
        return f"{where}, {winner} ({first} reaches it in none of {behind['runs']} runs)"
    unit = "rollout" if f"{ahead['expected']:.0f}" == "1" else "rollouts"
    text = f"{ahead['expected']:.0f} {unit} against {behind['expected']:.0f}: "
    wasted = [time["expected"] - time["until_met"] for time in (ahead, behind)]
    if wasted[1] - wasted[0] > behind["until_met"] - ahead["until_met"]:
        text += f"{first} reaches it in {behind['met']} of {behind['runs']} runs, {winner} in {ahead['met']}"
        text += f" of {ahead['runs']}"
    else:
        text += f"runs of {first} take longer to reach the target"
    overlap = ahead["high"] is None or behind["low"] is None or behind["low"] <= ahead["high"]
    return f"{where}, {winner} ({text}{', intervals overlap' if overlap else ''})"
