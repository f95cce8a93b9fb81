"""Sentences of a campaign's summary."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from spacerobot.common.tables import unit_scale
from spacerobot.quantities import limited, quantities

HOW = {
    "rises": "grows with {}",
    "falls": "falls as {} grows",
    "away": "grows as {} departs from the middle of its range",
    "middle": "falls as {} departs from the middle of its range",
    "share": "varies with {}",
}
SAID = 4  # parameters that a sentence names
CAUSES = {
    "any": "any cause",
    "unclosed": "grasp open at the start",
    "diverged": "divergence",
    "missed": "missed capture",
}
"""Causes of failure that are no limits."""


def quantity_of(metric: str) -> str:
    """Name of a metric's quantity as text."""
    if metric == "missed":
        return "probability of a miss"
    registry = quantities()
    return registry[metric].label if metric in registry else metric.replace("_", " ")


def place_of(metric: str, of: str) -> str:
    """Name of a metric's quantity, followed by its robot, tip or grasp."""
    return quantity_of(metric) if of == "target" else f"{quantity_of(metric)}, {of}"


def with_gains(name: str) -> str:
    """Beginning of a sentence about a set of gains."""
    return "With the scenario's own gains" if name == "scenario" else f"With the gains {name}"


def failing(name: str, statistics: Mapping[str, Any], summary: Mapping[str, Any]) -> str:
    """Failure rate of a set of gains and its causes; without failures, what counts as one."""
    any_, causes = statistics["failure"]["any"], statistics["failure"]
    head = f"{with_gains(name)}, {any_['count']} of {summary['samples']} samples fail"
    if any_["low"] is not None:
        low, high = (f"{100 * any_[end]:.3g}" for end in ("low", "high"))
        sure = f"{100 * summary['confidence']:g} %"
        head += f": the probability of failure is between {low} and {high} %, with {sure} confidence"
    words = {
        "unclosed": "by a grasp that does not close at the start",
        "diverged": "diverged",
        "missed": "by a capture that was missed",
        "target_rotation_deg": "by the target's rotation",
        "base_rotation_deg": "by a base's rotation",
    }
    counts = {cause: entry["count"] for cause, entry in causes.items() if cause != "any" and entry["count"]}
    parts = [f"{n} {words.get(cause, 'by ' + cause.replace('_', ' '))}" for cause, n in counts.items()]
    if parts:
        return f"{head}. Of them: {', '.join(parts)}."
    return f"{head}." if summary["limits"] else f"{head}. {failure_criteria(summary)}"


def failure_criteria(summary: Mapping[str, Any]) -> str:
    """Sentence on the definition of failure in a campaign."""
    causes = next(iter(summary["gains"].values()))["failure"]
    limits = ", ".join(limit_of(name, value) for name, value in summary["limits"].items())
    parts = ["diverges"]
    parts += ["misses a capture"] if "missed" in causes else []
    parts += [f"exceeds a limit ({limits})"] if limits else []
    text = f"A sample fails if it {' or '.join(parts)}"
    return f"{text}." if limits else f"{text}; `campaign.limits` is empty."


def limit_of(name: str, value: float) -> str:
    """A limit of a campaign with its quantity and unit, ``peak grip force 20 N``."""
    quantity = limited().get(name)
    if quantity is None:  # a quantity of a plugin that is not loaded
        return f"{name} {value:g}"
    if name.endswith("_deg"):
        return f"{quantity.label} {value:g} deg"
    factor, unit = unit_scale(quantity.unit)
    return f"{quantity.label} {factor * value:g} {unit}"


def cause_of(name: str) -> str:
    """Heading of a cause of failure in tables."""
    return CAUSES.get(name) or (limited()[name].label if name in limited() else name.replace("_", " "))


def capturing(name: str, statistics: Mapping[str, Any], summary: Mapping[str, Any]) -> str | None:
    """Capture rate of all grasps that begin open, under a set of gains; None without such grasps."""
    captured = statistics["captured"]
    if captured is None:
        return None
    text = f"{with_gains(name)}, {captured['count']} of {summary['samples']} samples capture"
    if captured["low"] is None:
        return f"{text}."
    low, high = (f"{100 * captured[end]:.3g}" for end in ("low", "high"))
    sure = f"{100 * summary['confidence']:g} %"
    return f"{text}: P(capture) is between {low} and {high} %, with {sure} confidence."


def depends(metric: str, entry: Mapping[str, Any]) -> str:
    """Dependence of a metric on the parameters, strongest first."""
    subject = f"The {quantity_of(metric)}"
    strongest: Sequence[Mapping[str, Any]] = entry["strongest"]
    note = f" ({entry['note']})" if "note" in entry and strongest else ""
    if not strongest:
        reason = entry.get("note")
        return f"{subject}: {reason}." if reason else f"{subject} depends on none of them clearly."
    text, before = "", ""
    for row in strongest[:SAID]:
        how, value = row["how"], row["value"]
        size = f"{100 * value:.0f} % of the variance" if how == "share" else f"{value:+.2f}"
        named = f"{row['parameter']} ({size})"
        text += f" and {named}" if how == before == "rises" else f", {HOW[how].format(named)}"
        before = how
    rest = f"; it depends on {len(strongest) - SAID} more, less clearly" if len(strongest) > SAID else ""
    return f"{subject} {text.removeprefix(', ')}{rest}.{note}"


def mixed(summary: Mapping[str, Any]) -> str | None:
    """Parameters that were drawn together, whose effects cannot be separated."""
    pairs = [f"{p['first']} and {p['second']} ({p['value']:+g})" for p in summary["correlated"]]
    if not pairs:
        return None
    return f"Drawn with a correlation, so that their effects mix: {', '.join(pairs)}."


def stepping(summary: Mapping[str, Any]) -> str | None:
    """Sentence on the step that drawn sensor offsets cause at the start; None without such offsets."""
    names = ", ".join(summary["sensor_offsets"])
    if not names:
        return None
    return (
        f"A sensor's offset ({names}) acts from t = 0 on. The initial state does not account for it, so that "
        "controllers see a step."
    )


def drawn(summary: Mapping[str, Any], name: str, value: float) -> str:
    """Text of a parameter's draw with its unit."""
    unit = summary["units"][name]
    return f"{value:.6g}" if unit == "1" else f"{value:.6g} {unit}"


def unfinished(summary: Mapping[str, Any]) -> str | None:
    """Sentence on missing samples; None if none is missing."""
    if summary["samples"] == summary["of"]:
        return None
    return (
        f"Not finished: {summary['samples']} of {summary['of']} samples are complete. The first samples of a "
        "design need not cover it evenly; start the campaign again to continue."
    )


def why_worst(row: Mapping[str, Any]) -> str:
    """Reason why a sample is the worst, if it is not a number."""
    if row["unclosed"]:
        return str(row["unclosed"])
    if row["diverged_at_s"] is not None:
        return f"diverged after {row['diverged_at_s']:.3g} s"
    return "a capture missed" if row["missed"] else ""
