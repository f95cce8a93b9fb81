"""What references ask for, held against what the scene's bodies can do."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from spacerobot.errors import ScenarioError
from spacerobot.scenario import Circle, Line, Reference, Spline
from spacerobot.scene.scene import Array, Scene, SceneTip

PLANE_TOLERANCE = 1e-12
_SAMPLES = 65


def check_in_plane(scene: Scene) -> None:
    """Refuse a reference that leaves the plane in which a planar scene stays.

    Raises
    ------
    ScenarioError
        Naming the number that leads out of it.
    """
    if not scene.planar:
        return
    for tip in scene.tips:
        for key, found in _out_of_plane(tip.reference):
            raise ScenarioError(
                f"leads out of the x-y plane, which nothing in this scene can leave: found {found}, allowed: "
                "displacements along x and y, rotations about z; a `free_flyer` base is free in space",
                source=scene.source,
                where=f"{_path(tip)}.{key}",
            )


def _path(tip: SceneTip) -> str:
    return "target.reference" if tip.from_target else f"{tip.path}.reference"


def _out_of_plane(reference: Reference) -> Iterator[tuple[str, list[float]]]:
    """Keys of a reference that lead out of the x-y plane, with their values."""
    if isinstance(reference, Circle | Line) and any(reference.rotation_deg[:2]):
        yield "rotation_deg", list(reference.rotation_deg)
    if isinstance(reference, Circle):
        normal = pin.rpy.rpyToMatrix(np.radians(reference.plane_deg))[:, 2]
        if np.abs(normal[:2]).max() > PLANE_TOLERANCE:
            yield "plane_deg", list(reference.plane_deg)
    if isinstance(reference, Line) and reference.displacement[2]:
        yield "displacement", list(reference.displacement)
    if isinstance(reference, Spline):
        for i, displacement in enumerate(reference.displacements):
            if displacement[2]:
                yield f"displacements.{i}", list(displacement)


def out_of_reach(scene: Scene) -> list[str]:
    """Warnings about references that lead farther from where a base begins than its arm reaches."""
    data = scene.model.createData()
    pin.framesForwardKinematics(scene.model, data, scene.q)
    found = []
    for tip in scene.tips:
        base = data.oMf[tip.body.root_frame].translation
        begin = data.oMf[tip.frame].translation
        pivot = begin
        if tip.from_target and scene.target is not None:
            pivot = data.oMf[scene.target.root_frame].translation
        points = _points(tip.reference, pivot, begin - pivot)
        farthest = float(np.linalg.norm(points - base, axis=1).max())
        reach = _reach(scene, tip)
        if farthest > reach * (1 + 1e-9):
            found.append(
                f"{_path(tip)}: leads {tip.label} {farthest:.4g} m from where its base begins, "
                f"the arm reaches {reach:.4g} m"
            )
    return found


def _points(reference: Reference, pivot: Array, lever: Array) -> Array:
    """Positions (n, 3) [m] that a reference leads its tip through; the lever turns with the reference."""
    done = np.linspace(0.0, 1.0, _SAMPLES)
    turn = np.zeros(3)
    if isinstance(reference, Circle):
        turn, plane = np.radians(reference.rotation_deg), pin.rpy.rpyToMatrix(np.radians(reference.plane_deg))
        angle = np.radians(reference.start_deg + done * (reference.end_deg - reference.start_deg))
        circle = reference.radius * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle]) @ plane.T
        moved = circle - circle[0]
    elif isinstance(reference, Line):
        turn, moved = np.radians(reference.rotation_deg), np.outer(done, reference.displacement)
    elif isinstance(reference, Spline):
        moved = np.array(reference.displacements)
    else:
        moved = np.zeros((1, 3))
    parts = done if turn.any() else np.zeros(len(moved))
    points: Array = pivot + moved + np.array([pin.exp3(part * turn) @ lever for part in parts])
    return points


def _reach(scene: Scene, tip: SceneTip) -> float:
    """Greatest distance [m] of a tip from its robot's root link: the lengths along the chain, end to end."""
    model, by_name = scene.model, {joint.name: joint for joint in tip.body.description.joints}
    placement, joint, reach = model.frames[tip.frame].placement, tip.joint, 0.0
    while joint in tip.body.joints:
        reach += float(np.linalg.norm(placement.translation))
        own = by_name[model.names[joint].removeprefix(f"{tip.body.name}/")]
        if own.kind == "prismatic":
            reach += max(abs(own.lower), abs(own.upper))
        placement, joint = model.jointPlacements[joint], model.parents[joint]
    # what is left hangs in the root joint or, of a fixed base, in the universe as its root link does
    base = pin.SE3.Identity() if tip.body.root_joint else model.frames[tip.body.root_frame].placement
    return reach + float(np.linalg.norm(base.actInv(placement).translation))
