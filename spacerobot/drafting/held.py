"""Draft of a scenario in which robots hold a target: poses of bases and target, and gains."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from spacerobot.common.errors import ScenarioError, near_names
from spacerobot.common.files import StrPath
from spacerobot.description.parts import UrdfJoint
from spacerobot.description.read import Description
from spacerobot.drafting.arms import (
    DraftArm,
    RobotFiles,
    ends,
    make_arm,
    moving_ends,
    name_of,
    possible_tips,
    read,
    scene_of,
    stand_in,
)
from spacerobot.drafting.mounts import equipped, read_mounts
from spacerobot.drafting.numbers import DraftNumbers, payload_of
from spacerobot.drafting.request import DraftRequest
from spacerobot.drafting.text import DraftText, text_of
from spacerobot.scenario.document import parse_yaml
from spacerobot.scenario.paths import Document
from spacerobot.scene import Scene
from spacerobot.scene.overlaps import overlaps

BASES = ("free_flyer", "planar", "fixed")


def draft_scenario(
    order: DraftRequest,
    file: StrPath,
    slowdown: float = 1.0,
    *,
    progress: Callable[[str], None] | None = None,
) -> tuple[str, Scene]:
    """Draft a scenario in which robots hold a target, without writing it.

    Args:
        order: Request with robots and target.
        file: File of the scenario; paths of URDFs are relative to its folder.
        slowdown: Factor by which bandwidths are divided and durations are multiplied.
        progress: As for :func:`held_scene`.

    Returns:
        tuple: Text of the scenario, and its scene.

    Raises:
        ScenarioError, DescriptionError: If a URDF cannot be used, a link is missing, or the scene cannot be
            simulated.
    """
    file = Path(file)
    source = file.absolute()
    arms, bare, scene = held_scene(order, source, progress)
    numbers = DraftNumbers(scene, {arm.name: arm for arm in arms})
    gains = {tip.label: numbers.gains(tip).slowed(slowdown) for tip in scene.tips}
    move = numbers.move(min(gain.bandwidth / slowdown for gain in gains.values()))
    steps = numbers.step(gains, 1.0), numbers.step(gains, 10.0)
    payload = payload_of(scene) if len(arms) == 1 else None
    text = text_of(DraftText(file.stem, arms, bare, gains, move, steps, payload))
    return text, scene_of(parse_yaml(text, source=source), source)


def held_scene(
    order: DraftRequest, source: Path, progress: Callable[[str], None] | None = None
) -> tuple[list[DraftArm], Document, Scene]:
    """Arms, scenario without gains, and its scene, in which the tips hold the target away from the arms.

    Args:
        order: Request with robots and target.
        source: Absolute path of the scenario; paths of URDFs are relative to its folder.
        progress: Callback with a short text, called when a step that may take long begins.

    Raises:
        ScenarioError, DescriptionError: As :func:`draft_scenario`.
    """
    if order.base is not None and order.base not in BASES:
        raise ScenarioError(f"found {order.base!r}; {near_names(order.base, BASES)}", where="--base")
    if order.base == "fixed" and len(order.robots) > 1:
        raise ScenarioError(
            "one robot alone may be fixed; the others are placed by their grasps", where="--base"
        )
    tell = progress or (lambda _: None)
    urdf, description = read(order.target, source.parent)
    frames = mating_frames(order, description)
    tell("choosing a posture")
    arms = _arms(order, source)
    planar = all(arm.planar for arm in arms)
    base = order.base or ("planar" if planar else "free_flyer")
    if base == "free_flyer" and planar:
        arms = [replace(arm, turns=False) for arm in arms]  # planar arms cannot rotate about every axis
    object_base = "planar" if planar and base != "free_flyer" else "free_flyer"
    object_mass = sum(link.mass for link in description.links)
    locked = {joint.name: locked_section(joint) for joint in description.joints if joint.kind != "fixed"}
    target: Document = {"urdf": urdf, "base": {"joint": object_base}}
    target |= {"joints": locked} if locked else {}
    placed = partial(_placed, frames=frames, base=base, target=target, object_mass=object_mass)
    tell("placing the object")
    bare, scene = placed(arms, source=source)
    if len(arms) == 1 and overlaps(scene):
        # the best posture in which object and robot do not overlap, if there is one
        (arm,) = arms
        for k, other in enumerate(arm.alternatives, start=1):
            tell(f"choosing a posture in which nothing overlaps: {k} of {len(arm.alternatives)}")
            clear = replace(other, turns=other.turns and arm.turns)
            there, clear_scene = placed([clear], source=source)
            if not overlaps(clear_scene):
                return [clear], there, clear_scene
    return arms, bare, scene


def locked_section(joint: UrdfJoint) -> Document:
    """Section of a joint that is locked at zero, or in the middle of a range that does not include zero."""
    if joint.mimic is not None or joint.lower <= 0 <= joint.upper:
        return {"locked": True}
    middle = (joint.lower + joint.upper) / 2
    if joint.kind == "prismatic":
        return {"offset": middle, "locked": True}
    return {"angle_deg": float(np.degrees(middle)), "locked": True}


def mating_frames(order: DraftRequest, target: Description) -> list[str]:
    """Mating frame of each robot: requested ones, else massless end links of the target, else its root.

    Args:
        order: Request with robots and target.
        target: The target's URDF.

    Raises:
        ScenarioError: If a requested link does not exist, or there are fewer frames than robots.
    """
    requested, count = order.frames, max(1, len(order.robots))
    file, names = target.path.name, [link.name for link in target.links]
    for frame in requested:
        if frame not in names:
            raise ScenarioError(f"no link {frame!r} in {file}; {near_names(frame, names)}", where="--frame")
    light = {link.name for link in target.links if link.mass == 0}
    candidates = [*requested] or [name for name in ends(target) if name in light and name != target.root]
    if not candidates and count == 1:
        return [target.root]
    if len(candidates) < count or (requested and len(requested) != count):
        raise ScenarioError(
            f"name one link of {file} for each of the {count} robots; its links: {', '.join(names)}",
            where="--frame",
        )
    return candidates[:count]


def _placed(
    arms: Sequence[DraftArm],
    frames: Sequence[str],
    base: str,
    target: Document,
    object_mass: float,
    source: Path,
) -> tuple[Document, Scene]:
    """Scenario without gains, and its scene, the target rotated about the first tip, away from the arm."""
    bare = _document(arms, frames, base, target, object_mass)
    scene = scene_of(bare, source)
    # orientation of the target, in steps of 90 degrees about the tip, in which it is farthest from that arm
    data = scene.model.createData()
    pin.framesForwardKinematics(scene.model, data, scene.q)
    grasp = scene.grasps[0]
    tip, root = data.oMf[grasp.tip.frame], data.oMf[scene.bodies[-1].root_frame]
    held = root.actInv(data.oMf[grasp.frame])
    robot = grasp.tip.body
    origins = [data.oMi[joint].translation for joint in robot.joints]
    origins += [data.oMf[robot.root_frame].translation] if arms[0].files.mounts else []
    arm = np.array(origins)
    tilts = (0,) if scene.planar else (0, 90, -90, 180)
    turns = [(roll, pitch, yaw) for roll in tilts for pitch in tilts[:3] for yaw in (0, 90, -90, 180)]
    rotations = [tip.rotation @ pin.rpy.rpyToMatrix(np.radians(t)) @ held.rotation.T for t in turns]
    places = [tip.translation - rotation @ held.translation for rotation in rotations]
    # criterion: distance to the nearest joint, then the mean distance. If the tip is at the last joint, as a
    # flange is, the nearest distance is the same for all orientations
    spaces = [np.linalg.norm(arm - place, axis=1) for place in places]
    scores = [(round(float(space.min()), 6), round(float(space.mean()), 6)) for space in spaces]
    best = rotations[scores.index(max(scores))]
    bare["target"]["base"]["rotation_deg"] = (
        [0.0, 0.0, round(float(np.degrees(np.arctan2(best[1, 0], best[0, 0]))), 3) + 0.0]
        if scene.planar
        else [round(float(x), 3) + 0.0 for x in np.degrees(pin.rpy.matrixToRpy(best))]
    )
    return bare, scene_of(bare, source)


def _arms(order: DraftRequest, source: Path) -> list[DraftArm]:
    """Robots of a request with their postures; a bus with its mounted arms is one robot."""
    if order.bus is not None:
        if order.robots:
            raise ScenarioError("found both --bus and --robot, allowed: one of them", where="--bus")
        urdf, bus = read(order.bus, source.parent)
        mounts = read_mounts(order.mounts, source.parent)
        if len(order.tips) > 1:
            raise ScenarioError(f"found {len(order.tips)}, allowed: one, of the first arm", where="--tip")
        # the tip is a link of the first arm, with or without the mount's prefix
        first = mounts[0]
        links = [link.name for link in first.description.links]
        tip = order.tips[0].removeprefix(f"{first.name}_") if order.tips else None
        if tip is None and len(moving_ends(first.description)) == 1:
            (tip,) = moving_ends(first.description)
        if tip not in links:
            hint = near_names(tip, links) if tip else possible_tips(first.description)
            problem = f"no link {tip!r} in" if tip else "name the link of"
            raise ScenarioError(f"{problem} {first.description.path.name}; {hint}", where="--tip")
        sections = {mount.name: mount.section() for mount in mounts}
        files = RobotFiles(urdf, equipped(bus, mounts), sections, source)
        return [make_arm(name_of(bus), files, f"{first.name}_{tip}")]
    if order.mounts:
        raise ScenarioError("found --mount without --bus, allowed: both", where="--mount")
    if len(order.tips) > 1 and len(order.tips) != len(order.robots):
        raise ScenarioError(
            f"found {len(order.tips)} for {len(order.robots)} robots, allowed: one for all, or one for each",
            where="--tip",
        )
    tips: list[str | None] = [*order.tips]
    if len(tips) < 2:
        tips = (tips or [None]) * len(order.robots)
    arms: list[DraftArm] = []
    for robot, tip in zip(order.robots, tips, strict=True):
        urdf, description = read(robot, source.parent)
        name = name_of(description, [arm.name for arm in arms])
        arms.append(make_arm(name, RobotFiles(urdf, description, {}, source), tip))
    return arms


def _document(
    arms: Sequence[DraftArm], frames: Sequence[str], base: str, target: Document, object_mass: float
) -> Document:
    """Scenario without gains.

    Args:
        arms, frames: The arms and their mating frames.
        base: Joint of the bases.
        target: Section of the target, which will be placed by the first grasp.
        object_mass: Mass of the target [kg].
    """
    robots, grasps = dict[str, Any](), dict[str, Any]()
    for i, (arm, frame) in enumerate(zip(arms, frames, strict=True)):
        grasp = "hold" if len(arms) == 1 else f"hold_{i + 1}"
        tip: Document = {"pid": {"feedback": "inertial"}}
        if arm.turns:
            tip["orientation_pid"] = {"feedback": "inertial"}
        if arm.tip_name != arm.tip:
            tip = {"frame": arm.tip} | tip
        where: Document = {"joint": base}
        if i > 0:
            where |= {"rotation_deg": [0, 0, round(360 * i / len(arms), 3)], "close_grasp": grasp}
        robots[arm.name] = {"urdf": arm.files.urdf, "base": where, "joints": arm.joints}
        if arm.files.mounts:
            robots[arm.name]["mounts"] = arm.files.mounts
        bus = stand_in(arm.files.description, object_mass)
        if bus is not None and base != "fixed":
            robots[arm.name]["links"] = {arm.files.description.root: bus}
        robots[arm.name]["tips"] = {arm.tip_name: tip}
        grasps[grasp] = {"tip": f"{arm.name}/{arm.tip_name}", "frame": frame, "kind": "weld"}
    target = target | {"base": target["base"] | {"close_grasp": next(iter(grasps))}}
    return {"name": "draft", "robots": robots, "target": target, "grasps": grasps}
