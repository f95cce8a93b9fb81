"""Whether a rollout's numbers can be trusted: how far its ledger may be open, and what closes it.

Nothing acts on a free scene from outside, so its momenta are constant, and work explains every change of
energy. A rollout that does otherwise has steps too long for what happens in it. Runs, reports, pages and
campaigns are judged by the limits stated here. A contact's force is that of a shallow indentation: shapes
half way through each other may leave on the other side, however well momenta and energy are kept.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from spacerobot.common.arrays import Array
from spacerobot.scene.scene import SceneContact

MOST_DRIFT = 0.01
"""Greatest change of a momentum, in parts of the largest of a body."""
MOST_RESIDUAL = 0.01
"""Greatest energy that no work explains, in parts of the largest energy in the balance."""
LEAST_MOMENTUM = 1e-5
"""Drift is compared with no less [N s, N m s], so that rounding in a scene at rest is no doubt."""
LEAST_ENERGY = 1e-6
"""The residual is compared with no less [J]."""

MOST_DEPTH = 0.5
"""Greatest indentation, in parts of the least distance from the smaller shape's middle to its surface."""

DEEP_ADVICE = "take a stiffer contact, or let bodies meet more slowly"

KINDS = (("linear", "n_s"), ("angular", "n_m_s"))


def judge(
    completed: bool, ledger: Mapping[str, Any], advice: str, deep: Sequence[str] = ()
) -> dict[str, Any]:
    """Verdict on a rollout, as it stands in a summary's status.

    Args:
        completed: Whether the rollout reached its end; one that diverged needs no further doubt.
        ledger: As :func:`spacerobot.result.ledger.build_ledger` makes it.
        advice: What to do where the ledger is open.
        deep: As :func:`deep_contacts` finds them.

    Returns:
        dict: ``trusted``, what is ``open`` in words, which contacts are too ``deep`` if any, ``advice`` (None
            where it is trusted).
    """
    open_balances = list[str]()
    if completed:
        momentum, energy, parts = ledger["momentum"], ledger["energy"], list[str]()
        for kind, unit in KINDS if momentum["conserved"] else ():
            balance = momentum[kind]
            drift = balance[f"drift_{unit}"] / max(balance[f"largest_partial_{unit}"], LEAST_MOMENTUM)
            if not drift <= MOST_DRIFT:
                parts.append(f"{share(drift)} {kind}")
        if parts:
            open_balances.append(f"momentum drift {', '.join(parts)}")
        residual = energy["largest_residual_j"] / max(energy["largest_energy_j"], LEAST_ENERGY)
        if not residual <= MOST_RESIDUAL:
            open_balances.append(f"energy residual {share(residual)}")
    return {
        "trusted": completed and not open_balances and not deep,
        "open": open_balances,
        **({"deep": list(deep)} if deep else {}),
        "advice": "; ".join([*([advice] if open_balances else []), *([DEEP_ADVICE] if deep else [])]) or None,
    }


def deep_contacts(contacts: Sequence[SceneContact], data: xr.Dataset) -> list[str]:
    """Contacts whose shapes are pressed into each other beyond what their law means, in words.

    Args:
        contacts: Of the scene.
        data: A result's dataset, with the gap of each contact's nearest pair of shapes [m].
    """
    warnings = []
    for contact in contacts:
        size = contact_size(contact)
        gap = np.asarray(data.contact_gap.sel(contact=contact.name).values)
        depth = -least_between(gap, np.asarray(data.time.values))
        if depth > MOST_DEPTH * size:
            warnings.append(
                f"contact {contact.name} is {1e3 * depth:.3g} mm deep, where its smaller shape has "
                f"{1e3 * size:.3g} mm from its middle to its surface"
            )
    return warnings


def contact_size(contact: SceneContact) -> float:
    """Least distance from the middle of a contact's smaller shape to its surface [m]."""
    return float(min(shape.config.extent()[0] for pair in contact.pairs for shape in pair))


def least_between(values: Array, time: Array) -> float:
    """Least value of a signal, also between its samples: that of the parabola through the three lowest.

    Args:
        values, time: The signal (n,), and when it was sampled (n,) [s].
    """
    k = int(np.argmin(values))
    if not 0 < k < len(values) - 1:
        return float(values[k])
    steps = np.diff(time[k - 1 : k + 2])
    if not (steps > 0).all():  # at an event there are two samples of one time
        return float(values[k])
    slopes = np.diff(values[k - 1 : k + 2]) / steps
    bend = (slopes[1] - slopes[0]) / steps.sum()
    slope = (slopes[0] * steps[1] + slopes[1] * steps[0]) / steps.sum()
    return float(values[k] - (slope**2 / (4 * bend) if bend > 0 else 0.0))


def advise(engine: Mapping[str, Any], tolerance: float, fastest: Mapping[str, Any]) -> str:
    """Advice about an open ledger, in words.

    Args:
        engine: As in a summary.
        tolerance: Of the scenario.
        fastest: Joint with the greatest rate, as in a summary.
    """
    if not engine["step_s"]:
        what = f"take a simulation.tolerance smaller than {tolerance:g}"
    elif "step_chosen" in engine:
        what = f"take a simulation.step shorter than the chosen one of {engine['step_s']:g} s"
    else:
        what = f"take a simulation.step shorter than {engine['step_s']:g} s"
    return f"{what}, or slow down what moves: {fast_words(fastest)}" if fastest["joint"] else what


def fast_words(fastest: Mapping[str, Any]) -> str:
    """Fastest joint, its rate and the time; empty where there is none."""
    if fastest["joint"] is None:
        return ""
    speed = f"{fastest['rate']:.3g} {fastest['unit']}"
    return f"the fastest joint is {fastest['joint']}, {speed} at {fastest['time_s']:.3g} s"


def share(part: float) -> str:
    """A part as a percentage."""
    return f"{100 * part:.2g} %" if part < 1 else f"{100 * part:.0f} %" if part < 100 else f"{part:.2g} fold"


def open_words(status: Mapping[str, Any]) -> str:
    """Open balances and excessive depths, as the words that follow a status; empty if there are none."""
    return f"but {'; '.join(_doubts(status))}" if _doubts(status) else ""


def _doubts(status: Mapping[str, Any], limits: str = "") -> list[str]:
    """Reasons not to trust a rollout."""
    deep = [f"bodies pass into each other: {'; '.join(status['deep'])}"] if status.get("deep") else []
    opened = "; ".join(status["open"])
    balance = (
        f"the ledger is open ({opened}; allowed: {limits})" if limits else f"the ledger is open: {opened}"
    )
    return [*([balance] if opened else []), *deep]


def warning(status: Mapping[str, Any]) -> str | None:
    """One sentence to warn with; None where nothing is open or too deep."""
    doubts = _doubts(status, f"{100 * MOST_DRIFT:g} % and {100 * MOST_RESIDUAL:g} %")
    if not doubts:
        return None
    return f"{'; '.join(doubts)}: do not trust these numbers; {status['advice']}"
