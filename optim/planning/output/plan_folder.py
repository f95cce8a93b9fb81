"""Files of a plan: ``plan.nc``, its summary, and the scenario that follows it.

``plan.nc`` has over ``time``, from 0:

- ``joint_position``, ``joint_rate``, ``torque`` of every ``robot/joint``, angles unwound;
- ``tip_position``, ``tip_velocity``, ``tip_rotation`` (rotation vector), ``tip_spin`` of every ``robot/tip``,
  world axes;
- ``base_wrench``, ``base_rate``, ``base_wrench_limit`` of drives such as ``robot/base.fx``: commanded forces
  and torques, velocities, lower and upper limits, in the axes of the root link;
- ``grip_wrench`` of grasps on tips such as ``grasp.fx``, world axes;
- ``multiplier_norm``, optional: multipliers as densities over time, unused by tracking; ``phase``, optional.

With s points per interval (attribute ``points`` of ``time``, both ends included, default 2) positions are the
polynomial of degree 2 s - 1 through values and rates; torques are one of degree s - 1.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
import xarray as xr

from optim.json_files import write_json
from optim.planning.formulation.base_actuation import limiting_actuators
from optim.planning.formulation.formulate import plan_section
from optim.planning.formulation.grasps import wrench_axes
from optim.planning.formulation.reaction_wheels import commanded_base_wrench
from optim.planning.output.constraint_values import constraint_variables, multiplier_norms
from optim.planning.output.following_scenario import PLAN, following_scenario, handover_warnings, plan_phase
from optim.planning.search.make_plan import PlanSolution
from optim.planning.transcription.motion import Motion
from spacerobot.common.arrays import Array
from spacerobot.common.errors import ResultError
from spacerobot.common.files import StrPath, readable, staged, write_text
from spacerobot.common.interrupts import uninterrupted
from spacerobot.common.version import __version__
from spacerobot.elements.core.registry import plugin_records
from spacerobot.scenario.load import to_yaml
from spacerobot.scene import Scene

SUMMARY, FOLLOWED, SCENARIO = "plan.json", "followed.yaml", "scenario.yaml"
AXES = ["x", "y", "z"]
DIMENSIONS: dict[str, tuple[str, ...]] = {
    "time": ("time",),
    "q": ("time", "configuration"),
    **dict.fromkeys(("v", "acceleration"), ("time", "velocity")),
    **dict.fromkeys(("torque", "joint_position", "joint_rate", "joint_acceleration"), ("time", "joint")),
    **dict.fromkeys(("tip_position", "tip_velocity", "tip_rotation", "tip_spin"), ("time", "tip", "axis")),
    **{name: (name,) for name in ("joint", "tip", "axis")},
}
"""Variables and coordinates that every plan has, with their dimensions."""


def dataset(planned: PlanSolution) -> xr.Dataset:
    """Plan as labelled arrays, with one row for each mesh point and two where phases meet."""
    phased_motion, scene = planned.phased_motion, planned.scene
    model, driven = scene.model, planned.motion.problem.stage.driven
    stages = [motion.problem.stage for motion in phased_motion.motions]
    count = len(driven.joints)
    drives = {
        name: column
        for stage in stages
        for name, column in zip(stage.driven.names[count:], stage.driven.columns[count:], strict=True)
    }
    grips = [
        f"{grip.name}.{axis}"
        for grip in scene.grasps
        if any(grip in (*stage.grips, *stage.springs) for stage in stages)
        for axis in wrench_axes(scene, grip)
    ]
    parts = [_over_time(scene, motion, drives, grips) for motion in phased_motion.motions]
    variables: dict[str, Any] = {
        name: (dims, np.concatenate([part[name][1] for part in parts]), description)
        for name, (dims, _, description) in parts[0].items()
    }
    norm_description = _attributes(
        "1", "norm of the multipliers of equations of motion and limits, as densities over time"
    )
    variables["multiplier_norm"] = ("time", multiplier_norms(planned), norm_description)
    solution, text = planned.solution, "for warm starts, in the program's order"
    variables["multiplier"] = (
        "equation",
        solution.multipliers,
        {"long_name": f"multipliers of constraints, {text}"},
    )
    variables["bound_multiplier"] = (
        "unknown",
        solution.bound_multipliers,
        {"long_name": f"multipliers of the unknowns' limits, {text}"},
    )
    alone = plan_phase(scene.scenario)
    names = planned.names if any(planned.names) else (alone,) * len(phased_motion.motions)
    if any(names):
        phases = [name for name, m in zip(names, phased_motion.motions, strict=True) for _ in m.time]
        variables["phase"] = ("time", phases, {"long_name": "phase of the scenario"})
    coordinates: dict[str, Any] = {
        "time": ("time", phased_motion.time, {"units": "s", "long_name": "time"}),
        "configuration": _entries(model, "nq"),
        "velocity": _entries(model, "nv"),
        "joint": list(driven.names[:count]),
        "tip": [tip.label for tip in scene.tips],
        "axis": AXES,
    }
    coordinates |= ({"drive": list(drives)} if drives else {}) | ({"grip": grips} if grips else {})
    held, sides = constraint_variables(phased_motion, planned.names)
    motion, verification = planned.motion, planned.verification
    text = to_yaml(planned.scene.scenario)
    attributes = {
        "scenario": hashlib.sha256(text.encode()).hexdigest(),
        "spacerobot": __version__,
        "status": "saddle point" if verification.saddle else "solved",
        "interpolation": "lobatto",
        "points": motion.lobatto.points,
        "intervals": sum(motion.intervals for motion in planned.phased_motion.motions),
        "order": 2 * motion.lobatto.points - 2,
        "duration_s": planned.phased_motion.duration_s,
        "cost": planned.cost,
        "residual": verification.residual,
        "barrier": planned.solution.barrier,
        "replay_error_m": verification.replay_error_m,
        "followed_error_m": verification.followed_error_m,
    }
    return xr.Dataset(variables | held, coordinates | sides, attributes)


def _over_time(scene: Scene, motion: Motion, drives: Mapping[str, int], grips: list[str]) -> dict[str, Any]:
    """Variables over the points of one phase; wrenches on other phases' axes and of their grasps are zero."""
    stage = motion.problem.stage
    driven, count = stage.driven, len(stage.driven.joints)
    columns = list(driven.columns[:count])
    q, v, a, u = motion.q, motion.v, motion.a, motion.u
    # Motion of all tips (n, tips, 3), world axes.
    model, data = scene.model, scene.model.createData()
    tips = {name: np.zeros((len(q), len(scene.tips), 3)) for name, _, _ in TIP_MOTION}
    world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    for i, (at, rate) in enumerate(zip(q, v, strict=True)):
        pin.forwardKinematics(model, data, np.array(at), np.array(rate))
        pin.updateFramePlacements(model, data)
        for k, tip in enumerate(scene.tips):
            twist = pin.getFrameVelocity(model, data, tip.frame, world)
            tips["tip_position"][i, k] = data.oMf[tip.frame].translation
            tips["tip_velocity"][i, k] = twist.linear
            tips["tip_rotation"][i, k] = pin.log3(data.oMf[tip.frame].rotation)
            tips["tip_spin"][i, k] = twist.angular
    variables: dict[str, Any] = {
        "q": (
            ("time", "configuration"),
            q,
            _attributes("m, rad or 1", "configuration in Pinocchio's coordinates"),
        ),
        "v": (("time", "velocity"), v, _attributes("m/s or rad/s", "velocity, of a base in its own axes")),
        "acceleration": (("time", "velocity"), a, _attributes("m/s^2 or rad/s^2", "acceleration, likewise")),
        "torque": (
            ("time", "joint"),
            u[:, :count],
            _attributes(_unit(scene, driven.joints, "N m or N"), "torques and forces of the joints"),
        ),
        "joint_position": (
            ("time", "joint"),
            scene.joint_positions(driven.joints, q),
            _attributes(_unit(scene, driven.joints, "rad or m"), "positions"),
        ),
        "joint_rate": (
            ("time", "joint"),
            v[:, columns],
            _attributes(_unit(scene, driven.joints, "rad/s or m/s"), "joint rates"),
        ),
        "joint_acceleration": (
            ("time", "joint"),
            a[:, columns],
            _attributes("rad/s^2 or m/s^2", "their rates"),
        ),
    }
    for name, unit, text in TIP_MOTION:
        variables[name] = (("time", "tip", "axis"), tips[name], _attributes(unit, text))
    if drives:
        attributes = _attributes("N or N m", "forces and torques commanded of bases, in their own axes")
        wrench_function = ca.Function("asked", [stage.z], [ca.densify(commanded_base_wrench(stage))])
        wrench = _spread(list(drives), driven.names[count:], np.array(wrench_function(motion.z.T).full()).T)
        variables["base_wrench"] = (("time", "drive"), wrench, attributes)
        attributes = _attributes("m/s or rad/s", "velocities and spins of bases along and about these axes")
        variables["base_rate"] = (("time", "drive"), v[:, list(drives.values())], attributes)
    if grips:
        attributes = _attributes("N or N m", "forces and torques of grasps on tips, world axes")
        closed = (*stage.grips, *stage.springs)
        wrench_labels = [f"{grip.name}.{axis}" for grip in closed for axis in wrench_axes(scene, grip)]
        wrenches = ca.vertcat(ca.SX(0, 1), *(part for grip in closed for part in stage.wrench(grip)))
        values = np.array(ca.Function("grip", [stage.z], [ca.densify(wrenches)])(motion.z.T).full()).T
        variables["grip_wrench"] = (("time", "grip"), _spread(grips, wrench_labels, values), attributes)
    return variables


def _spread(names: Sequence[str], columns: Sequence[str], values: Array) -> Array:
    """Columns of a phase's names placed among all names; zeros elsewhere."""
    spread = np.zeros((len(values), len(names)))
    spread[:, [names.index(name) for name in columns]] = values
    return spread


TIP_MOTION = (
    ("tip_position", "m", "tip positions, world axes"),
    ("tip_velocity", "m/s", "tip velocities, world axes"),
    ("tip_rotation", "rad", "rotation vectors of the tips' axes, world axes"),
    ("tip_spin", "rad/s", "angular velocities of the tips, world axes"),
)


def summary(planned: PlanSolution) -> dict[str, Any]:
    """Summary of a plan as plain data."""
    phased_motion, verification = planned.phased_motion, planned.verification
    phases = [
        {"name": name, "duration_s": motion.duration_s, "intervals": motion.intervals}
        for name, motion in zip(planned.names, phased_motion.motions, strict=True)
    ]
    return {
        "scenario": planned.scene.scenario.name,
        "duration_s": phased_motion.duration_s,
        "phases": phases if len(set(planned.names)) > 1 else [],
        "jumps_s": phased_motion.begins[1:].tolist() if len(set(planned.names)) == 1 else [],
        "intervals": sum(motion.intervals for motion in phased_motion.motions),
        "order": 2 * planned.motion.lobatto.points - 2,
        "unknowns": len(phased_motion.unknowns),
        "cost": planned.cost,
        "terms": dict(planned.terms),
        "verification": {
            "residual": verification.residual,
            "second_order": verification.status,
            "replay_error_m": dict(verification.replay_errors_m),
            "followed_error_m": dict(verification.followed_errors_m),
            "tolerance_m": verification.tolerance_m,
            "open_loop": verification.open_loop,
            "violations": [vars(violation) for violation in verification.violations],
        },
        "base_limits": limiting_actuators(planned.scene, plan_section(planned.scene).by_phase.values()),
        "collision_avoidance": {
            "pairs": planned.pairs,
            "kept_apart": [list(names) for names in planned.kept_apart],
        },
        "choices": [vars(one) for one in planned.candidates],
        "warnings": plan_warnings(planned),
        "evaluation": planned.backend,
        "solver_runs": [dict(vars(one)) for one in planned.runs],
        **({"plugins": plugins} if (plugins := plugin_records()) else {}),
    }


def plan_warnings(planned: PlanSolution) -> list[str]:
    """Warnings of a saddle point, and of goals after which controllers take over moving joints."""
    saddle = "the plan is a saddle point: nearby motions cost less; raise `plan.starts`"
    return [*([saddle] if planned.verification.saddle else []), *handover_warnings(planned)]


def write(planned: PlanSolution, folder: StrPath, sensitivities: Mapping[str, float] | None = None) -> None:
    """Write a plan; replace an existing one.

    Args:
        planned: The plan.
        folder: Folder of the plan.
        sensitivities: Derivatives of the optimal cost by scenario values, by dotted path; stored in the
            summary as ``cost_sensitivities``.

    Raises:
        ResultError: If the folder cannot be written; files that are not yet replaced are kept.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with uninterrupted(), staged(folder) as stage:
            data = dataset(planned)
            encoding = {str(name): {"zlib": True, "complevel": 1} for name in data.data_vars}
            data.to_netcdf(stage / PLAN, engine="netcdf4", encoding=encoding)
            (stage / PLAN).replace(folder / PLAN)
            summary_data = summary(planned) | (
                {"cost_sensitivities": dict(sensitivities)} if sensitivities else {}
            )
            write_json(folder / SUMMARY, summary_data)
            notes = "".join(f"# {line}\n" for line in handover_warnings(planned))
            write_text(folder / FOLLOWED, notes + to_yaml(following_scenario(planned)))
            write_text(folder / SCENARIO, to_yaml(planned.scene.scenario))
    except (OSError, RuntimeError) as fault:
        raise ResultError(f"cannot be written: {fault}", source=folder) from None


def read(folder: StrPath) -> tuple[xr.Dataset, dict[str, Any]]:
    """Data and summary of a stored plan, from ``plan.nc`` and ``plan.json``.

    Raises:
        ResultError: If they cannot be read.
    """
    folder = Path(folder)
    with readable("plan", folder):
        summary = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
        with xr.open_dataset(folder / PLAN, engine="netcdf4") as stored:
            data = stored.load()
    for name, damage in ((SUMMARY, _summary_fault(summary)), (PLAN, _data_fault(data))):
        if damage is not None:
            raise ResultError(f"damaged: {damage}; plan its scenario again", source=folder / name)
    return data, summary


def _summary_fault(summary: Any) -> str | None:
    """Name of a summary's first missing or malformed item, with the defect; None if it is complete."""
    number, items = (int, float), (list, dict)
    expected: dict[str, Any] = {
        "scenario": str,
        **dict.fromkeys(("duration_s", "cost", "intervals", "order", "unknowns"), number),
        "phases": list,
        "terms": dict,
        "verification": dict,
        "choices": list,
        "solver_runs": list,
        "collision_avoidance": dict,
    }
    inner: dict[str, Any] = {
        **dict.fromkeys(("residual", "tolerance_m"), number),
        **dict.fromkeys(("replay_error_m", "followed_error_m"), dict),
        "second_order": str,
        "violations": items,
    }
    for place, mapping, kinds in (
        ("", summary, expected),
        ("verification.", isinstance(summary, dict) and summary.get("verification"), inner),
    ):
        if not isinstance(mapping, dict):
            return f"found {str(mapping)[:40]!r}, allowed: a mapping"
        for key, kind in kinds.items():
            if key not in mapping:
                return f"no {place}{key}"
            if not isinstance(mapping[key], kind):
                return f"{place}{key}: found {str(mapping[key])[:40]!r}, which it cannot be"
    runs = summary["solver_runs"]
    return None if all(isinstance(run, dict) for run in runs) else "solver_runs: allowed: mappings"


def _data_fault(data: xr.Dataset) -> str | None:
    """Name of a plan's first missing or malformed variable, with the defect; None if it is complete."""
    for name, dims in DIMENSIONS.items():
        if name not in data.variables:
            return f"no variable {name!r}"
        stored_dims = tuple(map(str, data[name].dims))
        if stored_dims != dims:
            return f"{name}: found the dimensions {', '.join(stored_dims)}, allowed: {', '.join(dims)}"
        if dims[0] == "time" and not (
            np.issubdtype(data[name].dtype, np.number) and np.isfinite(data[name].values).all()
        ):
            return f"{name}: found something else than finite numbers"
        if dims[0] == "time" and "units" not in data[name].attrs:
            return f"{name}: no attribute 'units'"
    return None if data.sizes["time"] else "no sample"


def _unit(scene: Scene, joints: tuple[int, ...], either: str) -> str:
    """Common unit of joints; ``either`` if some are revolute and others prismatic."""
    slides = {"P" in scene.model.joints[joint].shortname().removeprefix("JointModel") for joint in joints}
    return either if len(slides) != 1 else either.split(" or ")[slides.pop()]


def _entries(model: Any, size: str) -> list[str]:
    """Name of each coordinate of a configuration or velocity."""
    entries = []
    for name, joint in zip(list(model.names)[1:], list(model.joints)[1:], strict=True):
        count = getattr(joint, size)
        entries += [str(name)] if count == 1 else [f"{name}[{k}]" for k in range(count)]
    return entries


def _attributes(unit: str, text: str) -> dict[str, str]:
    return {"units": unit, "long_name": text}
