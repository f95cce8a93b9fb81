"""A scenario around URDFs: bases placed, tips gripping the target, gains that suit the arms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from spacerobot.errors import ScenarioError, near_names
from spacerobot.files import StrPath
from spacerobot.scenario.load import parse_yaml, validate
from spacerobot.scenario.paths import Document
from spacerobot.scene.build import build_scene
from spacerobot.scene.draft.arms import DraftArm, as_name, ends, make_arm, read
from spacerobot.scene.draft.numbers import DraftNumbers
from spacerobot.scene.draft.text import DraftText, text_of
from spacerobot.scene.scene import Scene

BASES = ("free_flyer", "planar", "fixed")


@dataclass(frozen=True)
class DraftRequest:
    """Request for a draft of a scenario.

    Attributes
    ----------
    robots, target
        URDF files, or names of shipped ones.
    tips, frames
        A link of each robot, or one for all, and of the target for each robot; chosen where none is given.
    base
        How bases are connected to the world; ``planar`` if every robot is, else ``free_flyer``, if None.
    """

    robots: Sequence[str]
    target: str
    tips: Sequence[str] = ()
    frames: Sequence[str] = ()
    base: str | None = None


def draft_scenario(order: DraftRequest, file: StrPath) -> tuple[str, Scene]:
    """Text of a scenario that will stand in ``file``, and its scene; nothing is written.

    Raises
    ------
    ScenarioError, DescriptionError
        If a URDF cannot be used, a link is not there, or no such scene can be simulated.
    """
    file = Path(file)
    if order.base is not None and order.base not in BASES:
        raise ScenarioError(f"found {order.base!r}; {near_names(order.base, BASES)}", where="--base")
    if order.base == "fixed" and len(order.robots) > 1:
        raise ScenarioError(
            "one robot alone may be fixed; the others are placed by their grasps", where="--base"
        )
    source = file.absolute()
    arms, bare, scene = held_scene(order, source)
    numbers = DraftNumbers(scene, {arm.name: arm for arm in arms})
    gains = {tip.label: numbers.gains(tip) for tip in scene.tips}
    move = numbers.move(min(found.bandwidth for found in gains.values()))
    steps = numbers.step(gains, 1.0), numbers.step(gains, 10.0)
    found = DraftText(file.stem, arms, bare, gains, move, steps)
    text = text_of(found)
    document = parse_yaml(text, source=source)
    return text, build_scene(validate(document, source=source), source=source, expand_xacro=True)


def held_scene(order: DraftRequest, source: Path) -> tuple[list[DraftArm], Document, Scene]:
    """Arms, scenario without gains, and its scene, in which the tips hold the target away from the arms.

    Raises
    ------
    ScenarioError, DescriptionError
        As :func:`draft_scenario`.
    """
    if len(order.tips) > 1 and len(order.tips) != len(order.robots):
        raise ScenarioError(
            f"found {len(order.tips)} for {len(order.robots)} robots, allowed: one for all, or one for each",
            where="--tip",
        )
    tips: list[str | None] = [*order.tips]
    if len(tips) < 2:
        tips = (tips or [None]) * len(order.robots)
    arms: list[DraftArm] = []
    for urdf, tip in zip(order.robots, tips, strict=True):
        named = read(urdf, source.parent.absolute())
        name = as_name(named[1].path.stem, [arm.name for arm in arms])
        arms.append(make_arm(name, named, tip))
    urdf, description = read(order.target, source.parent)
    # mating frame of each robot: those asked for, else massless ends of the target, else its root
    wanted, count = order.frames, len(arms)
    file, names = description.path.name, [link.name for link in description.links]
    for frame in wanted:
        if frame not in names:
            raise ScenarioError(f"no link {frame!r} in {file}; {near_names(frame, names)}", where="--frame")
    light = {link.name for link in description.links if link.mass == 0}
    found = [*wanted] or [name for name in ends(description) if name in light and name != description.root]
    if not found and count == 1:
        frames = [description.root]
    else:
        if len(found) < count or (wanted and len(wanted) != count):
            raise ScenarioError(
                f"name one link of {file} for each of the {count} robots; its links: {', '.join(names[:12])}",
                where="--frame",
            )
        frames = found[:count]
    planar = all(arm.planar for arm in arms)
    base = order.base or ("planar" if planar else "free_flyer")
    if base == "free_flyer" and planar:
        arms = [replace(arm, turns=False) for arm in arms]  # not about every axis of space
    object_base = "planar" if planar and base != "free_flyer" else "free_flyer"
    bare = _document(arms, frames, (base, object_base, urdf))
    scene = build_scene(validate(bare, source=source), source=source, expand_xacro=True)
    # orientation of the target, at right angles to the first tip, that keeps it farthest from that arm
    data = scene.model.createData()
    pin.framesForwardKinematics(scene.model, data, scene.q)
    grasp, target = scene.grasps[0], scene.bodies[-1]
    tip, root = data.oMf[grasp.tip.frame], data.oMf[target.root_frame]
    held = root.actInv(data.oMf[grasp.frame])
    arm = np.array([data.oMi[joint].translation for joint in grasp.tip.body.joints])
    tilts = (0,) if scene.planar else (0, 90, -90, 180)
    turns = [(roll, pitch, yaw) for roll in tilts for pitch in tilts[:3] for yaw in (0, 90, -90, 180)]
    tried = [tip.rotation @ pin.rpy.rpyToMatrix(np.radians(t)) @ held.rotation.T for t in turns]
    places = [tip.translation - rotation @ held.translation for rotation in tried]
    spaces = [np.linalg.norm(arm - place, axis=1).min() for place in places]
    best = tried[int(np.argmax(np.round(spaces, 6)))]
    bare["target"]["base"]["rotation_deg"] = (
        [0.0, 0.0, round(float(np.degrees(np.arctan2(best[1, 0], best[0, 0]))), 3) + 0.0]
        if scene.planar
        else [round(float(x), 3) + 0.0 for x in np.degrees(pin.rpy.matrixToRpy(best))]
    )
    scene = build_scene(validate(bare, source=source), source=source, expand_xacro=True)
    return arms, bare, scene


def _document(arms: Sequence[DraftArm], frames: Sequence[str], placed: tuple[str, str, str]) -> Document:
    """The scenario without gains, from the arms, their mating frames, and bases and URDF of the target."""
    base, object_base, urdf = placed
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
        robots[arm.name] = {"urdf": arm.urdf, "base": where, "joints": arm.joints}
        if arm.bus is not None and base != "fixed":
            robots[arm.name]["links"] = {arm.description.root: arm.bus}
        robots[arm.name]["tips"] = {arm.tip_name: tip}
        grasps[grasp] = {"tip": f"{arm.name}/{arm.tip_name}", "frame": frame, "kind": "weld"}
    target = {"urdf": urdf, "base": {"joint": object_base, "close_grasp": next(iter(grasps))}}
    return {"name": "draft", "robots": robots, "target": target, "grasps": grasps}
