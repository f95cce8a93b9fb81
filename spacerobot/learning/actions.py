"""Actions of an environment: forces that a policy holds, and numbers of the scenario."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from spacerobot.common.errors import ScenarioError, near_names
from spacerobot.common.section import is_number
from spacerobot.scenario.load import to_document
from spacerobot.scenario.paths import expand, get
from spacerobot.scene import Scene, build_scene
from spacerobot.scene.actuation import torque_limit, wrench_limits

KEY = "policy"
"""Key of the controller in the section of each robot."""
TIP_FEEDBACK = ("pid", "amnesia", "orientation_pid", "orientation_amnesia")
"""Keys of a tip's controllers."""
Limits = float | Sequence[float]
"""Maximum magnitude of an action, or its lower and upper limit."""


@dataclass(frozen=True)
class Action:
    """Component of the actions.

    Attributes:
        name: ``robot/joint``, ``robot/base.force``, ``robot/base.torque``, or the dotted path of a number.
        robot: Robot whose controller holds the force; empty for a number of the scenario.
        place: Index among the robot's held forces.
        limits: Physical values for the actions -1 and 1; None if the scenario gives none.
    """

    name: str
    robot: str = ""
    place: int = 0
    limits: tuple[float, float] | None = None


def with_policy(scene: Scene, period: float, *, feedback: bool) -> Scene:
    """Return the scene with a policy for each robot.

    Args:
        scene, period: The scene, and the time between two actions [s].
        feedback: Whether the scenario's controllers act in addition; they are removed otherwise.
    """
    changes: dict[str, Any] = {}
    for body in scene.robots:
        parts = tuple(wrench_limits(scene, body))
        policy = {"kind": "policy", "period": period, "held": True, "parts": parts}
        if feedback:
            changes[f"{body.path}.controllers.{KEY}"] = policy
            continue
        changes[f"{body.path}.controllers"] = {KEY: policy}
        for tip in scene.scenario.robots[body.name].tips:
            changes |= {f"{body.path}.tips.{tip}.{key}": None for key in TIP_FEEDBACK}
            changes[f"{body.path}.tips.{tip}.controllers"] = {}
    if not feedback:
        for name, phase in scene.scenario.phases.items():
            changes[f"phases.{name}.robots"] = _without_feedback(phase.model_dump(mode="json")["robots"])
    return build_scene(scene.scenario, changes, source=scene.source)


def _without_feedback(robots: Mapping[str, Any]) -> dict[str, Any]:
    """Changes of a phase without those of controllers."""
    cleaned = {}
    for name, robot in robots.items():
        cleaned[name] = {key: value for key, value in robot.items() if key != "controllers"}
        if "tips" in robot:
            cleaned[name]["tips"] = {
                tip: {
                    key: value for key, value in section.items() if key not in (*TIP_FEEDBACK, "controllers")
                }
                for tip, section in robot["tips"].items()
            }
    return cleaned


def available_forces(scene: Scene) -> list[Action]:
    """Return every force that actions may set, in the order of the held forces of each robot."""
    actions = list[Action]()
    for body in scene.robots:
        joints = [body.joint_name(scene.model, joint) for joint in body.driven_joints]
        for place, joint in enumerate(joints):
            limits = _around_zero(torque_limit(body, joint))
            actions.append(Action(f"{body.name}/{joint}", body.name, place, limits))
        wrenches, first = wrench_limits(scene, body), len(joints)
        for part in [part for part in ("force", "torque") if part in wrenches]:
            name = f"{body.name}/base.{part}"
            actions += [
                Action(name, body.name, first + axis, _around_zero(limit))
                for axis, limit in enumerate(wrenches[part])
                if limit  # zero along an axis that the actuators cannot act on
            ]
            first += 3
    return actions


def _around_zero(limit: float | None) -> tuple[float, float] | None:
    """Symmetric limits of a force or torque; None if unlimited."""
    return (-float(limit), float(limit)) if limit is not None and 0 < limit < 1e300 else None


def numbers_of(scene: Scene, pattern: str) -> list[Action]:
    """Numbers of the scenario that match a pattern of dotted paths.

    Their limits are those of the ``tuning`` variable that sets them, if there is one.

    Args:
        scene: Scene with the active controllers.
        pattern: Dotted path, ``*`` for every name.

    Raises:
        ScenarioError: If the pattern matches nothing, or a value that is not a number.
    """
    document, bounds = to_document(scene.scenario), dict[str, tuple[float, float]]()
    variables = {} if scene.scenario.tuning is None else scene.scenario.tuning.variables
    for variable in variables.values():
        for each in variable.paths:
            try:
                bounds |= dict.fromkeys(expand(document, each), (variable.lower, variable.upper))
            except ScenarioError:  # of a controller that was removed
                continue
    try:
        paths = expand(document, pattern)
    except ScenarioError as fault:
        raise scene.error(f"actions: {pattern}: {fault.message}", "") from None
    for path in paths:
        if not is_number(get(document, path)):
            raise scene.error(f"actions: {path} is no number, found {get(document, path)!r}", "")
    return [Action(path, limits=bounds.get(path)) for path in paths]


def is_number_of_scenario(pattern: str) -> bool:
    """Whether an action's name is a dotted path, not ``robot/joint`` or ``robot/base.force``."""
    return "/" not in pattern and "." in pattern


def select_actions(scene: Scene, chosen: Sequence[str] | Mapping[str, Limits] | None) -> list[Action]:
    """Components of the actions.

    Args:
        scene: The scene with its policies.
        chosen: Names or patterns such as ``servicer/left_*`` and ``robots.*.tips.*.pid.kp``, or a mapping
            from these to limits; all joints if None.

    Raises:
        ScenarioError: If a name matches nothing, or a limit is missing.
    """
    forces = available_forces(scene)
    if chosen is None:
        selected = [one for one in forces if "/base." not in one.name]
    else:
        selected = list(_fitting(scene, forces, chosen))
    for one in selected:
        if one.limits is None:
            example = 10.0 if one.robot else [0.0, 10.0]
            message = (
                f"actions: {one.name} has no limit in the scenario; give one: {{'{one.name}': {example}}}"
            )
            raise scene.error(message, "")
        if not one.limits[0] < one.limits[1]:
            low, high = one.limits
            raise scene.error(f"actions: {one.name}: found limits {low:g} and {high:g}, allowed: rising", "")
    return selected


def _fitting(
    scene: Scene, forces: Sequence[Action], chosen: Sequence[str] | Mapping[str, Limits]
) -> Iterator[Action]:
    """Actions that match names or patterns, each listed once, with their limits."""
    names, limits = set[tuple[str, int]](), dict(chosen) if isinstance(chosen, Mapping) else {}
    for pattern in chosen:
        if is_number_of_scenario(pattern):
            fitting = numbers_of(scene, pattern)
        else:
            fitting = [one for one in forces if fnmatch.fnmatchcase(one.name, pattern)]
        if not fitting:
            hint = near_names(pattern, dict.fromkeys(one.name for one in forces))
            raise scene.error(f"actions: found '{pattern}', {hint}", "")
        for one in fitting:
            if (one.name, one.place) in names:
                continue
            names.add((one.name, one.place))
            limit = limits.get(pattern)
            if limit is None:
                yield one
            elif isinstance(limit, int | float):
                yield replace(one, limits=_around_zero(limit))
            else:
                low, high = limit
                yield replace(one, limits=(float(low), float(high)))
