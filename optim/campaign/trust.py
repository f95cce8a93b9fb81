"""Whether a campaign's rollouts can be trusted: nothing acts on a floating scene from outside, so its momenta
are constant, and a rollout that changes them has steps too long for what happens in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np
import xarray as xr

from optim.protocol import Array
from spacerobot.rollout import ClosedLoopFunctions, Measure, Signals, final
from spacerobot.scenario import Campaign

DRIFT = "momentum_drift"
KINDS = ("linear", "angular")
MOST = 0.01  # of the largest momentum of a body: beyond it, a rollout's other numbers are not physics
SMALLEST = 1e-5  # N s and N m s: drift is compared with no less

Mask = np.typing.NDArray[np.bool_]


def drift_measure(loop: ClosedLoopFunctions, signals: Signals) -> Measure:
    """Final values that :func:`drift_of` is made of: for each kind its change (3), and the largest of a body.

    A body's largest momentum is looked for at the start and at the end alone: at every step it would cost a
    seventh of a rollout.
    """
    parameters = ca.vertcat(*signals.parameters.values())
    x0, c = loop.setup(parameters)
    begin = dict(zip(loop.outputs.name_out(), loop.outputs(0, x0, c), strict=True))
    parts = []
    for kind in KINDS:
        bodies = ca.vertcat(*(named[f"body_momentum_{kind}"] for named in (begin, signals.outputs)))
        sizes = [ca.sqrt(ca.sumsqr(bodies[i : i + 3])) for i in range(0, bodies.numel(), 3)]
        parts += [signals[f"momentum_{kind}"] - begin[f"momentum_{kind}"], ca.mmax(ca.vertcat(*sizes))]
    return final(ca.vertcat(*parts))


def drift_of(values: Array) -> Array:
    """Change of momentum, in parts of the largest of a body (N, 2): linear and angular.

    Parameters
    ----------
    values
        Of :func:`drift_measure`, (N, 8).
    """
    each = values.reshape(len(values), len(KINDS), 4)
    return np.asarray(np.linalg.norm(each[:, :, :3], axis=2) / np.maximum(each[:, :, 3], SMALLEST))


def untrusted(data: xr.Dataset, failed: Mapping[str, Mask]) -> dict[str, dict[str, Any]]:
    """How many rollouts that were completed change a momentum by too much, by set of gains.

    Parameters
    ----------
    data
        Of a store.
    failed
        Whether each sample failed (n,), by set of gains.
    """
    if DRIFT not in data:
        return {}
    found = {}
    for name, lost in failed.items():
        drift = data[DRIFT].sel(gains=name).values.max(axis=1)
        doubtful = drift > MOST  # not those that diverged, which have none
        found[name] = {
            "count": int(doubtful.sum()),
            "of": int(np.isfinite(drift).sum()),
            "not_failed": int((doubtful & ~lost).sum()),
            "largest": float(np.nan_to_num(drift).max(initial=0.0)),
        }
    return found


def doubts(found: Mapping[str, Mapping[str, Any]], campaign: Campaign) -> list[str]:
    """What is to be said of it, in sentences; nothing where all is well."""
    sentences = []
    for name, told in found.items():
        if told["count"]:
            kept = told["not_failed"]
            failing = "all of them count as failed" if not kept else f"{kept} of them do not count as failed"
            sentences.append(
                f"With the gains {name}, {told['count']} of {told['of']} completed rollouts change the total "
                f"momentum, which nothing can, by more than {100 * MOST:g} % of the largest of a body (at "
                f"most by {100 * told['largest']:.2g} %): their numbers are not to be trusted ({failing}). "
                f"Try a campaign.step shorter than {campaign.step:g} s."
            )
    return sentences
