"""Path constraints: bounds of the unknowns, and the kinds of the plan's limits as rows."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping

import casadi as ca
import numpy as np

from optim.planning.formulation.base_actuation import base_wrench_limits
from optim.planning.formulation.grasps import wrench_axes
from optim.planning.formulation.instant_view import AXES, InstantView
from optim.planning.formulation.reaction_wheels import wheel_rows
from optim.planning.formulation.stage import DrivenCoordinates, Stage
from spacerobot.common.arrays import Array
from spacerobot.description.parts import UrdfJoint as UrdfJoint
from spacerobot.elements.goals.plan_instant import BoundedRow
from spacerobot.elements.limits.plan_limit import JointQuantity, PlanLimit, PlannedJoint
from spacerobot.scenario.plan import PlanSection
from spacerobot.scene import Scene
from spacerobot.scene.scene import SceneBody

PREFIX = "collision_avoidance"
"""Prefix of the names of keep-out zones that are added for colliding links."""
Limits = Mapping[str, PlanLimit]
"""A plan's ``limits``, by name."""


def driven_coordinates(scene: Scene, section_limits: Limits) -> DrivenCoordinates:
    """Joints that are planned, and bases that actuators drive.

    Raises:
        ScenarioError: If a URDF lacks a required limit, or a joint mimics another one.
    """
    if scene.ties:
        raise scene.error(
            f"{scene.model.names[scene.ties[0].joint]} mimics another joint, which plans do not know; lock "
            "it by `locked: true`",
            "plan",
        )
    names, columns, limits, joints = [], [], [], []
    for body in scene.robots:
        for joint in body.driven_joints:
            planned = planned_joint(scene, body, joint)
            for name, limit in section_limits.items():
                for fault in limit.faults(planned):
                    raise scene.error(fault, f"plan.limits.{name}")
            names.append(str(scene.model.names[joint]))
            columns.append(int(scene.model.idx_vs[joint]))
            joints.append(int(joint))
            torque_limit = body.config.joints[body.joint_name(scene.model, joint)].torque_limit
            limits.append(min(torque_limit or np.inf, _least(section_limits, planned, "torque")))
    for body in scene.robots:
        if not body.root_joint:
            continue
        first, size = int(scene.model.idx_vs[body.root_joint]), int(scene.model.nvs[body.root_joint])
        most = base_wrench_limits(section_limits, body, size == 3).largest
        for k, axis in enumerate((0, 1, 5) if size == 3 else range(6)):
            if most[axis]:
                names.append(f"{body.name}/base.{AXES[axis]}")
                columns.append(first + k)
                limits.append(float(most[axis]))
    return DrivenCoordinates(tuple(names), tuple(columns), np.array(limits, dtype=float), tuple(joints))


def instant_limits(stage: Stage, limits: Limits) -> tuple[Array, Array]:
    """Lower and upper limits of an instant z (nz,)."""
    scene, model = stage.scene, stage.scene.model
    upper = np.full(stage.z.numel(), np.inf)
    lower = -upper
    for body in scene.robots:
        for joint in body.driven_joints:
            urdf, pin_joint = urdf_joint(scene, body, joint), model.joints[joint]
            if pin_joint.nq == 1:
                lower[pin_joint.idx_q], upper[pin_joint.idx_q] = urdf.lower, urdf.upper
            place = model.nq + pin_joint.idx_v
            upper[place] = min(urdf.velocity, _least(limits, planned_joint(scene, body, joint), "rate"))
            lower[place] = -upper[place]
    first = model.nq + 2 * model.nv
    last = first + stage.u.numel()
    lower[first:last], upper[first:last] = -stage.driven.limits, stage.driven.limits
    lower[stage.z.numel() - stage.s.numel() :] = 0.0
    return lower, upper


def path_rows(stage: Stage, plan: PlanSection) -> list[BoundedRow]:
    """Path constraints in addition to the limits of z, without keep-out zones of colliding links."""
    # acceleration constraints of closed rigid grasps
    names = [f"{grip.name}.{axis}" for grip in stage.grips for axis in wrench_axes(stage.scene, grip)]
    rows = [
        BoundedRow(f"hold of {name}", "m/s^2 or rad/s^2", value, 0.0, 0.0)
        for name, value in zip(names, ca.vertsplit(stage.parting), strict=True)
    ]
    rows += wheel_rows(stage, plan)
    for section, name, limit in plan.every_limit():
        if not name.startswith(PREFIX):
            rows += limit_rows(stage, plan, section, name, limit)
    return rows


def avoidance_rows(stage: Stage, plan: PlanSection, excluded: Collection[str] = ()) -> list[BoundedRow]:
    """Constraints of the keep-out zones of colliding links; a path's last rows.

    Args:
        stage, plan: An instant, and the plan section.
        excluded: Names of zones that are left out.
    """
    return [
        row
        for name, limit in plan.keep_out.items()
        if name.startswith(PREFIX) and name not in excluded
        for row in limit_rows(stage, plan, "keep_out", name, limit)
    ]


def limit_rows(
    stage: Stage, plan: PlanSection, section: str, name: str, limit: PlanLimit
) -> list[BoundedRow]:
    """Constraints of one limit, named after the limit if its name differs from its kind's."""
    prefix = "" if name == limit.kind else f"{name}: "
    bounded_rows = limit.rows(InstantView(stage, f"plan.{section}.{name}", plan.goals))
    return [dataclasses.replace(row, name=f"{prefix}{row.name}") for row in bounded_rows]


def urdf_joint(scene: Scene, body: SceneBody, joint: int) -> UrdfJoint:
    """Joint's entry in its body's URDF."""
    name = body.joint_name(scene.model, joint)
    return next(candidate for candidate in body.description.joints if candidate.name == name)


def planned_joint(scene: Scene, body: SceneBody, joint: int) -> PlannedJoint:
    """Joint as plan limits use it: name, type, quantities that are limited already, and the URDF's name."""
    urdf = urdf_joint(scene, body, joint)
    has = {
        "position": urdf.kind == "continuous" or bool(np.isfinite([urdf.lower, urdf.upper]).all()),
        "rate": bool(np.isfinite(urdf.velocity)),
        "torque": body.config.joints[urdf.name].torque_limit is not None,
    }
    limited = frozenset(key for key, there in has.items() if there)
    return PlannedJoint(f"{body.name}/{urdf.name}", urdf.kind, limited, body.description.path.name)


def _least(limits: Limits, joint: PlannedJoint, key: JointQuantity) -> float:
    """Smallest limit of a joint's rate or torque; infinite without a limit."""
    return min((limit.joint_limits(joint).get(key, np.inf) for limit in limits.values()), default=np.inf)
