"""Tables of a result's headline numbers, events and plans, for the terminal, pages and notebooks."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from spacerobot.common.tables import Table, unit_scale
from spacerobot.result.events import event_table
from spacerobot.result.summary_types import Summary
from spacerobot.result.trust import open_words
from spacerobot.scenario import Scenario

if TYPE_CHECKING:
    import xarray as xr

Row = tuple[str, str]
FINEST = 1e-4
"""Magnitude, in the unit of a row, below which ranges are written in scientific notation."""


def result_tables(scenario: Scenario, summary: Summary, data: xr.Dataset) -> list[Table]:
    """Tables of a result's headline numbers, events, and plans of model predictive control.

    Args:
        scenario, summary, data: Parts of the result.
    """
    robots = scenario.robots.values()
    counts = {"robot": len(robots), "tip": sum(len(r.tips) for r in robots), "grasp": len(scenario.grasps)}
    texts = (f"{count} {name}{'' if count == 1 else 's'}" for name, count in counts.items())
    about = ", ".join(("planar" if "body_angle" in data else "spatial", *texts))
    tables = [
        Table.of_pairs(f"{scenario.name}: {about}", headline(summary, data, scenario.body_label("target")))
    ]
    if events := summary.get("events"):
        tables.append(event_table(events, "events"))
    if "mpc" in summary:
        tables.append(Table.of_pairs("model predictive control", _plan_rows(summary["mpc"])))
    return tables


def _plan_rows(plans: Mapping[str, Any]) -> list[Row]:
    """Number of plans of model predictive control, and solution times compared with the period or delay."""
    missed = f", {plans['missed']} without a plan" if plans["missed"] else ""
    times = f"median {plans['median_solve_s']:.3g} s, the longest {plans['longest_solve_s']:.3g} s"
    within = "delay" if plans["delay_s"] else "period"
    return [
        ("period", f"{plans['period_s']:g} s, applied {plans['delay_s']:g} s after the measurement"),
        ("plans", f"{plans['plans']}{missed}; the first in {plans['first_solve_s']:.3g} s"),
        (
            "solution time of the others",
            f"{times}; {plans['in_time']} of {plans['plans'] - 1} within the {within}",
        ),
    ]


def headline(summary: Summary, data: xr.Dataset, target: str = "object") -> list[Row]:
    """Headline numbers of a result: names and values as texts.

    Args:
        summary, data: Parts of the result.
        target: Displayed name of the target.
    """
    rows = [("status", status_text(summary["status"]))]
    if summary["outcome"]:
        rows.append(("outcome", summary["outcome"]))
    rows += [(f"missed {grasp}", why["words"]) for grasp, why in summary.get("missed", {}).items()]
    led = {t: axes for t, axes in summary["tip_error"].items() if t not in summary.get("unled_tips", ())}
    # plans of MPC replace the references of tips: the distance from a reference is not a control error
    error = "tip from its reference" if "mpc" in summary else "tip error"
    for tip, axes in led.items():
        names = ["x", "y"] if "body_angle" in data else ["x", "y", "z"]
        unit, factor = _unit_of(axes["norm"]["rms_m"])
        spans = ", ".join(
            f"{axis} {_span(axes[axis]['min_m'] * factor, axes[axis]['max_m'] * factor)}" for axis in names
        )
        rows.append((f"{error} {tip}", f"{spans} {unit} (rms {axes['norm']['rms_m'] * factor:.3f} {unit})"))
    if summary["target"] is not None:
        rows.append((f"maximum rotation of {target}", f"{summary['target']['max_rotation_deg']:.4g} deg"))
    for base, motion in summary["bases"].items():
        moved = f"{motion['max_rotation_deg']:.4g} deg, {motion['max_travel_m'] * 1e3:.4g} mm"
        rows.append((f"maximum motion of base {base}", moved))
    for base, attitude in summary.get("attitude_error", {}).items():
        words = f"at most {attitude['max_deg']:.4g} deg, {attitude['final_deg']:.4g} deg at the end"
        rows.append((f"attitude error {base}", words))
    spent = summary.get("propellant_kg", {})
    rows += [(f"propellant {base}", f"{mass * 1e3:.4g} g") for base, mass in spent.items()]
    torque, grip = summary["greatest_torque"], summary["greatest_grip"]
    rows.append(("maximum joint torque", _peak(torque, "torque_n_m", torque.get("unit", "N m"), "joint")))
    rows.append(("maximum grip force", _peak(grip, "force_n", "N", "grasp")))
    if "greatest_contact" in summary:
        rows.append(("maximum contact force", _peak(summary["greatest_contact"], "force_n", "N", "contact")))
    if "fastest_wheel" in summary:
        wheel = summary["fastest_wheel"]
        left = wheel["least_margin"]
        margin = "" if left is None else f", {max(left, 0):.0%} of its speed limit left"
        factor, unit = unit_scale("rad/s", "wheel_speed")
        fastest = {**wheel, "speed": factor * wheel["speed_rad_s"]}
        rows.append(("fastest wheel", _peak(fastest, "speed", unit, "wheel") + margin))
    ledger = summary["ledger"]
    momentum, energy = ledger["momentum"], ledger["energy"]
    if momentum["conserved"]:
        drifts = (f"{momentum[kind]['relative_drift']:.1e} {kind}" for kind in ("linear", "angular"))
        drift = ", ".join(drifts) + " (relative to the largest partial momentum)"
    else:
        drift = f"not conserved: {momentum['reason']}"
    residual = f"{energy['relative_residual']:.1e} (relative to the largest energy)"
    conserved = [("momentum drift", drift), ("energy residual", residual)]
    return rows + conserved + [("engine", engine_text(summary))]


def engine_text(summary: Summary) -> str:
    """Engine, backend, step and wall time of a rollout in words."""
    engine, timing = summary["engine"], summary["timing_s"]
    step = f", steps of {engine['step_s'] * 1e3:g} ms" if engine["step_s"] else ""
    why = f"; {engine['interpreted_because']}" if engine.get("interpreted_because") else ""
    return (
        f"{engine['name']} ({engine['backend']}){step}, {timing['rollout'] * 1e3:.0f} ms for the rollout{why}"
    )


def _span(low: float, high: float) -> str:
    """Range as text: with three decimals, or more for three significant figures of the larger end."""
    greatest = max(abs(low), abs(high))
    if not 0 < greatest < FINEST:
        plain = greatest == 0 or not math.isfinite(greatest)
        decimals = 3 if plain else max(3, 2 - math.floor(math.log10(greatest)))
        ends = (f"{round(end, decimals) + 0.0:+.{decimals}f}" for end in (low, high))  # no -0.000
    else:
        ends = (f"{end:+.2e}" for end in (low, high))
    return " .. ".join(ends)


def _unit_of(size_m: float) -> tuple[str, float]:
    """Unit of length in which a size has significant digits, and the factor from metres."""
    for unit, factor in (("mm", 1e3), ("um", 1e6)):
        if size_m * factor >= 0.01:
            return unit, factor
    return ("nm", 1e9) if size_m > 0 else ("mm", 1e3)


def status_text(status: Mapping[str, Any]) -> str:
    """Status in words: completed or diverged, with the time, and reasons not to trust the numbers."""
    if status["state"] == "completed":
        text = f"completed, {status['reached_s']:g} s"
    else:
        verb = "chattered" if status["state"] == "chattering" else "diverged"
        text = f"{verb} after {status['diverged_at_s']:.6g} s{cause_words(status)}"
    open_balances = open_words(status)
    return f"{text}, {open_balances}" if open_balances else text


def cause_words(status: Mapping[str, Any]) -> str:
    """Cause of a rollout's end as a suffix of its status; empty if it is unknown."""
    return f": {status['cause']}" if status.get("cause") else ""


def _peak(peak: Mapping[str, Any], key: str, unit: str, place: str) -> str:
    if peak[place] is None:
        return "none"
    return f"{peak[key]:.4g} {unit} ({peak[place]}, {peak['time_s']:.3g} s)"
