"""Measures of trust in a campaign's rollouts.

They are the drift of momenta, the residual of the energy balance and the indentation of contacts, with the
limits of :mod:`spacerobot.result.trust`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np
import xarray as xr

from spacerobot.closedloop import ClosedLoop
from spacerobot.common.arrays import Array
from spacerobot.result.trust import (
    LEAST_ENERGY,
    LEAST_MOMENTUM,
    MOST_DEPTH,
    MOST_DRIFT,
    MOST_RESIDUAL,
    contact_size,
    share,
)
from spacerobot.rollout import Measure, Signals, final, peak
from spacerobot.scenario import Campaign
from spacerobot.scene import Scene

DRIFT, RESIDUAL, DEPTH = "momentum_drift", "energy_residual", "contact_depth"
KINDS = ("linear", "angular")
LIMITS = {DRIFT: MOST_DRIFT, RESIDUAL: MOST_RESIDUAL, DEPTH: MOST_DEPTH}
STORED = ("energy_kinetic", "energy_spring", "energy_potential")

Mask = np.typing.NDArray[np.bool_]


def drift_measure(loop: ClosedLoop, signals: Signals) -> Measure:
    """Final values (8,) for :func:`drift_of`: for linear and angular momentum the change (3), and a scale.

    The change is that of the total momentum minus the external impulse. The scale is the largest momentum of
    a body at the start or the end; the maximum over all steps would cost a seventh of a rollout.
    """
    begin, parts = _begin(loop, signals), []
    for kind in KINDS:
        bodies = ca.vertcat(*(named[f"body_momentum_{kind}"] for named in (begin, signals.outputs)))
        sizes = [ca.sqrt(ca.sumsqr(bodies[i : i + 3])) for i in range(0, bodies.numel(), 3)]
        change = signals[f"momentum_{kind}"] - begin[f"momentum_{kind}"]
        if f"impulse_{kind}" in begin:
            change = change - signals[f"impulse_{kind}"]
        parts += [change, ca.mmax(ca.vertcat(*sizes))]
    return final(ca.vertcat(*parts))


def residual_measure(loop: ClosedLoop, signals: Signals) -> Measure:
    """Final values (2,) for :func:`residual_of` [J]: residual of the energy balance, and the largest energy.

    Energies are evaluated at the start and the end only, as momenta are in :func:`drift_measure`.
    """
    begin = _begin(loop, signals)
    stored = [sum(named[name] for name in STORED) for named in (begin, signals.outputs)]
    works = {name: signals[f"work_{name}"] for name in loop.works}
    change = stored[1] - stored[0]
    unexplained = change - sum(sign * works[name] for name, sign in loop.works.items())
    largest = ca.mmax(ca.fabs(ca.vertcat(change, *stored, *works.values())))
    return final(ca.vertcat(ca.fabs(unexplained), largest))


def depth_measure(scene: Scene, signals: Signals) -> Measure:
    """Largest indentation of each contact over all steps, relative to its :func:`contact_size` (n,)."""
    sizes = [contact_size(contact) for contact in scene.contacts]
    return peak(-ca.vec(signals["contact_gap"]) / ca.DM(sizes))


def _begin(loop: ClosedLoop, signals: Signals) -> dict[str, ca.SX]:
    """Outputs at the start."""
    x0, c = loop.setup(ca.vertcat(*signals.parameters.values()))
    return dict(zip(loop.outputs.name_out(), loop.outputs(0, x0, c), strict=True))


def drift_of(values: Array) -> Array:
    """Change of linear and angular momentum relative to the largest momentum of a body (N, 2).

    Args:
        values: Values of :func:`drift_measure` (N, 8).
    """
    each = values.reshape(len(values), len(KINDS), 4)
    return np.asarray(np.linalg.norm(each[:, :, :3], axis=2) / np.maximum(each[:, :, 3], LEAST_MOMENTUM))


def residual_of(values: Array) -> Array:
    """Residual of the energy balance relative to the largest energy (N, 1).

    Args:
        values: Values of :func:`residual_measure` (N, 2).
    """
    return np.asarray(values[:, :1] / np.maximum(values[:, 1:], LEAST_ENERGY))


def untrusted(data: xr.Dataset, failed: Mapping[str, Mask]) -> dict[str, dict[str, Any]]:
    """Count the completed rollouts that are not to be trusted, with their largest errors, by set of gains.

    Args:
        data: Dataset of a campaign's store.
        failed: Whether each sample failed (n,), by set of gains.
    """
    untrusted_sets = {}
    for name, lost in failed.items():
        worst = {kind: data[kind].sel(gains=name).values.max(axis=1) for kind in LIMITS if kind in data}
        if not worst:
            continue
        # not those that diverged, which have none
        doubtful = np.logical_or.reduce([values > LIMITS[kind] for kind, values in worst.items()])
        untrusted_sets[name] = {
            "count": int(doubtful.sum()),
            "of": int(np.isfinite(next(iter(worst.values()))).sum()),
            "not_failed": int((doubtful & ~lost).sum()),
            "largest": {k: float(np.nan_to_num(values).max(initial=0.0)) for k, values in worst.items()},
        }
    return untrusted_sets


def caveats(open_ledgers: Mapping[str, Mapping[str, Any]], campaign: Campaign) -> list[str]:
    """Warnings about open ledgers, in sentences; none where all are closed."""
    sentences = []
    for name, entry in open_ledgers.items():
        if entry["count"]:
            passing = entry["not_failed"]
            failing = (
                "all of them count as failed"
                if not passing
                else f"{passing} of them nevertheless passed the limits"
            )
            over = {kind for kind, value in entry["largest"].items() if value > LIMITS[kind]}
            faults = ["leave the ledger open"] if over - {DEPTH} else []
            faults += ["press bodies too deep into each other"] if DEPTH in over else []
            largest = ", ".join(
                f"{kind.replace('_', ' ')} at most {share(value)}, allowed {100 * LIMITS[kind]:g} %"
                for kind, value in entry["largest"].items()
            )
            advice = [f"a campaign.step shorter than {campaign.step:g} s"] if over - {DEPTH} else []
            advice += ["a stiffer contact, or a lower speed"] if DEPTH in over else []
            sentences.append(
                f"With the gains {name}, {entry['count']} of {entry['of']} completed rollouts "
                f"{' or '.join(faults)} ({largest}): their numbers are not to be trusted ({failing}). Try "
                f"{'; '.join(advice)}."
            )
    return sentences
