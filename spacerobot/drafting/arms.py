"""Arms of a draft: names, kinematic chains, and initial postures, from URDFs."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from spacerobot.common.arrays import Array
from spacerobot.common.errors import ScenarioError, near_names
from spacerobot.description.bodies import welded_bodies
from spacerobot.description.find import find_urdf, shipped_urdf_folder
from spacerobot.description.parts import UrdfJoint
from spacerobot.description.read import Description, read_description
from spacerobot.scenario.load import validate
from spacerobot.scenario.paths import Document
from spacerobot.scene.build import build_scene
from spacerobot.scene.scene import Scene

POSTURES = 500
"""Number of random postures."""
RANKED = 60  # number of the best postures that are kept
SPREAD = np.pi / 3  # maximum distance of a posture from the middle of a joint's range [rad]
ROUND_DEG = 5.0
BUS, BUS_DENSITY = 20.0, 300.0
"""Mass of an assumed spacecraft relative to that of its arm, and its density [kg/m^3]."""
SHORTEST = 0.03  # minimum length of the last part of an arm [m]
GENERIC = ("model", "robot", "urdf")  # names of files that do not name a robot
MOVES = 1e-3  # minimum singular value of a regular tip Jacobian, with lengths relative to the reach


@dataclass(frozen=True)
class RobotFiles:
    """URDFs of a robot.

    Attributes:
        urdf: Name or path of the robot's URDF in the scenario.
        description: Links and joints, including those of mounted arms.
        mounts: Sections of the mounted arms by name.
        source: File of the scenario.
    """

    urdf: str
    description: Description
    mounts: Document
    source: Path


@dataclass(frozen=True)
class DraftArm:
    """A robot of the draft.

    Attributes:
        name: Name of the robot in the scenario.
        files: URDFs of the robot.
        tip: Name of the link that holds the target.
        chain: Moving joints from the base to the tip.
        joints: Sections of joints by name: initial states of the chain's joints; other joints are locked.
        planar: Whether the robot moves in the x-y plane only.
        turns: Whether the chain can move its tip along and about every axis.
        alternatives: The robot in further postures, the best ones first.
    """

    name: str
    files: RobotFiles
    tip: str
    chain: tuple[UrdfJoint, ...]
    joints: Document
    planar: bool
    turns: bool
    alternatives: tuple[DraftArm, ...] = ()

    @property
    def tip_name(self) -> str:
        """Name of the tip in the scenario."""
        return as_name(self.tip)


def read(urdf: str, folder: Path) -> tuple[str, Description]:
    """Read a URDF.

    Args:
        urdf: Path, or name of a shipped file.
        folder: Folder of the scenario.

    Returns:
        tuple: Name or path of the URDF in the scenario, and the description.

    Raises:
        DescriptionError: If the URDF is not found or cannot be used.
    """
    path = find_urdf(urdf, Path.cwd())
    if path.parent == shipped_urdf_folder() and not (folder / path.name).is_file():
        return path.name, read_description(path)
    inside = path.is_relative_to(folder)
    return str(path.relative_to(folder) if inside else path), read_description(path)


def scene_of(document: Document, source: Path) -> Scene:
    """Scene of a drafted document that will be written to ``source``; xacro files are expanded.

    Raises:
        ScenarioError, DescriptionError: If the scene cannot be simulated.
    """
    return build_scene(validate(document, source=source), source=source, expand_xacro=True)


def as_name(text: str, used_names: Sequence[str] = ()) -> str:
    """Valid name in a scenario made from a text, different from the names in ``used_names``."""
    name = (re.sub(r"[^\w-]", "_", text, flags=re.ASCII).lstrip("0123456789-") or "robot")[:60]
    used_names = (*used_names, "target")
    return next(n for n in (name, *(f"{name}_{i}" for i in range(2, 99))) if n not in used_names)


def name_of(description: Description, used_names: Sequence[str] = ()) -> str:
    """Name of a robot in a scenario: its file's, or the URDF's own if that of the file is generic."""
    stem = description.path.stem
    return as_name(description.name if stem.lower() in GENERIC else stem, used_names)


def ends(description: Description) -> list[str]:
    """Names of the links at the ends of a description's chains."""
    parents = {joint.parent for joint in description.joints}
    return [link.name for link in description.links if link.name not in parents]


def moving_ends(description: Description) -> list[str]:
    """Names of the end links that a joint moves; all end links if none does."""
    paths = _paths(description)
    kinds = {joint.child: joint.kind for joint in description.joints}
    moving = [end for end, path in paths.items() if any(kinds.get(link, "fixed") != "fixed" for link in path)]
    return moving or [*paths]


def possible_tips(description: Description) -> str:
    """Possible tips in words: the end links and, as the palm of a gripper, the link that they branch from."""
    names, paths = moving_ends(description), _paths(description)
    kinds = {joint.child: joint.kind for joint in description.joints}
    common = [link for link in paths[names[0]] if all(link in paths[name] for name in names)]
    moving = any(kinds.get(link, "fixed") != "fixed" for link in common)
    return f"its ends: {', '.join(names)}" + (f"; they branch from {common[0]}" if moving else "")


def _paths(description: Description) -> dict[str, list[str]]:
    """Links from each end link to the root."""
    parents = {joint.child: joint.parent for joint in description.joints}
    paths = {end: [end] for end in ends(description)}
    for path in paths.values():
        while path[-1] in parents:
            path.append(parents[path[-1]])
    return paths


def make_arm(name: str, files: RobotFiles, tip: str | None) -> DraftArm:
    """Choose the chain and the initial posture of an arm.

    Args:
        name: Name of the robot in the scenario.
        files: URDFs of the robot.
        tip: Link that holds the target; if None, the only end link that a joint moves.

    Raises:
        ScenarioError, DescriptionError: If there is no such tip, or the robot cannot be simulated.
    """
    description = files.description
    file = description.path.name
    if tip is None:
        end_links = moving_ends(description)
        if len(end_links) != 1:
            message = f"name the link of {file} that holds the target; {possible_tips(description)}"
            raise ScenarioError(message, where="--tip")
        link = end_links[0]
    else:
        link, names = tip, [link.name for link in description.links]
        if tip not in names:
            raise ScenarioError(f"no link {tip!r} in {file}; {near_names(tip, names)}", where="--tip")
    above = {joint.child: joint for joint in description.joints}
    chain, at = list[UrdfJoint](), link
    while at in above:
        chain.append(above[at])
        at = above[at].parent
    chain = [joint for joint in reversed(chain) if joint.kind != "fixed"]
    if not chain:
        raise ScenarioError(f"no moving joint leads to {link!r} in {file}", where="--tip")
    of_chain = {joint.name for joint in chain}
    others = [j.name for j in description.joints if j.kind != "fixed" and j.name not in of_chain]
    locked: Document = {other: {"locked": True} for other in others}
    trial = {"urdf": files.urdf, "base": {"joint": "fixed"}, "joints": locked, "mounts": files.mounts}
    trial["tips"] = {"tip": {"frame": link}}
    try:
        scene = scene_of({"robots": {"trial": trial}}, files.source)
    except ScenarioError as error:  # of the URDF, not of a scenario that does not exist yet
        place = (error.where or "").removeprefix("robots.trial").lstrip(".")
        raise ScenarioError(error.message, source=description.path, where=place or None) from None
    # postures drawn about the middles of the joints' ranges, ranked by the agility of the tip
    free = [joint for joint in chain if joint.mimic is None]
    limited = [bool(np.isfinite(joint.lower) and np.isfinite(joint.upper)) for joint in free]
    middle = np.array(
        [(j.lower + j.upper) / 2 if is_limited else 0.0 for j, is_limited in zip(free, limited, strict=True)]
    )
    spread = np.array([min(float((joint.upper - joint.lower) / 2) * 0.7, SPREAD) for joint in free])
    ranked = list[tuple[float, Array, bool]]()
    draws = np.random.default_rng(0).uniform(-1, 1, (POSTURES, len(free)))
    for draw in (np.zeros(len(free)), *draws):
        # angles rounded to 5 degrees, unless that leaves a joint's range
        values = middle + spread * draw
        step = np.array([1e-2 if joint.kind == "prismatic" else np.radians(ROUND_DEG) for joint in free])
        rounded = np.round(values / step) * step
        inside = [j.lower <= x <= j.upper for j, x in zip(free, rounded, strict=True)]
        tried = np.where(inside, rounded, values)
        score, every_way = _agility(scene, free, tried)
        ranked.append((score, tried, every_way))
    ranked.sort(key=lambda one: -round(one[0], 12))
    # mounted arms with the same URDF as the moving one have the same posture
    active = next((mount for mount in files.mounts if link.startswith(f"{mount}_")), "")
    active_urdf = files.mounts[active]["urdf"] if active else None
    twins = [name for name, mount in files.mounts.items() if name != active and mount["urdf"] == active_urdf]
    arms = list[DraftArm]()
    for _, posture, turns in ranked[:RANKED]:
        joints: Document = {
            joint.name: {"offset": round(float(x), 6)}
            if joint.kind == "prismatic"
            else {"angle_deg": round(float(np.degrees(x)), 6)}
            for joint, x in zip(free, posture, strict=True)
        }
        twin = {mount + name.removeprefix(active): state for mount in twins for name, state in joints.items()}
        others_locked = {name: state | twin.get(name, {}) for name, state in locked.items()}
        arms.append(DraftArm(name, files, link, tuple(chain), joints | others_locked, scene.planar, turns))
    return replace(arms[0], alternatives=tuple(arms[1:]))


def stand_in(description: Description, object_mass: float) -> Document | None:
    """Mass properties of an assumed spacecraft for the root link; None if the base is heavy enough.

    A base lighter than its arm becomes a cube with 20 times the arm's mass, but not lighter than the object:
    an arm on a base lighter than the object would mainly move the base.

    Args:
        description: Description of the robot.
        object_mass: Mass of the object [kg].
    """
    base, *arm_bodies = welded_bodies(description.links, description.joints, description.root)
    carried = sum(body.mass for body in arm_bodies)
    if base.mass >= carried:
        return None
    mass = float(f"{max(BUS * carried, object_mass):.1g}")
    inertia = float(f"{mass * (mass / BUS_DENSITY) ** (2 / 3) / 6:.2g}")
    return {"mass": mass, "inertia": [inertia, inertia, inertia, 0, 0, 0]}


def _agility(scene: Scene, free: Sequence[UrdfJoint], posture: Array) -> tuple[float, bool]:
    """Agility of the tip in a posture, and whether it can move along and about every axis.

    The agility is the smallest singular value of the tip's Jacobian, with lengths relative to the reach. It
    is reduced near the base, and if the last part of the arm points back to the first joint.
    """
    model, data, q = scene.model, scene.model.createData(), pin.neutral(scene.model)
    for joint, x in zip(free, posture, strict=True):
        moving = model.joints[model.getJointId(f"trial/{joint.name}")]
        q[moving.idx_q : moving.idx_q + moving.nq] = [np.cos(x), np.sin(x)] if moving.nq == 2 else [x]
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    tip = scene.tips[0]
    world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    jacobian = pin.getFrameJacobian(model, data, tip.frame, world) @ scene.spread
    reach = sum(float(np.linalg.norm(placement.translation)) for placement in model.jointPlacements[1:])
    reach = max(reach, 1e-3)
    axes = [*scene.translation_axes, *(3 + axis for axis in scene.rotation_axes)]
    rows = jacobian[axes] / np.array([reach if axis < 3 else 1.0 for axis in axes])[:, None]
    distance = float(np.linalg.norm(data.oMf[tip.frame].translation)) / reach
    singular = np.linalg.svd(rows, compute_uv=False)
    every_way = len(singular) == len(axes) and bool(singular[-1] > MOVES)
    chain = [data.oMi[model.getJointId(f"trial/{joint.name}")].translation for joint in free]
    # direction of the last part of the arm relative to its first joint: 1 straight away, 0 straight back
    end = data.oMf[tip.frame].translation
    last = next((origin for origin in reversed(chain) if np.linalg.norm(end - origin) > SHORTEST), end)
    part, out = end - last, end - chain[0]
    lengths = float(np.linalg.norm(part) * np.linalg.norm(out))
    outward = 0.5 + 0.5 * float(part @ out) / lengths if lengths > 0 else 0.5
    return float(singular[-1]) * min(1.0, 2 * distance) * outward, every_way
