"""Scenario in which the robots track a plan.

Joints track the plan in the scenario's first phase, or in the first phases if the plan has several. Grasps
that such a phase captures close at its end. If the last of these phases is longer than the plan, its rest
becomes a phase of its own: there the scenario's controllers take over, and mated tips hold their mating
frames. Later phases are unchanged.
"""

from __future__ import annotations

import itertools

import numpy as np

from optim.planning.formulation.base_actuation import section_base_limits
from optim.planning.formulation.formulate import mated, plan_section
from optim.planning.search.make_plan import PlanSolution
from optim.planning.verification.replay import joint_angle
from optim.planning.verification.tracking_gains import base_gains, tracking_gains
from spacerobot.scenario import Scenario
from spacerobot.scenario.load import to_document, validate
from spacerobot.scenario.merge import CONTROLLERS, overlay
from spacerobot.scenario.paths import Document
from spacerobot.scenario.phases import Phase, successors

PLAN = "plan.nc"
ALONE = "approach"
"""Name of the tracked phase in a scenario that has open grasps but no phases."""


def plan_phase(scenario: Scenario) -> str:
    """Phase in which a plan of one phase is tracked, the first; empty with neither phases nor open grasps."""
    opens = any(grasp.begins == "open" for grasp in scenario.grasps.values())
    return next(iter(scenario.phases), ALONE if opens else "")


def following_scenario(planned: PlanSolution) -> Scenario:
    """Scenario in which joints track a plan, followed by the scenario's other phases."""
    scenario = planned.scene.scenario
    document = to_document(scenario)
    document["plan"] = None
    named = {side for contact in scenario.contacts.values() for side in contact.between}
    document["pads"] = {name: pad for name, pad in document["pads"].items() if name in named}
    # Move robots, in place, to the plan's start if the plan was free to choose it.
    scene, q = planned.scene, planned.motion.q[0]
    for name, room in plan_section(scene).start.items():
        body, robot = scene.body(name), document["robots"][name]
        for joint in body.driven_joints:
            settings = robot["joints"][body.joint_name(scene.model, joint)]
            position = joint_angle(scene.model.joints[joint], q)
            if settings["angle_deg"] is not None:
                settings["angle_deg"] = float(np.degrees(position))
            elif settings["offset"] is not None:
                settings["offset"] = position
        if room.places:
            first = int(scene.model.idx_qs[body.root_joint])
            place = robot["base"]["position"]
            axes = 2 if scene.model.nvs[body.root_joint] == 3 else 3
            robot["base"]["position"] = [*map(float, q[first : first + axes]), *place[axes:]]
            if room.rotation_deg:
                angle = float(np.degrees(np.arctan2(q[first + 3], q[first + 2])))
                robot["base"]["rotation_deg"] = [*robot["base"]["rotation_deg"][:2], angle]
    for name, robot in scenario.robots.items():  # what plans in flight, or follows a plan made before
        for key, controller in robot.controllers.items():
            if controller.replanning is not None or controller.fills is not None:
                del document["robots"][name]["controllers"][key]
    if plan_phase(scenario):
        return validate(_in_phases(planned, document))
    document["simulation"]["duration"] = planned.phased_motion.duration_s
    for name, robot in document["robots"].items():
        robot |= overlay(robot, _resting(robot)) | {"controllers": _tracking(planned, name, 0, "plan")}
        robot["actuators"] = _actuated(planned, name, robot["actuators"])
        for tip in robot["tips"].values():
            tip["controllers"] = {}
    return validate(document)


def handover_warnings(planned: PlanSolution) -> list[str]:
    """Warnings, one for each goal after which the scenario's controllers take over moving joints."""
    scenario = planned.scene.scenario
    if not plan_phase(scenario):
        return []
    robots = to_document(scenario)["robots"]
    last = next(reversed(plan_section(planned.scene).by_phase.values()))
    return [
        f"goal {name!r} is not `settled`: controllers of {goal.body} take over joints that are in motion, "
        "and brake them at once; give `settled: true`"
        for name, goal in last.goals.items()
        if goal.ends_in_motion and goal.body in robots and _has_controllers(robots[goal.body])
    ]


def _in_phases(planned: PlanSolution, document: Document) -> Document:
    """Document with the plan in the first phases, the rest of the last one, and the later phases."""
    scenario = planned.scene.scenario
    phase_names = planned.names if any(planned.names) else (plan_phase(scenario),)
    scenario_phases = scenario.phases or {phase_names[0]: Phase()}
    phases = {name: phase.model_dump(mode="json") for name, phase in scenario_phases.items()}
    phased_motion, last = planned.phased_motion, phase_names[-1]
    closing = phase_names[:-1]
    if len(phase_names) > 1:  # the plan may end where all is mated that its last phase is to capture
        goals, ending = plan_section(planned.scene).by_phase[last].goals, scenario.phases[last].until
        caught = (ending.captured or ()) if ending is not None else ()
        if caught and all(mated(scenario.grasps[name], goals) for name in caught):
            closing = phase_names
    for k, name in enumerate(closing):
        # a planned phase ends after its duration; the grasps that it captures close then
        phase, duration = phases[name], phased_motion.motions[k].duration_s
        captured = (phase["until"] or {}).get("captured") or []
        until = {"captured": captured} if captured else {"time": duration}
        phase |= {"until": until, "timeout": None, "on_timeout": None, "captures": captured}
        for grasp in captured:
            capture = {key: document["grasps"][grasp]["capture"][key] for key in ("axis", "mated_deg")}
            at = float(phased_motion.begins[k]) + duration
            document["grasps"][grasp]["capture"] = {"at": at, **capture}
    end, left = phases.pop(last), _unused(f"{last}_wait", set(phases))
    rest, (next_phase, on_timeout) = None, successors(scenario_phases)[last]
    if last not in closing:
        end |= {"next": next_phase, "on_timeout": on_timeout}
        end, rest = _parted(
            end,
            phased_motion.motions[-1].duration_s if len(phase_names) > 1 else phased_motion.duration_s,
            left,
        )
    document["simulation"]["duration"] = max(phased_motion.duration_s, scenario.simulation.duration)
    if rest is not None:
        # after the plan, tips hold the pose that it reached
        during = scenario.during(last) if scenario.phases else scenario
        for goal in next(reversed(plan_section(planned.scene).by_phase.values())).goals.values():
            if goal.tip_label is not None:
                name, _, tip = goal.tip_label.partition("/")
                held = {"reference": goal.kept(during.robots[name].tips[tip].reference)}
                rest["robots"] = overlay(rest["robots"], {name: {"tips": {tip: held}}})
        if scenario.simulation.duration > phased_motion.duration_s:
            end["captures"] = []  # behind the plan's end, where motions match
            waits = (end["until"] or {}).get("captured") or ()
            if any(scenario.grasps[name].begins == "open" for name in waits):
                end["until"] = None  # it ends with the plan
    order = [
        *phase_names,
        *([left] if rest is not None else []),
        *(name for name in scenario_phases if name not in phase_names),
    ]
    phases |= {last: end} | ({} if rest is None else {left: rest})
    phases = {name: phases[name] for name in order}
    # Activate, in place, each robot's tracking controllers in their phase only.
    controller_names = {
        name for robot in planned.scene.scenario.robots.values() for name in robot.controllers
    }
    before = {name: dict(robot) for name, robot in document["robots"].items()}
    for k, now in enumerate(phase_names):
        key = _unused("plan" if len(phase_names) == 1 else f"plan_{now}", controller_names)
        for name, robot in document["robots"].items():
            resting = {name: _resting(before[name])}
            phases[now]["robots"] = overlay(phases[now]["robots"], resting)
            tracking = _tracking(planned, name, k, key)
            others = [phase for other, phase in phases.items() if other != now]
            if len(phase_names) == 1 and not _has_controllers(before[name]):
                others = []  # joints of one that has none stay where the plan leaves them
            for phase in others:
                phase["robots"] = overlay(phase["robots"], {name: {"controllers": dict.fromkeys(tracking)}})
            robot["controllers"] = {**robot["controllers"], **tracking}
    for name, robot in document["robots"].items():
        robot["actuators"] = _actuated(planned, name, robot["actuators"])
    for phase in phases.values():  # what they change of controllers that the document no longer has
        for name, robot in phase["robots"].items():
            controllers = document["robots"][name]["controllers"]
            phase_controllers = (robot or {}).get("controllers") or {}
            for key in [
                key
                for key, section in phase_controllers.items()
                if section is None and key not in controllers
            ]:
                del phase_controllers[key]
    document["phases"] = phases
    return document


def _parted(section: Document, duration: float, rest_name: str) -> tuple[Document, Document | None]:
    """Split a phase into the part tracked by the plan and the remaining part, if there is one."""
    timed = (section["until"] or {}).get("time")
    end = min(time for time in (timed, section["timeout"], np.inf) if time is not None)
    first = section | {"until": None if timed else section["until"], "timeout": duration}
    if end <= duration:
        return first | {"on_timeout": section["next"] if timed == end else section["on_timeout"]}, None
    rest = section | {"releases": [], "reset": False}
    if timed:
        rest["until"] = section["until"] | {"time": timed - duration}
    if section["timeout"] is None:
        rest["on_timeout"] = None
    else:
        rest["timeout"] = section["timeout"] - duration
    if end == np.inf and section["until"] is None:
        rest["next"] = None
    return first | {"on_timeout": rest_name}, rest


def _resting(robot: Document) -> Document:
    """Changes that deactivate a robot's own controllers while its joints track the plan."""
    changes: Document = {"tips": {}, "controllers": dict.fromkeys(robot["controllers"])}
    for name, tip in robot["tips"].items():
        rest: Document = {key: None for key in CONTROLLERS if tip[key] is not None}
        reference = {"kind": "plan", "file": PLAN}
        changes["tips"][name] = {
            **rest,
            "controllers": dict.fromkeys(tip["controllers"]),
            "reference": reference,
        }
    return changes | ({} if robot["joint_pd"] is None else {"joint_pd": None})


def _has_controllers(robot: Document) -> bool:
    tips = robot["tips"].values()
    led = any(tip["controllers"] or any(tip[key] for key in CONTROLLERS) for tip in tips)
    return led or bool(robot["joint_pd"] or robot["controllers"])


def _unused(name: str, names: set[str]) -> str:
    """Name that is not in ``names``."""
    return next(
        candidate
        for candidate in itertools.accumulate(itertools.repeat("_"), initial=name)
        if candidate not in names
    )


def _tracking(planned: PlanSolution, robot: str, k: int, key: str) -> Document:
    """Controllers of a robot that track a phase of the plan, by name."""
    scene, motion = planned.scene, planned.phased_motion.motions[k]
    driven = motion.problem.stage.driven
    file, controllers = {"file": PLAN} | ({"phase": planned.names[k]} if planned.names[k] else {}), {}
    if scene.body(robot).driven_joints:
        controllers[key] = {"kind": "joint_tracking", **file, **tracking_gains(motion, robot)}
    if driven.of_base(robot):
        controllers[f"{key}_base"] = {"kind": "base_tracking", **file, **base_gains(scene, robot)}
    return controllers


def _actuated(planned: PlanSolution, robot: str, actuators: Document) -> Document:
    """Robot's actuators, with an ideal one added if they do not deliver the plan's base wrench."""
    scenario = planned.scene.scenario
    axes = [a for motion in planned.phased_motion.motions for a in motion.problem.stage.driven.of_base(robot)]
    driven_parts = [part for _, one in scenario.robots[robot].driven_by() for part in one.base_wrench]
    if {"torque" if axis[0] == "t" else "force" for axis in axes} <= set(driven_parts):
        return actuators
    limits = [section_base_limits(plan.limits) for plan in plan_section(planned.scene).by_phase.values()]
    ideal = {
        "kind": "base_wrench",
        "force": max(base_limits.get("force", 0.0) for base_limits in limits) or None,
        "torque": max(base_limits.get("torque", 0.0) for base_limits in limits) or None,
    }
    return actuators | {_unused("plan", set(actuators)): ideal}
