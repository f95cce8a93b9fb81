"""Properties of URDFs that a draft uses: names, chains, an initial posture."""

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
"""How many are tried."""
RANKED = 60  # best ones that are kept
SPREAD = np.pi / 3  # [rad] that a tried posture differs from the middle of a joint's range, at most
ROUND_DEG = 5.0
BUS, BUS_DENSITY = 20.0, 300.0
"""Mass of a spacecraft per mass of its arm, and per volume [kg/m^3], where one has to be made up."""
SHORTEST = 0.03  # [m] of what counts as a part of an arm
MOVES = 1e-3  # least singular value of a tip's Jacobian, lengths in units of its reach, that counts


@dataclass(frozen=True)
class RobotFiles:
    """URDFs of a robot.

    Attributes:
        urdf: As the scenario names it.
        description: Links and joints, with those of the arms that are mounted on it.
        mounts: Sections of these arms, by name.
        source: The scenario's file.
    """

    urdf: str
    description: Description
    mounts: Document
    source: Path


@dataclass(frozen=True)
class DraftArm:
    """A robot of the draft.

    Attributes:
        name: In the scenario.
        files: Its URDFs.
        tip: Link that holds the target.
        chain: Moving joints from the base to the tip.
        joints: Initial state by name, as the scenario says it; others than those of the chain are locked.
        planar: Whether it moves in the x-y plane only.
        turns: Whether the chain moves its tip in every direction and about every axis.
        alternatives: The same in further postures, the better ones first.
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
        """The tip's name in the scenario."""
        return as_name(self.tip)


def read(urdf: str, folder: Path) -> tuple[str, Description]:
    """A URDF, and how a scenario in ``folder`` names it.

    Raises:
        DescriptionError: If it is not found or cannot be used.
    """
    path = find_urdf(urdf, Path.cwd())
    if path.parent == shipped_urdf_folder() and not (folder / path.name).is_file():
        return path.name, read_description(path)
    inside = path.is_relative_to(folder)
    return str(path.relative_to(folder) if inside else path), read_description(path)


def scene_of(document: Document, source: Path) -> Scene:
    """Scene of a drafted document that will stand in ``source``; xacro files are the user's own.

    Raises:
        ScenarioError, DescriptionError: If it cannot be simulated.
    """
    return build_scene(validate(document, source=source), source=source, expand_xacro=True)


def as_name(text: str, taken: Sequence[str] = ()) -> str:
    """Name that a scenario accepts, unlike those taken."""
    name = (re.sub(r"[^\w-]", "_", text, flags=re.ASCII).lstrip("0123456789-") or "robot")[:60]
    taken = (*taken, "target")
    return next(n for n in (name, *(f"{name}_{i}" for i in range(2, 99))) if n not in taken)


def ends(description: Description) -> list[str]:
    """Links at the ends of a URDF's chains."""
    parents = {joint.parent for joint in description.joints}
    return [link.name for link in description.links if link.name not in parents]


def make_arm(name: str, files: RobotFiles, tip: str | None) -> DraftArm:
    """Arm with a chain and a posture.

    Args:
        name: Of the robot in the scenario.
        files: Its URDFs.
        tip: Link that holds the target; the only end of its chains if None.

    Raises:
        ScenarioError, DescriptionError: If it has no such tip, or the URDF cannot be simulated.
    """
    description = files.description
    file = description.path.name
    if tip is None:
        found = ends(description)
        if len(found) != 1:
            message = f"name the link of {file} that holds the target; its ends: {', '.join(found)}"
            raise ScenarioError(message, where="--tip")
        link = found[0]
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
    scene = scene_of({"robots": {"trial": trial}}, files.source)
    # the posture, of some drawn about the middles of the joints' ranges, from which the tip moves best
    free = [joint for joint in chain if joint.mimic is None]
    limited = [bool(np.isfinite(joint.lower) and np.isfinite(joint.upper)) for joint in free]
    middle = np.array(
        [(own.lower + own.upper) / 2 if known else 0.0 for own, known in zip(free, limited, strict=True)]
    )
    spread = np.array([min(float((joint.upper - joint.lower) / 2) * 0.7, SPREAD) for joint in free])
    ranked = list[tuple[float, Array, bool]]()
    draws = np.random.default_rng(0).uniform(-1, 1, (POSTURES, len(free)))
    for draw in (np.zeros(len(free)), *draws):
        # Angles in steps that read well, within the joints' ranges.
        values = middle + spread * draw
        step = np.array([1e-2 if joint.kind == "prismatic" else np.radians(ROUND_DEG) for joint in free])
        rounded = np.round(values / step) * step
        inside = [j.lower <= x <= j.upper for j, x in zip(free, rounded, strict=True)]
        tried = np.where(inside, rounded, values)
        score, every_way = _agility(scene, free, tried)
        ranked.append((score, tried, every_way))
    ranked.sort(key=lambda one: -round(one[0], 12))
    # arms of the same make as the one that moves have its posture
    own = next((mount for mount in files.mounts if link.startswith(f"{mount}_")), "")
    make = files.mounts[own]["urdf"] if own else None
    twins = [name for name, mount in files.mounts.items() if name != own and mount["urdf"] == make]
    arms = list[DraftArm]()
    for _, posture, turns in ranked[:RANKED]:
        joints: Document = {
            joint.name: {"offset": round(float(x), 6)}
            if joint.kind == "prismatic"
            else {"angle_deg": round(float(np.degrees(x)), 6)}
            for joint, x in zip(free, posture, strict=True)
        }
        twin = {mount + name.removeprefix(own): state for mount in twins for name, state in joints.items()}
        held = {name: state | twin.get(name, {}) for name, state in locked.items()}
        arms.append(DraftArm(name, files, link, tuple(chain), joints | held, scene.planar, turns))
    return replace(arms[0], alternatives=tuple(arms[1:]))


def stand_in(description: Description, object_mass: float) -> Document | None:
    """Mass properties of a root link that stand in for a spacecraft; None where the base needs none.

    A base lighter than what it moves becomes a cube of 20 times that mass, and no lighter than the object
    [kg]: an arm on a base lighter than the object moves the base instead.
    """
    base, *moved = welded_bodies(description.links, description.joints, description.root)
    carried = sum(body.mass for body in moved)
    if base.mass >= carried:
        return None
    mass = float(f"{max(BUS * carried, object_mass):.1g}")
    inertia = float(f"{mass * (mass / BUS_DENSITY) ** (2 / 3) / 6:.2g}")
    return {"mass": mass, "inertia": [inertia, inertia, inertia, 0, 0, 0]}


def _agility(scene: Scene, free: Sequence[UrdfJoint], posture: Array) -> tuple[float, bool]:
    """How well the tip moves in its worst direction, less near the base; whether it moves in every one."""
    model, data, q = scene.model, scene.model.createData(), pin.neutral(scene.model)
    for joint, x in zip(free, posture, strict=True):
        own = model.joints[model.getJointId(f"trial/{joint.name}")]
        q[own.idx_q : own.idx_q + own.nq] = [np.cos(x), np.sin(x)] if own.nq == 2 else [x]
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
    # how far the last part of the arm points away from its first joint: 1 straight away, 0 straight back
    end = data.oMf[tip.frame].translation
    last = next((origin for origin in reversed(chain) if np.linalg.norm(end - origin) > SHORTEST), end)
    part, out = end - last, end - chain[0]
    lengths = float(np.linalg.norm(part) * np.linalg.norm(out))
    outward = 0.5 + 0.5 * float(part @ out) / lengths if lengths > 0 else 0.5
    return float(singular[-1]) * min(1.0, 2 * distance) * outward, every_way
