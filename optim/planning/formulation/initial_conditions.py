"""Initial conditions of a motion: the scenario's state, or bounds on free postures and placements."""

from __future__ import annotations

import casadi as ca
import numpy as np

from optim.planning.formulation.instant_view import find_robot, joints_named
from optim.planning.formulation.path_constraints import urdf_joint
from optim.planning.formulation.stage import Stage
from spacerobot.common.arrays import Array
from spacerobot.elements.goals.plan_instant import BoundedRow
from spacerobot.scenario.plan import PlanSection

Sides = tuple[Array, Array]
"""Lower and upper bounds of configuration and velocity at the start (nq + nv,)."""


def initial_conditions(
    stage: Stage, plan: PlanSection, fixed: Array, limits: Sides
) -> tuple[Sides | None, list[BoundedRow]]:
    """Bounds of the initial state, None if nothing is free, and further constraints at the start.

    Args:
        stage, plan: Instant of the motion, and the plan section.
        fixed: Initial state of the scenario (nq + nv,).
        limits: Lower and upper limits of an instant (nz,), with the ranges of joints.

    Raises:
        ScenarioError: If the section frees something that the scene lacks, or a quantity on which others
            depend.
    """
    if not plan.start:
        return None, []
    model = stage.scene.model
    sides = least, greatest = fixed.copy(), fixed.copy()
    rows: list[BoundedRow] = []
    for name, room in plan.start.items():
        where = f"plan.start.{name}"
        body = find_robot(stage.scene, name, where)
        for _, joint, freedom in joints_named(stage.scene, body, room.joints, f"{where}.joints"):
            # refuse an angle for a prismatic joint, and an offset for a revolute one
            urdf = urdf_joint(stage.scene, body, joint)
            key = "offset" if urdf.kind == "prismatic" else "angle_deg"
            if getattr(freedom, key) is None:
                raise stage.scene.error(f"{urdf.name} is {urdf.kind}: give `{key}`", f"{where}.joints")
            joint_model = model.joints[joint]
            reach = np.radians(freedom.angle_deg or 0.0) + (freedom.offset or 0.0)
            if joint_model.nq == 2:
                rows.append(_turned(stage, joint_model.idx_q, reach, sides, f"start of {model.names[joint]}"))
            else:
                least[joint_model.idx_q] -= reach
                greatest[joint_model.idx_q] += reach
        if room.places:
            if not body.root_joint:
                raise stage.scene.error(
                    f"the base of {body.name!r} is fixed; give it `joint: planar` or `free_flyer` to "
                    "place it",
                    where,
                )
            joint_model = model.joints[body.root_joint]
            if (joint_model.nv == 3 and room.position[2]) or (joint_model.nv == 6 and room.rotation_deg):
                key = "position" if joint_model.nv == 3 else "rotation_deg"
                message = (
                    "a planar base stays in its plane"
                    if joint_model.nv == 3
                    else "only a planar base begins turned"
                )
                raise stage.scene.error(message, f"{where}.{key}")
            axes = 2 if joint_model.nv == 3 else 3
            least[joint_model.idx_q : joint_model.idx_q + axes] -= room.position[:axes]
            greatest[joint_model.idx_q : joint_model.idx_q + axes] += room.position[:axes]
            if room.rotation_deg:
                turn = np.radians(room.rotation_deg)
                rows.append(
                    _turned(stage, joint_model.idx_q + 2, turn, sides, f"start of {body.name}'s base")
                )
    # refuse a free placement where another quantity is relative to it, and a free start of a held body
    if stage.grips:
        raise stage.scene.error(
            f"grasp {stage.grips[0].name!r} begins closed, so the start is given by it", "plan.start"
        )
    counted = [
        f"costs.{name}" for name, one in plan.costs.items() if one.weight and one.weighs.relative_to_start
    ]
    counted += [f"limits.{name}" for name, one in plan.limits.items() if one.relative_to_start]
    if counted and any(room.places for room in plan.start.values()):
        raise stage.scene.error(
            f"{counted[0]} counts from where bases begin, and that is free; leave one of the two out",
            "plan.start",
        )
    lower, upper = (side[: fixed.size] for side in limits)
    least = np.maximum(least, np.minimum(lower, fixed))
    return (least, np.minimum(greatest, np.maximum(upper, fixed))), rows


def _turned(stage: Stage, place: int, reach: float, sides: Sides, name: str) -> BoundedRow:
    """Bound, in place, an angle's cosine and sine, free by ``reach`` [rad]; returns cos^2 + sin^2 - 1 = 0."""
    angle = float(np.arctan2(sides[0][place + 1], sides[0][place]))
    angles = angle + np.linspace(-reach, reach, 721)
    for k, values in enumerate((np.cos(angles), np.sin(angles))):
        sides[0][place + k], sides[1][place + k] = values.min(), values.max()
    pair = stage.q[place : place + 2]
    return BoundedRow(name, "1", ca.sumsqr(pair) - 1, 0.0, 0.0, first=True)
