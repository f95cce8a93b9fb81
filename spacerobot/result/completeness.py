"""Checks that a result's folder has every variable, number and name that its readers use."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from spacerobot.result.trust import KINDS
from spacerobot.scenario import Scenario

if TYPE_CHECKING:
    import xarray as xr

VECTORS = {
    "tip": ("tip_position", "tip_velocity", "tip_reference", "tip_error", "tip_orientation_error"),
    "body": ("body_position", "body_rotation", "body_momentum_linear", "body_momentum_angular"),
    "grasp": ("grasp_force", "grasp_torque", "grasp_gap"),
}
SCALARS = (
    *("energy_kinetic", "energy_spring", "energy_potential"),
    *("work_actuator", "work_joint", "work_grasp", "work_constraint"),
)
DIMENSIONS: dict[str, tuple[str, ...]] = {
    **{name: ("time", place, "axis") for place, names in VECTORS.items() for name in names},
    **{f"momentum_{kind}": ("time", "axis") for kind, _ in KINDS},
    **{f"joint_{name}": ("time", "joint") for name in ("position", "velocity", "torque")},
    **dict.fromkeys(SCALARS, ("time",)),
    **{"q": ("time", "configuration"), "v": ("time", "velocity"), "z": ("time", "controller")},
    "body_orientation": ("time", "body", "quaternion"),
    "joint_kind": ("joint",),
    **{name: (name,) for name in ("time", "tip", "body", "joint", "grasp", "axis")},
}
"""Variables and coordinates that every result has, with their dimensions."""

STATE = ("time", "q", "v", "body_position", "body_orientation")
"""Variables that pages and figures draw and that must be finite; a diverged rollout is cut before that."""

Number = (int, float)
Maybe = (int, float, type(None))
Name = (str, type(None))


def missing_data(data: xr.Dataset, scenario: Scenario) -> str | None:
    """First missing or malformed item of a dataset, in words; None if it is complete."""
    for name, dims in DIMENSIONS.items():
        if name not in data.variables:
            return f"no variable {name!r}"
        actual = tuple(map(str, data[name].dims))
        if actual != dims:
            return f"{name}: found the dimensions {', '.join(actual)}, allowed: {', '.join(dims)}"
        if not data[name].size and dims[0] == "time" and not data.sizes["time"]:
            return "no sample"
        if dims[0] == "time":
            if "units" not in data[name].attrs:
                return f"{name}: no attribute 'units'"
            if not np.issubdtype(data[name].dtype, np.number):
                return f"{name}: found {data[name].dtype}, allowed: numbers"
            if name in STATE and not np.isfinite(data[name].values).all():
                return f"{name}: found values that are not finite"
    if "outside" not in data.attrs:
        return "no attribute 'outside'"
    for work in map(str, data):
        if work.startswith("work_") and "sign" not in data[work].attrs:
            return f"{work}: no attribute 'sign'"
    # labels of the dataset must agree with the names in the scenario
    target = ["target"] if scenario.target else []
    expected = {
        "tip": [f"{robot}/{tip}" for robot, config in scenario.robots.items() for tip in config.tips],
        "body": [*scenario.robots, *target],
        "grasp": list(scenario.grasps),
        "contact": list(scenario.contacts),
    }
    for name, labels in expected.items():
        present = [str(label) for label in data[name].values] if name in data.coords else []
        if present != labels:
            message = f"holds {', '.join(present) or 'none'}, scenario.yaml has {', '.join(labels) or 'none'}"
            return f"{name}: {message}"
    return None


def missing_summary(summary: Mapping[str, Any], data: xr.Dataset) -> str | None:
    """First missing item of a summary, in words; None if it is complete."""
    # keys of a summary with the types of their values
    bodies = [str(body) for body in data.body.values]
    span = dict.fromkeys(("min_m", "max_m", "rms_m", "final_m"), Number)
    contact = {"force_n": Number, "contact": Name, "time_s": Maybe}
    wheel = {"speed_rad_s": Number, "wheel": Name, "time_s": Maybe, "least_margin": Maybe}
    motion = dict.fromkeys(("max_rotation_deg", "max_travel_m"), Number)
    momentum: dict[str, Any] = {"conserved": bool, "reason": str}
    if not data.attrs["outside"]:
        momentum = {"conserved": bool}
        for kind, unit in KINDS:
            numbers = (f"drift_{unit}", f"largest_partial_{unit}", "relative_drift")
            momentum[kind] = {f"initial_{unit}": list, **dict.fromkeys(numbers, Number)}
    expected = {
        "name": str,
        "status": {
            "state": str,
            "reached_s": Number,
            "diverged_at_s": Maybe,
            "trusted": bool,
            "open": list,
            "advice": Name,
            "cause": Name,
        },
        "outcome": Name,
        "events": list,
        "tip_error": {str(tip): dict.fromkeys((*"xyz", "norm"), span) for tip in data.tip.values},
        "target": motion if "target" in bodies else type(None),
        "bases": {body: motion for body in bodies if body != "target"},
        "greatest_torque": {"torque_n_m": Number, "unit": str, "joint": Name, "time_s": Maybe},
        "greatest_grip": {"force_n": Number, "grasp": Name, "time_s": Maybe},
        **({"greatest_contact": contact} if "contact" in data.coords else {}),
        **({"attitude_error": dict} if "base_attitude_error" in data else {}),
        **({"propellant_kg": dict} if "propellant" in data else {}),
        **({"fastest_wheel": wheel} if "wheel" in data.dims else {}),
        "fastest_joint": {"rate": Number, "unit": str, "joint": Name, "time_s": Maybe},
        "ledger": {"momentum": momentum, "energy": _ENERGY},
        "engine": {"name": str, "backend": str, "step_s": Maybe, "steps": Number},
        "timing_s": dict.fromkeys(("closed_loop", "compile_or_load", "rollout", "total"), Number),
        "assumptions": list,
        "warnings": list,
        "urdf_sha256": dict.fromkeys(bodies, str),
        "versions": {"spacerobot": str, "python": str},
    }
    message = _missing(expected, summary, "")
    if message is not None:
        return message
    events = enumerate(summary["events"])
    return next(filter(None, (_missing(_EVENT, event, f"events.{k}") for k, event in events)), None)


_EVENT = {"time_s": Number, "kind": str, "who": str}
_ENERGY = dict.fromkeys(
    (
        *("actuator_work_j", "stored_change_j", "joint_loss_j", "grasp_loss_j", "constraint_work_j"),
        *("largest_residual_j", "largest_energy_j", "relative_residual"),
    ),
    Number,
)


def _missing(expected: Any, actual: Any, path: str) -> str | None:
    """First missing key or value of a wrong type, in words; None if there is none."""
    if not isinstance(expected, dict):
        right = isinstance(actual, expected) and not (isinstance(actual, bool) and expected is not bool)
        return None if right else f"{path}: found {str(actual)[:40]!r}, which it cannot be"
    if not isinstance(actual, Mapping):
        return f"{path}: found {str(actual)[:40]!r}, allowed: a mapping"
    for key, inner in expected.items():
        place = f"{path}.{key}" if path else key
        if key not in actual:
            return f"no {place}"
        message = _missing(inner, actual[key], place)
        if message is not None:
            return message
    return None
