"""A docking around two URDFs: an arm approaches an object, captures it and stops it.

The scene begins as the one in which the arm holds the object (:mod:`spacerobot.scene.draft.draft`), with the
object moved away along the direction of approach, as far as moves no joint by more than about 0.3 rad. So the
capture lies where the arm moves well, and the tip already has the orientation in which it is mated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from spacerobot.description.parts import UrdfJoint, UrdfLink
from spacerobot.description.write import urdf_xml
from spacerobot.errors import ScenarioError
from spacerobot.files import StrPath
from spacerobot.scenario.load import parse_yaml, validate
from spacerobot.scenario.paths import Document
from spacerobot.scene.build import build_scene
from spacerobot.scene.draft.arms import as_name, read
from spacerobot.scene.draft.draft import DraftRequest, held_scene
from spacerobot.scene.draft.numbers import DraftNumbers, short
from spacerobot.scene.draft.text import DraftText, flow, robot_lines, tuning_lines
from spacerobot.scene.scene import Scene

POINT = "mate_point"
"""Link that stands for a point of the object's surface."""
PEAK = 1.875
"""Greatest slope of the blend by which a rendezvous closes in."""
DRIFT, TURN_DEG = 0.1, 2.0
"""How far the object drifts, in parts of the way of the tip, and turns, until the tip is there."""


def surface_point(target: str, point: Sequence[float], file: StrPath) -> tuple[str, str]:
    """URDF of an object with a mating frame at a point of its surface, and the file that it belongs into.

    The frame's x axis points into the object: from the point to the root link's centre of mass, along the
    nearest of the root link's axes.

    Parameters
    ----------
    target
        URDF of the object.
    point
        In the axes of its root link (3,) [m].
    file
        Scenario beside which it will lie.

    Returns
    -------
    tuple
        File name and text.
    """
    file = Path(file)
    _, description = read(target, file.absolute().parent)
    root = next(link for link in description.links if link.name == description.root)
    inward = root.com - np.array(point)
    along = np.zeros(3)
    along[int(np.argmax(np.abs(inward)))] = np.sign(inward[int(np.argmax(np.abs(inward)))])
    if not along.any():
        raise ScenarioError(
            f"found the centre of mass of {root.name}, allowed: a point of the surface", where="--point"
        )
    across = np.eye(3)[(int(np.argmax(np.abs(along))) + 1) % 3]
    origin = np.eye(4)
    origin[:3, :3] = np.column_stack([along, across, np.cross(along, across)])
    origin[:3, 3] = point
    frame = UrdfLink(POINT, 0.0, np.zeros(3), np.zeros((3, 3)))
    mount = UrdfJoint(f"{POINT}_mount", "fixed", root.name, POINT, origin, np.array([1.0, 0, 0]))
    text = urdf_xml(description.path.stem, [*description.links, frame], [*description.joints, mount], "")
    return f"{file.stem}_target.urdf", text


def draft_capture(order: DraftRequest, file: StrPath) -> tuple[str, Scene]:
    """Text of a scenario with approach, capture and stop that will stand in ``file``, and its scene.

    Parameters
    ----------
    order
        One robot and its object, and what is chosen.
    file
        Where the text will be written; URDFs are named relative to it.

    Returns
    -------
    tuple
        Text and scene; nothing is written.

    Raises
    ------
    ScenarioError, DescriptionError
        If a URDF cannot be used, a link is not there, or the object has no mating frame.
    """
    file = Path(file)
    if len(order.robots) != 1:
        raise ScenarioError(f"found {len(order.robots)} robots, allowed with --capture: one", where="--robot")
    source = file.absolute()
    (arm,), bare, held = held_scene(order, source)
    grasp = held.grasps[0]
    if held.target is not None and grasp.config.frame == held.target.description.root:
        raise ScenarioError(
            f"{held.target.description.path.name} has no mating frame (an end link without mass); name a "
            "link of its surface by --frame, or a point by --point=x,y,z",
            where="--frame",
        )
    data = held.model.createData()
    pin.framesForwardKinematics(held.model, data, held.q)
    tip, mate = data.oMf[grasp.tip.frame], data.oMf[grasp.frame]
    # direction of approach: the axis of the mating frame (3,) nearest to the way to the object's mass
    target = held.bodies[-1]
    masses = [held.model.inertias[joint].mass for joint in target.subtree]
    places = [data.oMi[joint].act(held.model.inertias[joint].lever) for joint in target.subtree]
    centre = np.average(places, axis=0, weights=masses)
    toward = mate.rotation.T @ (centre - mate.translation)
    toward = toward * np.isin(range(3), held.translation_axes) if held.planar else toward
    axis = np.zeros(3)
    axis[int(np.argmax(np.abs(toward)))] = 1.0 if toward[int(np.argmax(np.abs(toward)))] >= 0 else -1.0
    direction = mate.rotation @ axis
    numbers = DraftNumbers(held, {arm.name: arm})
    gains = {one.label: numbers.gains(one) for one in held.tips}
    ((label, own),) = gains.items()
    w = own.bandwidth
    move = numbers.move(w, direction)
    way = float(np.linalg.norm(move.displacement))
    half = short(way / 2, 2)
    speed = short(PEAK * half / move.duration, 2)
    until = move.duration + PEAK * half / speed
    root = data.oMf[held.bodies[-1].root_frame]
    mated = [
        round(float(x), 3) + 0.0 for x in np.degrees(pin.rpy.matrixToRpy(mate.rotation.T @ tip.rotation))
    ]

    name, link = next(iter(bare["grasps"])), grasp.config.frame
    robot, tip_name = bare["robots"][arm.name], arm.tip_name
    section = robot["tips"][tip_name]
    memory = {"ge": short(w**2 / 4), "ta": short(w)}
    section["amnesia"] = memory
    if arm.turns:
        section["orientation_amnesia"] = memory
    section["reference"] = {"kind": "hold"}
    lever = float(np.linalg.norm(mate.translation - root.translation))
    spin = min(TURN_DEG / until, np.degrees(DRIFT * way / max(lever, 1e-3) / until))
    # at right angles to it, in the plane of a planar scene
    if held.planar:
        sideways = np.array([-direction[1], direction[0], 0.0])
    else:
        sideways = np.cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
        sideways /= np.linalg.norm(sideways)
    base: dict[str, Any] = {"joint": bare["target"]["base"]["joint"]}
    base["position"] = [round(float(x), 4) + 0.0 for x in root.translation + way * direction]
    base["rotation_deg"] = bare["target"]["base"]["rotation_deg"]
    base["velocity"] = [short(float(x), 2) + 0.0 for x in DRIFT * way / until * sideways]
    base["spin_deg"] = [0, 0, short(spin, 1)]
    limits: dict[str, Any] = {"distance": short(max(way / 10, 2e-3), 2)}
    if arm.turns:
        limits |= {"misalignment_deg": 5.0}
    limits |= {"closing_speed": short(speed / 2, 2), "lateral_speed": short(speed / 2, 2)}
    limits |= {"spin_deg": 2.0} if arm.turns else {}
    at = {"axis": axis.tolist(), "mated_deg": mated} if arm.turns else {"axis": axis.tolist()}
    bare["grasps"][name] |= {"begins": "open", "capture": limits | {"dwell": 0.1} | at}
    bare["target"]["base"] = base
    reference = {"kind": "rendezvous", "frame": link, "standoff": half, **at}
    reference |= {"approach_time": move.duration, "closing_speed": speed}
    goal = {"tip": label, "frame": link, **at, "orientation": arm.turns}
    steps = numbers.step(gains, 1.0), numbers.step(gains, 10.0)
    # an arm alone is lighter than one that holds the object: gains for the latter would make its loop stiff
    alone = build_scene(
        validate({"name": "draft", "robots": bare["robots"]}, source=source), source=source, expand_xacro=True
    )
    free = replace(DraftNumbers(alone, {arm.name: arm}).gains(alone.tips[0]), bandwidth=w)
    found = DraftText(file.stem, [arm], bare, {label: free}, move, steps)
    holding: Document = {"pid": own.pid(own.mass)}
    if arm.turns and own.inertia is not None:
        holding["orientation_pid"] = own.pid(own.inertia)
    text = _text(found, reference, goal, until, holding)
    return text, build_scene(
        validate(parse_yaml(text, source=source), source=source), source=source, expand_xacro=True
    )


def _text(found: DraftText, reference: Document, goal: Document, until: float, holding: Document) -> str:
    """YAML text of the scenario; ``until`` [s] the tip is there, behind it gains are those ``holding``."""
    (arm,), bare = found.arms, found.bare
    ((name, grasp),) = bare["grasps"].items()
    w = found.gains[f"{arm.name}/{arm.tip_name}"].bandwidth
    latest = float(np.ceil(until + 20 / w + 5))
    costs: dict[str, Any] = {"torque": 1e-3, "joint_acceleration": 1}
    costs |= {"base_rotation": 1} if bare["robots"][arm.name]["base"]["joint"] != "fixed" else {}
    brake = {"kind": "brake", "deceleration": 0.01, "spin_deceleration_deg": 0.5}

    def led(section: Document) -> str:
        """Changes of the tip in a phase."""
        return flow({arm.name: {"tips": {arm.tip_name: section}}})

    lines = [
        "# Drafted by `spacerobot new --capture`: approach, capture, stop; every number is a proposal.",
        "# Units are SI unless a name says otherwise; `spacerobot schema` exports every field with its unit.",
        f"name: {flow(as_name(found.name))}",
        "",
        "robots:",
        *robot_lines(found, arm),
        "",
        "target:",
        f"  urdf: {flow(bare['target']['urdf'])}",
        "  # where the arm would hold it, moved away along the direction of approach as far as moves no",
        "  # joint by more than about 0.3 rad; until the tip is there it drifts by a tenth of that and turns",
        f"  base: {flow(bare['target']['base'])}",
        "",
        "grasps:",
        f"  {name}:",
        *(f"    {key}: {flow(grasp[key])}" for key in ("tip", "frame", "kind", "begins")),
        "    # a tenth of the tip's way; half of the greatest closing speed, which is gone at the end",
        f"    capture: {flow(grasp['capture'])}",
        "",
        "phases:",
        "  approach:   # to a standoff at half of the way, then in along the axis",
        f"    robots: {led({'reference': reference})}",
        f"    until: {{captured: [{name}]}}",
        f"    timeout: {latest:g}",
        "    on_timeout: end",
        "  stop:   # the tip feels the object now: gains by the same rule",
        f"    robots: {led({'reference': brake} | holding)}",
        "    until: {settled: {speed: 0.002, spin_deg: 0.2, dwell: 0.5}}",
        "    timeout: 20",
        "",
        f"simulation: {flow({'duration': latest + 25, 'output_step': 0.05})}   # its step is chosen",
        "",
        "# The same approach as an optimal one: `spacerobot plan`, docs/how_to/plan_and_follow.md",
        "plan:",
        f"  duration: {until:.3g}",
        f"  goals: {{{name}: {flow(goal)}}}",
        f"  costs: {flow(costs)}",
        "  limits: {urdf: [position, rate, torque]}",
        "  intervals: 8",
        "",
        *tuning_lines(found),
        "",
        "# Over how fast the object drifts, and its mass: `spacerobot campaign`, docs/how_to/monte_carlo.md",
        "campaign:",
        "  parameters:",
        "    object_mass: {paths: 'target.links.*.mass', apply: factor, lower: 0.8, upper: 1.2}",
        *(
            f"    drift_{axis}: {{paths: target.base.velocity.{i}, apply: offset, "
            f"lower: {-size:g}, upper: {size:g}}}"
            for i, axis in enumerate("xy")
            for size in [short(float(np.linalg.norm(bare["target"]["base"]["velocity"])), 1)]
        ),
        "  samples: 64",
        "  metrics: [capture_time, miss_distance]",
        f"  limits: {{capture_time: {latest:g}}}   # a capture that is missed or later is a failure",
    ]
    return "\n".join(lines) + "\n"
