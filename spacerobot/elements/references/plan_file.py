"""A plan's file: motions of a robot's joints and of a tip, in the form of a scenario's sections."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.errors import ScenarioError, near_names

if TYPE_CHECKING:
    import xarray as xr

MOST_BYTES = 100_000_000
JOINTS = ("joint_position", "joint_rate", "torque")
BASES = ("base_wrench", "base_rate")
TIPS = ("tip_position", "tip_velocity", "tip_rotation", "tip_spin")


def read_joints(file: Path, where: str, phase: str | None = None) -> Mapping[str, Any]:
    """Joint motion in a plan, as plain data, of the robot with a section at a dotted path.

    Args:
        file: Dataset of the plan.
        where: Dotted path of the section.
        phase: Phase of the plan; None for the whole plan.

    Raises:
        ScenarioError: If the file is no plan, or has no such phase or no joints of that robot.
    """
    plan, robot = parted(_during(open_plan(file, JOINTS), phase)), _keys(where)[1]
    owners = {str(label).partition("/")[0] for label in plan.joint.values}
    if robot not in owners:
        raise ScenarioError(f"a plan without robot {robot!r}; {near_names(robot, owners)}", source=file)
    robot_plan = plan.sel(joint=[label for label in plan.joint.values if str(label).startswith(f"{robot}/")])
    position, rate, effort = (numbers(robot_plan, name, ("time", "joint")) for name in JOINTS)
    return _timed(plan) | {
        "joints": [str(label).partition("/")[2] for label in robot_plan.joint.values],
        "position": position.tolist(),
        "rate": rate.tolist(),
        "effort": effort.tolist(),
    }


def read_base(file: Path, where: str, phase: str | None = None) -> Mapping[str, Any]:
    """Wrench on a base in a plan, as plain data, of the robot with a section at a dotted path.

    Args:
        file: Dataset of the plan.
        where: Dotted path of the section.
        phase: Phase of the plan; None for the whole plan.

    Raises:
        ScenarioError: If the file is no plan, has no such phase, or does not drive the base of that robot.
    """
    plan, robot = parted(_during(open_plan(file, BASES), phase)), _keys(where)[1]
    labels = [str(label) for label in plan.drive.values if str(label).startswith(f"{robot}/")]
    if not labels:
        owners = {str(label).partition("/")[0] for label in plan.drive.values}
        raise ScenarioError(f"a plan that does not drive the base of {robot!r}; {near_names(robot, owners)}")
    robot_plan = plan.sel(drive=labels)
    wrench, rate = (numbers(robot_plan, name, ("time", "drive")).tolist() for name in BASES)
    axes = [label.rpartition(".")[2] for label in labels]
    return _timed(plan) | {"axes": axes, "wrench": wrench, "rate": rate}


def _timed(plan: xr.Dataset) -> dict[str, Any]:
    """Times, points of an interval, and phases, plain."""
    times = plan.time.values
    phases = {name: [float(times[a]), float(times[b])] for name, (a, b) in phase_rows(plan).items()}
    return {"times": times.tolist(), "points": points_of(plan), "phases": phases}


def read_tip(file: Path, where: str) -> Mapping[str, Any]:
    """Motion of a tip in a plan, as plain data; only that of the phase if the path is in one.

    Raises:
        ScenarioError: If the file is no plan, or does not have that tip.
    """
    plan, keys = open_plan(file, TIPS), _keys(where)
    if keys[2:3] != ["tips"]:
        raise ScenarioError("a plan leads tips, so it is no reference of the target", where=where)
    label = f"{keys[1]}/{keys[3]}"
    tips = [str(name) for name in plan.tip.values]
    if label not in tips:
        raise ScenarioError(f"a plan without tip {label!r}; {near_names(label, tips)}", source=file)
    phases, name = phase_rows(plan), where.split(".")[1]
    if where.startswith("phases.") and name in phases:
        plan = _during(plan, name)
    tip_plan = parted(plan.sel(tip=label))
    position, velocity, rotation, spin = (numbers(tip_plan, name, ("time", "axis")).tolist() for name in TIPS)
    times = (tip_plan.time.values - tip_plan.time.values[0]).tolist()
    return {
        "times": times,
        "points": points_of(plan),
        "position": position,
        "velocity": velocity,
        "rotation": rotation,
        "spin": spin,
    }


def _keys(where: str) -> list[str]:
    """Keys of a dotted path, without the phase."""
    keys = where.split(".")
    return keys[2:] if keys[0] == "phases" else keys


def open_plan(file: Path, names: tuple[str, ...]) -> xr.Dataset:
    """Content of a plan's file that has these variables.

    Raises:
        ScenarioError: If it cannot be read or lacks one.
    """
    import xarray as xr  # takes as long to load as all sections of a scenario

    try:
        if file.stat().st_size > MOST_BYTES:
            raise ScenarioError(f"larger than {MOST_BYTES // 1_000_000} MB, so not a plan", source=file)
        with xr.open_dataset(file, engine="netcdf4") as opened:
            if opened.nbytes > MOST_BYTES:  # before it is unpacked
                raise ScenarioError(f"unfolds to {opened.nbytes / 1e6:.0f} MB, so not a plan", source=file)
            plan = opened.load()
    except FileNotFoundError:
        raise ScenarioError("no such file", source=file) from None
    except (OSError, ValueError, RuntimeError, KeyError, AttributeError, TypeError, IndexError):
        raise ScenarioError("not a plan: it cannot be read as netCDF", source=file) from None
    lacking = [name for name in ("time", *names) if name not in plan.variables]
    if lacking:
        raise ScenarioError(f"not a plan: no {', '.join(lacking)}; `spacerobot plan` writes one", source=file)
    return plan


def numbers(plan: xr.Dataset, name: str, dims: tuple[str, str]) -> Array:
    """Numbers of a variable, (n, m).

    Raises:
        ScenarioError: If they are not of these dimensions, or not finite.
    """
    variable = plan[name]
    if set(variable.dims) != set(dims):
        dimensions = ", ".join(map(str, variable.dims))
        raise ScenarioError(f"{name}: found dimensions {dimensions}, allowed: {', '.join(dims)}")
    values = np.asarray(variable.transpose(*dims).values, dtype=float)
    if not np.isfinite(values).all():
        raise ScenarioError(f"{name}: holds what is no number; plan again")
    return values


def points_of(plan: xr.Dataset) -> int:
    """Points of an interval between two knots."""
    points = plan.attrs.get("points", 2)
    return int(points) if isinstance(points, int | np.integer) else 0


def _during(plan: xr.Dataset, phase: str | None) -> xr.Dataset:
    """Rows of one phase, with time from its start; all rows if ``phase`` is None.

    Raises:
        ScenarioError: If the phase does not exist.
    """
    phases = phase_rows(plan)
    if phase is None:
        if len(phases) > 1 and (np.diff(plan.time.values) == 0).any():
            raise ScenarioError(f"a plan of several phases: name one by `phase`: {', '.join(phases)}")
        return plan
    if phase not in phases:
        raise ScenarioError(f"a plan without phase {phase!r}; {near_names(phase, phases)}")
    first, last = phases[phase]
    phase_plan = plan.isel(time=slice(first, last + 1)).drop_vars("phase")
    return phase_plan.assign_coords(time=phase_plan.time - phase_plan.time[0])


def parted(plan: xr.Dataset) -> xr.Dataset:
    """Plan whose intervals have rows of their own at both ends, since forces jump at some knots."""
    times, step, rows, first = plan.time.values, points_of(plan) - 1, list[int](), 0
    if (np.diff(times) > 0).all() or step < 1:
        return plan
    while first + step < len(times):
        rows += range(first, first + step + 1)
        first += step
        first += int(first + 1 < len(times) and times[first + 1] == times[first])
    return plan.isel(time=rows)


def phase_rows(plan: xr.Dataset) -> dict[str, tuple[int, int]]:
    """First and last row of each phase of a plan, by name; empty if it has no phases.

    A phase ends with its own row at the start time of the next phase, or with that phase's first row.
    """
    if "phase" not in plan.variables:
        return {}
    names, times = [str(name) for name in plan.phase.values], plan.time.values
    starts = [i for i, name in enumerate(names) if i == 0 or names[i - 1] != name]
    ends = [i - 1 if times[i - 1] == times[i] else i for i in starts[1:]] + [len(names) - 1]
    return {names[a]: (a, b) for a, b in zip(starts, ends, strict=True) if names[a]}
