"""What must hold at all times: limits of joints and bases, distances, approach cones."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import casadi as ca
import numpy as np

from optim.planning.formulation.bases import able
from optim.planning.formulation.costs import base_shifts, base_turns
from optim.planning.formulation.goals import Seen
from optim.planning.formulation.grips import axes_of
from optim.planning.formulation.sights import sight_row
from optim.planning.formulation.stage import Driven, Stage
from optim.planning.formulation.wheels import wheel_rows
from spacerobot.arrays import Array
from spacerobot.description.parts import Joint as UrdfJoint
from spacerobot.dynamics.joints import exact_directions, sparse
from spacerobot.elements.instant import About, Row, unit
from spacerobot.errors import ScenarioError
from spacerobot.scenario.plan import Bounds, Cone, Planning
from spacerobot.scene import Scene
from spacerobot.scene.contacts import find_pairs
from spacerobot.scene.scene import SceneBody, SceneShape
from spacerobot.shapes import Shape, gap_about, proximity

FORCES = ("fx", "fy", "fz", "tx", "ty", "tz")
"""Axes of what drives a base, in its own axes."""


def what_drives(scene: Scene, bounds: Bounds) -> Driven:
    """Joints that are planned, and bases that actuators drive.

    Raises
    ------
    ScenarioError
        If a limit that is asked for is missing in a URDF, or a joint mimics another one.
    """
    if scene.ties:
        raise ScenarioError(
            f"{scene.model.names[scene.ties[0].joint]} mimics another joint, which plans do not know; lock "
            "it by `locked: true`",
            source=scene.source,
            where="plan",
        )
    names, columns, limits, joints = [], [], [], []
    for body in scene.robots:
        for joint in body.driven_joints:
            urdf = urdf_joint(scene, body, joint)
            _check_given(scene, bounds, body, urdf)
            names.append(str(scene.model.names[joint]))
            columns.append(int(scene.model.idx_vs[joint]))
            joints.append(int(joint))
            given = body.config.joints[urdf.name].torque_limit
            limits.append(min(given or np.inf, bounds.torque or np.inf))
    for name, column, limit in _bases(scene, bounds):
        names.append(name)
        columns.append(column)
        limits.append(limit)
    return Driven(tuple(names), tuple(columns), np.array(limits, dtype=float), tuple(joints))


def instant_limits(stage: Stage, bounds: Bounds) -> tuple[Array, Array]:
    """Least and greatest z (nz,)."""
    scene, model = stage.scene, stage.scene.model
    upper = np.full(stage.z.numel(), np.inf)
    lower = -upper
    for body in scene.robots:
        for joint in body.driven_joints:
            urdf, pin_joint = urdf_joint(scene, body, joint), model.joints[joint]
            if pin_joint.nq == 1:
                lower[pin_joint.idx_q], upper[pin_joint.idx_q] = urdf.lower, urdf.upper
            given = bounds.joint_speed if urdf.kind == "prismatic" else bounds.joint_rate_deg
            asked = np.inf if given is None else given if urdf.kind == "prismatic" else np.radians(given)
            place = model.nq + pin_joint.idx_v
            upper[place] = min(urdf.velocity, asked)
            lower[place] = -upper[place]
    first = model.nq + 2 * model.nv
    last = first + stage.u.numel()
    lower[first:last], upper[first:last] = -stage.driven.limits, stage.driven.limits
    return lower, upper


def path_rows(stage: Stage, plan: Planning) -> list[Row]:
    """What must hold at all instants beside the limits of z."""
    rows = [*_base_rows(stage, plan.limits), *_grip_rows(stage, plan.limits), *wheel_rows(stage, plan)]
    for name, apart in plan.keep_out.items():
        where = f"plan.keep_out.{name}"
        for first, second in find_pairs(stage.scene, apart.between, apart.wrap, where):
            pair = (first.kind, second.kind), _shape(stage, first), _shape(stage, second)
            near, symbol = proximity(*pair), ca.SX.sym("normal", 3)
            about = About(symbol, ca.densify(near.normal), gap_about(*pair, symbol))
            label = f"{name}: {first.label} to {second.label}"
            rows.append(Row(label, "m", near.gap, lower=apart.distance, about=about))
    rows += [_cone_row(stage, name, cone) for name, cone in plan.cones.items()]
    rows += [sight_row(stage, name, sight) for name, sight in plan.sights.items()]
    return rows


def urdf_joint(scene: Scene, body: SceneBody, joint: int) -> UrdfJoint:
    """A joint as its URDF has it."""
    name = body.joint_name(scene.model, joint)
    return next(found for found in body.description.joints if found.name == name)


def _check_given(scene: Scene, bounds: Bounds, body: SceneBody, urdf: UrdfJoint) -> None:
    """Refuse a joint whose URDF lacks a limit that is asked for."""
    ranged = urdf.kind == "continuous" or bool(np.isfinite([urdf.lower, urdf.upper]).all())
    has = {
        "position": ranged,
        "rate": bool(np.isfinite(urdf.velocity)),
        "torque": body.config.joints[urdf.name].torque_limit is not None,
    }
    for key in bounds.urdf:
        if not has[key]:
            raise ScenarioError(
                f"{body.name}/{urdf.name} has no {key} limit in {body.description.path.name}; give it there, "
                f"or leave {key!r} out",
                source=scene.source,
                where="plan.limits.urdf",
            )


def _bases(scene: Scene, bounds: Bounds) -> Iterator[tuple[str, int, float]]:
    """Name, velocity and limit of each axis of a floating base that is driven."""
    for body in scene.robots:
        if not body.root_joint:
            continue
        first, size = int(scene.model.idx_vs[body.root_joint]), int(scene.model.nvs[body.root_joint])
        axes, limits = (0, 1, 5) if size == 3 else range(6), able(bounds, body, size == 3).most
        for k, axis in enumerate(axes):
            if limits[axis]:
                yield f"{body.name}/base.{FORCES[axis]}", first + k, float(limits[axis])


def _at_most(limit: float, name: str, unit_name: str, value: ca.SX) -> Row:
    """A vector no longer than a limit, as its square over the limit's, which is smooth where it is zero."""
    square = ca.sumsqr(value) / limit**2
    return Row(name, unit_name, square, upper=1.0, scale=limit / 2, form="square")


def _base_rows(stage: Stage, bounds: Bounds) -> Iterator[Row]:
    """How far bases are from where they began."""
    if bounds.base_rotation_deg is not None:
        limit = np.radians(bounds.base_rotation_deg)
        for name, turn in base_turns(stage).items():
            yield Row(
                f"rotation of {name}'s base",
                "rad",
                ca.sumsqr(turn) / limit**2,
                upper=1.0,
                scale=limit / 2,
                form="square",
            )
    if bounds.base_translation is not None:
        limit = bounds.base_translation
        for name, shift in base_shifts(stage).items():
            square = ca.sumsqr(shift) / limit**2
            yield Row(
                f"displacement of {name}'s base", "m", square, upper=1.0, scale=limit / 2, form="square"
            )


def _grip_rows(stage: Stage, bounds: Bounds) -> Iterator[Row]:
    """What grasps hold together, and their forces and torques."""
    names = [f"{grip.name}.{axis}" for grip in stage.grips for axis in axes_of(stage.scene, grip)]
    for name, value in zip(names, ca.vertsplit(stage.parting), strict=True):
        yield Row(f"hold of {name}", "m/s^2 or rad/s^2", value, 0.0, 0.0)
    for grip in (*stage.grips, *stage.springs):
        for key, unit_name, value in zip(("force", "torque"), ("N", "N m"), stage.wrench(grip), strict=True):
            limit = getattr(bounds, f"grip_{key}")
            if limit is not None and value.numel():
                row = _at_most(limit, f"grip {key} of {grip.name}", unit_name, value)
                yield dataclasses.replace(row, size=limit)


def _cone_row(stage: Stage, name: str, cone: Cone) -> Row:
    """Distance from the axis below the cone's radius there, smooth on the axis."""
    seen = Seen(stage, f"plan.cones.{name}")
    place = seen.tip(cone.tip).seen_from(seen.mating(cone.frame))[0]
    before, small = -ca.dot(unit(cone.axis), place), cone.radius / 10
    across = ca.sqrt(ca.sumsqr(place + before * unit(cone.axis)) + small**2)
    slope = float(np.tan(np.radians(cone.half_angle_deg)))
    return Row(
        f"{name}: off the cone's axis",
        "m",
        across - slope * before,
        upper=cone.radius + small,
        last=cone.last,
    )


def _shape(stage: Stage, shape: SceneShape) -> Shape:
    """A shape where its link is."""
    rotation, origin = stage.placement(shape.frame)
    radius, half = shape.measures
    return Shape(
        ca.mtimes(rotation, exact_directions(shape.placement[:3, :3])),
        origin + ca.mtimes(rotation, sparse(shape.placement[:3, 3])),
        ca.SX(radius),
        ca.SX(ca.DM(list(half))) if half else ca.SX(0, 1),
    )
