"""Headline numbers of a result."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.result.dataset import AXES

if TYPE_CHECKING:
    import xarray as xr


def tip_errors(data: xr.Dataset) -> dict[str, dict[str, dict[str, float]]]:
    """Minimum, maximum, RMS and final value [m] of each tip's error along each axis and of its norm."""
    statistics, errors = {}, data.tip_error.values
    for k, tip in enumerate(data.tip.values):
        error = errors[:, k]
        statistics[str(tip)] = {axis: _statistics(error[:, i]) for i, axis in enumerate(AXES)} | {
            "norm": _statistics(np.sqrt((error**2).sum(axis=1)))
        }
    return statistics


def _statistics(values: np.ndarray[Any, Any]) -> dict[str, float]:
    return {
        "min_m": float(values.min()),
        "max_m": float(values.max()),
        "rms_m": float(np.sqrt(np.mean(values**2))),
        "final_m": float(values[-1]),
    }


def body_motion(data: xr.Dataset) -> dict[str, dict[str, float]]:
    """Maximum rotation [deg] and travel [m] of each body since the start.

    The rotation is the net rotation from the initial attitude, including full turns: the length of the
        rotation
    vector that is continuous in time. It decreases when a body turns back.
    """
    position, rotation = data.body_position.values, data.body_rotation.values
    travel = np.sqrt(((position - position[0]) ** 2).sum(axis=-1)).max(axis=0)
    if "body_angle" in data:
        angle = data.body_angle.values
        angles = np.abs(angle - angle[0]).max(axis=0)
    else:
        angles = np.array([_unwrapped_angle(rotation[:, k]).max() for k in range(rotation.shape[1])])
    return {
        str(body): {"max_rotation_deg": float(np.degrees(angles[k])), "max_travel_m": float(travel[k])}
        for k, body in enumerate(data.body.values)
    }


def _unwrapped_angle(rotation: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Length (nt,) [rad] of the continuous rotation vector, from the shortest rotation vectors (nt, 3).

    The rotation vectors of an attitude are (angle + 2 pi n) times its axis, with integer n. The continuous
    one is nearest to its predecessor.
    """
    size: np.ndarray[Any, Any] = np.sqrt((rotation**2).sum(axis=1))
    if not size.max(initial=0.0) > np.pi / 2:  # false for a NaN as well
        return size
    previous, unwrapped = rotation[0], size.copy()
    for i, (vector, angle) in enumerate(zip(rotation, size, strict=True)):
        if angle > 0:
            axis = vector / angle
            turns = np.round((previous @ axis - angle) / (2 * np.pi))
            unwrapped[i] = abs(angle + 2 * np.pi * turns)
            previous = (angle + 2 * np.pi * turns) * axis
        else:
            unwrapped[i] = 2 * np.pi * np.round(np.linalg.norm(previous) / (2 * np.pi))
    return unwrapped


def greatest_torque(data: xr.Dataset) -> dict[str, Any]:
    """Largest joint torque [N m], or force [N] of a prismatic joint, with its unit, joint and time."""
    largest = _greatest(data, np.abs(data.variables["joint_torque"].values), "joint", "torque_n_m")
    return largest | {"unit": "N" if _slides(data, largest["joint"]) else "N m"}


def fastest_joint(data: xr.Dataset) -> dict[str, Any]:
    """Largest joint rate [rad/s], or speed [m/s] of a prismatic joint, with its unit, joint and time."""
    fastest = _greatest(data, np.abs(data.variables["joint_velocity"].values), "joint", "rate")
    return fastest | {"unit": "m/s" if _slides(data, fastest["joint"]) else "rad/s"}


def _slides(data: xr.Dataset, joint: str | None) -> bool:
    kinds = dict(zip(data.variables["joint"].values, data.variables["joint_kind"].values, strict=True))
    return joint is not None and kinds[joint] == "prismatic"


def greatest_grip(data: xr.Dataset) -> dict[str, Any]:
    """Largest grasp force [N] with its grasp and time."""
    return _greatest(data, _sizes(data, "grasp_force"), "grasp", "force_n")


def greatest_contact(data: xr.Dataset) -> dict[str, Any]:
    """Largest contact force [N] of the samples, with its contact and time.

    An impact that is shorter than the distance of the samples may peak between them; a smaller
    ``simulation.output_step`` shows the peak.
    """
    return _greatest(data, _sizes(data, "contact_force"), "contact", "force_n")


def _sizes(data: xr.Dataset, name: str) -> Array:
    """Norms (nt, n) of vectors; 0 for NaN."""
    return np.asarray(np.sqrt(np.nansum(data.variables[name].values ** 2, axis=-1)))


def attitude_errors(data: xr.Dataset) -> dict[str, dict[str, float]]:
    """Maximum and final attitude error [deg] of each base with attitude control."""
    size = np.degrees(np.sqrt((data.base_attitude_error**2).sum("axis", skipna=False)))
    errors = size.dropna("body", how="all")
    return {
        str(body): {
            "max_deg": float(errors.sel(body=body).max()),
            "final_deg": float(errors.sel(body=body)[-1]),
        }
        for body in errors.body.values
    }


def propellant(data: xr.Dataset) -> dict[str, float]:
    """Propellant consumed by the thrusters of each body [kg]."""
    masses = data.propellant.dropna("body", how="all").isel(time=-1)
    return {str(body): float(masses.sel(body=body)) for body in masses.body.values}


def fastest_wheel(data: xr.Dataset) -> dict[str, Any]:
    """Largest speed of a reaction wheel [rad/s] with its wheel and time, and the smallest relative margin."""
    margins = np.array(data["wheel_margin"].values if "wheel_margin" in data else np.nan)
    finite = margins[np.isfinite(margins)]
    fastest = _greatest(data, np.abs(data.variables["wheel_speed"].values), "wheel", "speed_rad_s")
    return fastest | {"least_margin": float(finite.min()) if finite.size else None}


def _greatest(data: xr.Dataset, size: Array, dimension: str, key: str) -> dict[str, Any]:
    if size.size == 0:
        return {key: 0.0, dimension: None, "time_s": None}
    row, column = np.unravel_index(int(size.argmax()), size.shape)
    return {
        key: float(size[row, column]),
        dimension: str(data.variables[dimension].values[column]),
        "time_s": float(data.variables["time"].values[row]),
    }
