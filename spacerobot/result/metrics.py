"""Headline numbers of a result."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from spacerobot.result.dataset import AXES


def tip_errors(data: xr.Dataset) -> dict[str, dict[str, dict[str, float]]]:
    """Minimum, maximum, RMS and final tip error [m] by tip and axis, and of its norm."""
    found = {}
    for tip in data.tip.values:
        error = data.tip_error.sel(tip=tip)
        norm = np.sqrt((error**2).sum("axis"))
        found[str(tip)] = {axis: _statistics(error.sel(axis=axis).values) for axis in AXES} | {
            "norm": _statistics(norm.values)
        }
    return found


def _statistics(values: np.ndarray[Any, Any]) -> dict[str, float]:
    return {
        "min_m": float(values.min()),
        "max_m": float(values.max()),
        "rms_m": float(np.sqrt(np.mean(values**2))),
        "final_m": float(values[-1]),
    }


def body_motion(data: xr.Dataset) -> dict[str, dict[str, float]]:
    """Greatest rotation [deg] and travel [m] of each body since the start.

    In a planar scene whole turns count; in space a rotation is the shortest one, at most 180 deg.
    """
    moved = data.body_position - data.body_position.isel(time=0)
    travel = np.sqrt((moved**2).sum("axis")).max("time")
    turned = np.sqrt((data.body_rotation**2).sum("axis"))
    if "body_angle" in data:
        turned = np.abs(data.body_angle - data.body_angle.isel(time=0))
    rotation = np.degrees(turned.max("time"))
    return {
        str(body): {
            "max_rotation_deg": float(rotation.sel(body=body)),
            "max_travel_m": float(travel.sel(body=body)),
        }
        for body in data.body.values
    }


def greatest_torque(data: xr.Dataset) -> dict[str, Any]:
    """Greatest actuator torque [N m], or force [N] of a prismatic joint, its unit, where and when."""
    found = _greatest(data.joint_torque, "joint", "torque_n_m")
    return found | {"unit": "N" if _slides(data, found["joint"]) else "N m"}


def fastest_joint(data: xr.Dataset) -> dict[str, Any]:
    """Greatest joint rate [rad/s], or speed [m/s] of a prismatic joint, its unit, where and when."""
    found = _greatest(data.joint_velocity, "joint", "rate")
    return found | {"unit": "m/s" if _slides(data, found["joint"]) else "rad/s"}


def _slides(data: xr.Dataset, joint: str | None) -> bool:
    return joint is not None and bool(data.joint_kind.sel(joint=joint) == "prismatic")


def greatest_grip(data: xr.Dataset) -> dict[str, Any]:
    """Greatest grip force, where and when."""
    force = np.sqrt((data.grasp_force**2).sum("axis"))
    return _greatest(force.transpose("time", "grasp"), "grasp", "force_n")


def _greatest(values: xr.DataArray, dimension: str, key: str) -> dict[str, Any]:
    size = np.abs(values.values)
    if size.size == 0:
        return {key: 0.0, dimension: None, "time_s": None}
    row, column = np.unravel_index(int(size.argmax()), size.shape)
    return {
        key: float(size[row, column]),
        dimension: str(values[dimension].values[column]),
        "time_s": float(values.time.values[row]),
    }
