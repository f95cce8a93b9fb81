"""Checks of references against the scene's bodies."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from spacerobot.common.arrays import Array
from spacerobot.common.errors import ScenarioError, near_names
from spacerobot.scene.scene import Scene, SceneBody


def check_in_plane(scene: Scene) -> None:
    """Check that no reference leaves the plane of a planar scene.

    Raises:
        ScenarioError: If one does; names the number that leads out of the plane.
    """
    if not scene.planar:
        return
    for reference in (reference for tip in scene.tips for reference in tip.references):
        for key, value in reference.config.leaves_plane():
            raise ScenarioError(
                f"leads out of the x-y plane, which nothing in this scene can leave: found {value}, allowed: "
                "displacements along x and y, rotations about z; a `free_flyer` base is free in space",
                source=scene.source,
                where=f"{reference.path}.{key}",
            )


def check_followed(scene: Scene) -> None:
    """Check that the target has every frame that a reference follows.

    Raises:
        ScenarioError: If it does not; lists similar names.
    """
    links = [] if scene.target is None else [link.name for link in scene.target.description.links]
    for reference in (reference for tip in scene.tips for reference in tip.references):
        frame = reference.config.follows
        if frame is None:
            continue
        if reference.from_target:
            fault = "follows the target, so it is one of tips and not of the target"
        elif scene.target is None:
            fault = "follows the target, and there is none"
        elif frame not in links:
            fault = f"no link {frame!r} in the target's URDF; {near_names(frame, links)}"
        else:
            continue
        raise ScenarioError(fault, source=scene.source, where=f"{reference.path}.frame")


def reference_warnings(scene: Scene) -> list[str]:
    """Warnings of the references, and of those that leave the reach of their robot."""
    references = [reference for tip in scene.tips for reference in tip.references]
    warnings = [
        f"{reference.path}: {warning}" for reference in references for warning in reference.config.warnings()
    ]
    return [*dict.fromkeys(warnings), *out_of_reach(scene)]


def out_of_reach(scene: Scene) -> list[str]:
    """Warnings about references farther from the base's initial position than the arm reaches."""
    data = scene.model.createData()
    pin.framesForwardKinematics(scene.model, data, scene.q)
    warnings = []
    for tip in scene.tips:
        base = data.oMf[tip.body.root_frame].translation
        begin = data.oMf[tip.frame].translation
        pivot = begin
        if tip.from_target and scene.target is not None:
            pivot = data.oMf[scene.target.root_frame].translation
        # positions (n, 3) [m] of the tip along a reference; the lever rotates with the reference
        lever = begin - pivot
        displacements, rotations = tip.reference.way()
        points: Array = pivot + displacements + np.array([pin.exp3(turn) @ lever for turn in rotations])
        farthest = float(np.linalg.norm(points - base, axis=1).max())
        longest = reach(scene, tip.body, tip.frame)
        if farthest > longest * (1 + 1e-9):
            warnings.append(
                f"{tip.references[0].path}: leads {tip.label} {farthest:.4g} m from where its base begins, "
                f"the arm reaches {longest:.4g} m"
            )
    return warnings


def lengths_to_root(
    scene: Scene, body: SceneBody, joint: int, point: Array
) -> dict[int, tuple[float, Array]]:
    """For each joint towards the root: maximum length [m] to a point fixed in it, and that point (3,).

    Args:
        scene, body: The scene, and the body of the chain.
        joint, point: End of the chain: a joint, and a point in its frame (3,) [m].
    """
    model, by_name = scene.model, {described.name: described for described in body.description.joints}
    lengths, length = {joint: (0.0, point)}, 0.0
    while joint in body.joints:
        length += float(np.linalg.norm(point))
        described = by_name[body.joint_name(model, joint)]
        if described.kind == "prismatic":
            length += max(abs(described.lower), abs(described.upper))
        point = np.array(model.jointPlacements[joint].translation)
        joint = int(model.parents[joint])
        lengths[joint] = (length, point)
    return lengths


def reach(scene: Scene, body: SceneBody, frame: int) -> float:
    """Maximum distance [m] of a frame from its body's root link: the sum of the lengths along the chain."""
    end, root = scene.model.frames[frame], scene.model.frames[body.root_frame]
    lengths = lengths_to_root(scene, body, int(end.parentJoint), np.array(end.placement.translation))
    length, point = lengths[int(root.parentJoint)]
    # a fixed root link is part of the universe; a floating one is the root joint itself
    return length + float(np.linalg.norm(point - root.placement.translation * (not body.root_joint)))


def joint_from_base(scene: Scene, body: SceneBody, joint: int) -> float:
    """Maximum distance [m] of a joint's origin from that of its floating base, or of the world."""
    length, point = list(lengths_to_root(scene, body, joint, np.zeros(3)).values())[-1]
    return length + float(np.linalg.norm(point))


def com_from_base(scene: Scene, body: SceneBody) -> float:
    """Bound of the distance [m] of a floating body's centre of mass from its base's origin."""
    inertias = scene.model.inertias
    masses = {joint: float(inertias[joint].mass) for joint in body.subtree}
    moment = masses[body.root_joint] * float(np.linalg.norm(inertias[body.root_joint].lever))
    for joint in body.joints:  # the farthest that its link can be from the base's origin
        distance = joint_from_base(scene, body, joint) + float(np.linalg.norm(inertias[joint].lever))
        moment += masses[joint] * distance
    return moment / sum(masses.values())
