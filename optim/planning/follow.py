"""The scenario that follows a plan.

Joints track the plan in the first phase. Where that phase has not ended with the plan it goes on as one of
its own: the scenario's controllers take over, and tips that were to be mated stay with their mating frames.
All that follows is as in the scenario.
"""

from __future__ import annotations

import itertools

import numpy as np

from optim.planning.formulate import plan_of
from optim.planning.gains import base_gains, tracking_gains
from optim.planning.make import Planned
from optim.planning.replay import joint_angle
from spacerobot.elements.goal import TipGoal
from spacerobot.scenario import Scenario
from spacerobot.scenario.load import to_document, validate
from spacerobot.scenario.merge import CONTROLLERS, overlay
from spacerobot.scenario.paths import Document
from spacerobot.scenario.phases import Phase, successors

PLAN = "plan.nc"
ALONE = "approach"
"""Phase of a scenario that has none, and open grasps."""


def flown_phase(scenario: Scenario) -> str:
    """Name of the phase in which a plan is flown, the first one; none without phases and open grasps."""
    opens = any(grasp.begins == "open" for grasp in scenario.grasps.values())
    return next(iter(scenario.phases), ALONE if opens else "")


def following(planned: Planned) -> Scenario:
    """The scenario with joints that track a plan, and what comes behind it."""
    scenario = planned.scene.scenario
    document = to_document(scenario)
    document["plan"] = None
    named = {side for contact in scenario.contacts.values() for side in contact.between}
    document["pads"] = {name: pad for name, pad in document["pads"].items() if name in named}
    _begin(planned, document)
    for robot in document["robots"].values():  # what plans in flight does not follow
        robot["controllers"] = {k: one for k, one in robot["controllers"].items() if one["kind"] != "mpc"}
    if flown_phase(scenario):
        return validate(_in_phases(planned, document))
    document["simulation"]["duration"] = planned.motion.duration_s
    for name, robot in document["robots"].items():
        robot |= overlay(robot, _resting(robot)) | {"controllers": _tracking(planned, name, "plan")}
        robot["actuators"] = _actuated(planned, name, robot["actuators"])
        for tip in robot["tips"].values():
            tip["controllers"] = {}
    return validate(document)


def _begin(planned: Planned, document: Document) -> None:
    """Put robots, in place, where the plan begins, as far as it was free to find that."""
    scene, q = planned.scene, planned.motion.q[0]
    for name, room in plan_of(scene).start.items():
        body, robot = scene.body(name), document["robots"][name]
        for joint in body.driven_joints:
            own = robot["joints"][body.joint_name(scene.model, joint)]
            position = joint_angle(scene.model.joints[joint], q)
            if own["angle_deg"] is not None:
                own["angle_deg"] = float(np.degrees(position))
            elif own["offset"] is not None:
                own["offset"] = position
        if room.places:
            first = int(scene.model.idx_qs[body.root_joint])
            place = robot["base"]["position"]
            axes = 2 if scene.model.nvs[body.root_joint] == 3 else 3
            robot["base"]["position"] = [*map(float, q[first : first + axes]), *place[axes:]]
            if room.rotation_deg:
                angle = float(np.degrees(np.arctan2(q[first + 3], q[first + 2])))
                robot["base"]["rotation_deg"] = [*robot["base"]["rotation_deg"][:2], angle]


def _in_phases(planned: Planned, document: Document) -> Document:
    """The plan in the first phase, what is left of that phase behind it, and the phases that follow."""
    scenario, flown = planned.scene.scenario, flown_phase(planned.scene.scenario)
    own = scenario.phases or {flown: Phase()}
    phases = {name: phase.model_dump(mode="json") for name, phase in own.items()}
    first, left = phases.pop(flown), _unused(f"{flown}_wait", set(phases))
    first["then"], first["otherwise"] = successors(own)[flown]
    first, rest = _parted(first, planned.motion.duration_s, left)
    document["simulation"]["duration"] = max(planned.motion.duration_s, scenario.simulation.duration)
    if rest is not None:
        rest["robots"] = overlay(rest["robots"], _waiting(planned, flown))
        phases = {left: rest, **phases}
        if scenario.simulation.duration > planned.motion.duration_s:
            first["captures"] = []  # behind the plan's end, where motions match
            waits = (first["until"] or {}).get("captured") or ()
            if any(scenario.grasps[name].begins == "open" for name in waits):
                first["until"] = None  # it ends with the plan
    key = _unused("plan", {name for robot in scenario.robots.values() for name in robot.controllers})
    for name, robot in document["robots"].items():
        first["robots"] = overlay(first["robots"], {name: _resting(robot)})
        tracking = _tracking(planned, name, key)
        if _has_controllers(robot):  # joints of one that has none stay where the plan leaves them
            for phase in phases.values():
                phase["robots"] = overlay(phase["robots"], {name: {"controllers": dict.fromkeys(tracking)}})
        robot["controllers"] |= tracking
        robot["actuators"] = _actuated(planned, name, robot["actuators"])
    document["phases"] = {flown: first, **phases}
    return document


def _parted(own: Document, duration: float, left: str) -> tuple[Document, Document | None]:
    """A phase that names its successors, for as long as the plan lasts, and what is left of it, if any."""
    timed = (own["until"] or {}).get("time")
    end = min(time for time in (timed, own["at_most"], np.inf) if time is not None)
    first = own | {"until": None if timed else own["until"], "at_most": duration}
    if end <= duration:
        return first | {"otherwise": own["then"] if timed == end else own["otherwise"]}, None
    rest = own | {"releases": [], "reset": False}
    if timed:
        rest["until"] = own["until"] | {"time": timed - duration}
    if own["at_most"] is None:
        rest["otherwise"] = None
    else:
        rest["at_most"] = own["at_most"] - duration
    if end == np.inf and own["until"] is None:
        rest["then"] = None
    return first | {"otherwise": left}, rest


def _resting(robot: Document) -> Document:
    """What differs of a robot while its joints track the plan: its own controllers rest."""
    found: Document = {"tips": {}, "controllers": dict.fromkeys(robot["controllers"])}
    for name, tip in robot["tips"].items():
        own: Document = {key: None for key in CONTROLLERS if tip[key] is not None}
        reference = {"kind": "plan", "file": PLAN}
        found["tips"][name] = {
            **own,
            "controllers": dict.fromkeys(tip["controllers"]),
            "reference": reference,
        }
    return found | ({} if robot["joint_pd"] is None else {"joint_pd": None})


def _waiting(planned: Planned, flown: str) -> Document:
    """What differs of the robots behind the plan: tips stay where it brought them."""
    scenario = planned.scene.scenario
    now = scenario.during(flown) if scenario.phases else scenario
    found: Document = {}
    for goal in plan_of(planned.scene).goals.values():
        if isinstance(goal, TipGoal):
            robot, _, tip = goal.tip.partition("/")
            reference = now.robots[robot].tips[tip].reference
            found = overlay(found, {robot: {"tips": {tip: {"reference": goal.kept(reference)}}}})
    return found


def _has_controllers(robot: Document) -> bool:
    tips = robot["tips"].values()
    led = any(tip["controllers"] or any(tip[key] for key in CONTROLLERS) for tip in tips)
    return led or bool(robot["joint_pd"] or robot["controllers"])


def _unused(name: str, taken: set[str]) -> str:
    """A name that is not taken."""
    return next(
        found for found in itertools.accumulate(itertools.repeat("_"), initial=name) if found not in taken
    )


def _tracking(planned: Planned, robot: str, key: str) -> Document:
    """Controllers of a robot that follow the plan, by name."""
    scene, driven, found = planned.scene, planned.motion.problem.stage.driven, {}
    if scene.body(robot).driven_joints:
        found[key] = {"kind": "joint_tracking", "file": PLAN, **tracking_gains(scene, robot)}
    if driven.of_base(robot):
        found[f"{key}_base"] = {"kind": "base_tracking", "file": PLAN, **base_gains(scene, robot)}
    return found


def _actuated(planned: Planned, robot: str, actuators: Document) -> Document:
    """A robot's actuators, and an ideal one where they do not deliver what the plan asks of the base."""
    scenario, axes = planned.scene.scenario, planned.motion.problem.stage.driven.of_base(robot)
    own = [part for _, one in scenario.robots[robot].driven_by() for part in one.base_wrench]
    if {"torque" if axis[0] == "t" else "force" for axis in axes} <= set(own):
        return actuators
    limits = plan_of(planned.scene).limits
    ideal = {"kind": "base_wrench", "force": limits.base_force or None, "torque": limits.base_torque or None}
    return actuators | {_unused("plan", set(actuators)): ideal}
