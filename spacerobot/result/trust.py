"""Criteria for trust in a rollout's numbers: conservation of momentum and energy, and depth of contacts.

Without external wrenches, the momenta of a scene are constant, and works account for every change of energy.
If a rollout violates this, its steps are too long. The limits in this module apply to runs, reports, pages
and campaigns. Contact laws hold for shallow indentation: shapes half-way through each other may separate on
the other side, even if momentum and energy are conserved.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.scene.scene import SceneContact

if TYPE_CHECKING:
    import xarray as xr

MOST_DRIFT = 0.01
"""Maximum drift of momentum, relative to the largest momentum of a body."""
MOST_RESIDUAL = 0.01
"""Maximum residual of the energy balance, relative to the largest energy in it."""
LEAST_MOMENTUM = 1e-5
"""Minimum scale of the relative drift [N s, N m s], so that rounding in a scene at rest causes no warning."""
LEAST_ENERGY = 1e-6
"""Minimum scale of the relative residual [J]."""

MOST_DEPTH = 0.5
"""Maximum indentation, relative to the smallest distance from the smaller shape's centre to its surface."""

DEEP_ADVICE = "take a stiffer contact, or let bodies meet more slowly"

KINDS = (("linear", "n_s"), ("angular", "n_m_s"))
"""Kinds of momentum with their units in keys."""


def check_trust(
    completed: bool, ledger: Mapping[str, Any], advice: str, deep: Sequence[str] = ()
) -> dict[str, Any]:
    """Check whether the numbers of a rollout can be trusted.

    Args:
        completed: Whether the rollout reached its end; the balances of a diverged rollout are not checked.
        ledger: Ledger from :func:`spacerobot.result.ledger.build_ledger`.
        advice: Advice if a balance is open.
        deep: Contacts from :func:`deep_contacts`.

    Returns:
        dict: Entries of a summary's status: ``trusted``, the ``open`` balances in words, contacts that are
            too ``deep``, if any, and ``advice`` (None if the numbers can be trusted).
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
    """Contacts whose indentation exceeds the validity of their law, in words.

    Args:
        contacts: Contacts of the scene.
        data: Dataset of a result, with the gap of each contact's nearest pair of shapes [m].
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
    """Smallest distance from the centre of a contact's smaller shape to its surface [m]."""
    return float(min(shape.config.extent()[0] for pair in contact.pairs for shape in pair))


def least_between(values: Array, time: Array) -> float:
    """Minimum of a signal between its samples, by the parabola through the lowest sample and its neighbours.

    Args:
        values, time: Samples of the signal (n,) and their times (n,) [s].
    """
    k = int(np.argmin(values))
    if not 0 < k < len(values) - 1:
        return float(values[k])
    steps = np.diff(time[k - 1 : k + 2])
    if not (steps > 0).all():  # an event has two samples at one time
        return float(values[k])
    slopes = np.diff(values[k - 1 : k + 2]) / steps
    bend = (slopes[1] - slopes[0]) / steps.sum()
    slope = (slopes[0] * steps[1] + slopes[1] * steps[0]) / steps.sum()
    return float(values[k] - (slope**2 / (4 * bend) if bend > 0 else 0.0))


def advise(engine: Mapping[str, Any], tolerance: float, fastest: Mapping[str, Any]) -> str:
    """Advice about an open balance, in words.

    Args:
        engine: Engine, as in a summary.
        tolerance: Tolerance of the scenario.
        fastest: Joint with the largest rate, as in a summary.
    """
    if not engine["step_s"]:
        what = f"take a simulation.tolerance smaller than {tolerance:g}"
    elif "step_chosen" in engine:
        what = f"take a simulation.step shorter than the chosen one of {engine['step_s']:g} s"
    else:
        what = f"take a simulation.step shorter than {engine['step_s']:g} s"
    return f"{what}, or slow down what moves: {fast_words(fastest)}" if fastest["joint"] else what


def fast_words(fastest: Mapping[str, Any]) -> str:
    """Fastest joint, its rate and the time in words; empty without joints."""
    if fastest["joint"] is None:
        return ""
    speed = f"{fastest['rate']:.3g} {fastest['unit']}"
    return f"the fastest joint is {fastest['joint']}, {speed} at {fastest['time_s']:.3g} s"


def share(part: float) -> str:
    """Fraction as a percentage or multiple, as text."""
    return f"{100 * part:.2g} %" if part < 1 else f"{100 * part:.0f} %" if part < 100 else f"{part:.2g} fold"


def open_words(status: Mapping[str, Any]) -> str:
    """Open balances and excessive depths as a suffix of a status; empty if there are none."""
    return f"but {'; '.join(_distrust(status))}" if _distrust(status) else ""


def _distrust(status: Mapping[str, Any], limits: str = "") -> list[str]:
    """Reasons not to trust a rollout, in words."""
    deep = [f"bodies pass into each other: {'; '.join(status['deep'])}"] if status.get("deep") else []
    opened = "; ".join(status["open"])
    balance = (
        f"the ledger is open ({opened}; allowed: {limits})" if limits else f"the ledger is open: {opened}"
    )
    return [*([balance] if opened else []), *deep]


def warning(status: Mapping[str, Any]) -> str | None:
    """Warning about open balances and excessive depths; None if there are none."""
    reasons = _distrust(status, f"{100 * MOST_DRIFT:g} % and {100 * MOST_RESIDUAL:g} %")
    if not reasons:
        return None
    return f"{'; '.join(reasons)}: do not trust these numbers; {status['advice']}"
