"""Conservation ledger: drift of momentum and residual of the energy balance."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from spacerobot.result.trust import KINDS
from spacerobot.scenario import Scenario

if TYPE_CHECKING:
    import xarray as xr

SMALLEST = 1e-9
"""Minimum scale of relative drift and residual [N s, N m s, J], for scenes in which nothing moves."""
INNER_PART = 1e-3
"""Minimum scale of relative momentum drift, relative to the momentum that internal motion could have."""


def build_ledger(data: xr.Dataset, scenario: Scenario) -> dict[str, Any]:
    """Momentum drift and energy balance of a result.

    The conserved momentum is that of robots and target together, about the world's origin, minus the impulse
    of external wrenches. Its drift is relative to the largest momentum of a single body or of its wheels. If
    bodies have hardly any momentum, such as a robot that holds nothing, the drift is relative to a fraction
    of the momentum that their internal motion could have. With a fixed base or uniform gravity, momentum is
    not conserved, and the ledger states the reason. The energy residual is relative to the largest energy in
    the balance.

    Args:
        data: Dataset of the result.
        scenario: Scenario of the result.

    Returns:
        dict: Ledger, as in :class:`spacerobot.result.summary_types.Ledger`.
    """
    # balance: change of kinetic, spring and potential energy = sum of signed works
    stored = data.energy_kinetic.values + data.energy_spring.values + data.energy_potential.values
    change = stored - stored[0]
    works = works_of(data)
    residual = change - sum(work.attrs["sign"] * work.values for work in works)
    largest = max(float(np.abs(x).max()) for x in (change, stored, *(work.values for work in works)))
    worst = float(np.abs(residual).max())
    energy = {
        "actuator_work_j": float(data["work_actuator"][-1]),
        "stored_change_j": float(change[-1]),
        "joint_loss_j": float(data["work_joint"][-1]),
        "grasp_loss_j": float(data["work_grasp"][-1]),
        "constraint_work_j": float(data["work_constraint"][-1]),
        "largest_residual_j": worst,
        "largest_energy_j": largest,
        "relative_residual": worst / max(largest, SMALLEST),
    }
    momentum: dict[str, Any] = {"conserved": False, "reason": data.attrs["outside"]}
    if not data.attrs["outside"]:
        bodies = [*scenario.robots.values(), *([scenario.target] if scenario.target else [])]
        momentum = {"conserved": True}
        # bound of the momentum of any part: |p|^2 <= 2 m T by the inequality of Cauchy and Schwarz
        mass = sum(link.mass or 0.0 for body in bodies for link in body.links.values())
        linear = float(np.sqrt(2 * mass * data.energy_kinetic.values.max()))
        extent = float(np.linalg.norm(data.body_position.values, axis=-1).max())
        inner = {"linear": linear, "angular": linear * extent}
        for kind, unit in KINDS:
            total, partial = data[f"momentum_{kind}"].values, data[f"body_momentum_{kind}"].values
            conserved = conserved_momentum(data, kind).values
            drift = float(np.linalg.norm(conserved - conserved[0], axis=-1).max())
            largest = max(float(np.linalg.norm(partial, axis=-1).max()), INNER_PART * inner[kind])
            if kind == "angular" and "wheel_momentum" in data:
                largest = max(largest, float(np.nanmax(np.linalg.norm(data.wheel_momentum.values, axis=-1))))
            momentum[kind] = {
                f"initial_{unit}": [float(x) for x in total[0]],
                f"drift_{unit}": drift,
                f"largest_partial_{unit}": largest,
                "relative_drift": drift / max(largest, SMALLEST),
            }
    return {"momentum": momentum, "energy": energy}


def conserved_momentum(data: xr.Dataset, kind: str) -> xr.DataArray:
    """Total ``linear`` or ``angular`` momentum minus the impulse of external wrenches, which is constant."""
    total, impulse = data[f"momentum_{kind}"], f"impulse_{kind}"
    return total - data[impulse] if impulse in data else total


def works_of(data: xr.Dataset) -> list[xr.DataArray]:
    """Works since the start [J]; ``attrs["sign"]`` is 1 if a work increases the stored energy, else -1."""
    return [data[name] for name, variable in data.variables.items() if "sign" in variable.attrs]


def work_text(work: xr.DataArray) -> str:
    """Text of a work in legends, such as ``put in by actuators``."""
    return str(work.attrs["long_name"]).removeprefix("work ").removesuffix(" since the start")
