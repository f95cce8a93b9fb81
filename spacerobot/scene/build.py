"""Scenes from scenarios."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pinocchio as pin

from spacerobot.common.errors import ScenarioError, near_names
from spacerobot.common.files import StrPath
from spacerobot.description.read import Description
from spacerobot.scenario import Robot, Scenario
from spacerobot.scene.assumptions import list_assumptions, list_warnings
from spacerobot.scene.checks import (
    check_alignment,
    check_elements,
    check_environment,
    check_gaps,
    check_inertia,
    check_masses,
    check_motion,
    check_rank,
    is_planar,
)
from spacerobot.scene.configure import close_velocity, initial_state
from spacerobot.scene.contacts import check_overlap, find_contacts
from spacerobot.scene.grasp_closing import has_loops
from spacerobot.scene.model import build_model
from spacerobot.scene.reference_checks import check_followed, check_in_plane
from spacerobot.scene.references import references_of
from spacerobot.scene.resolve import resolve
from spacerobot.scene.scene import Scene, SceneGrasp, SceneTip


def build_scene(
    scenario: Scenario,
    changes: Mapping[str, Any] | Sequence[tuple[str, Any]] = (),
    *,
    source: StrPath | None = None,
    expand_xacro: bool = False,
) -> Scene:
    """Build the scene of a scenario; see :func:`.load_scene`.

    Args:
        scenario: The scenario.
        changes: Values by dotted path that replace those of the scenario, as pairs or a mapping.
        source: File of the scenario: relative URDF paths start at its folder, and errors name it.
        expand_xacro: Whether ``.xacro`` files are expanded unless the scenario contains the expanded text, as
            results do.

    Raises:
        ScenarioError, DescriptionError: If a change names no value, or the scenario or a URDF cannot be
            simulated.
    """
    source = None if source is None else Path(source)
    return assemble(*resolve(scenario, changes, source=source, expand_xacro=expand_xacro), source=source)


def assemble(resolved: Scenario, descriptions: Mapping[str, Description], *, source: Path | None) -> Scene:
    """Scene of a scenario that is complete.

    Args:
        resolved, descriptions: As :func:`.resolve` returns them.
        source: File of the scenario.

    Raises:
        ScenarioError, DescriptionError: If the scenario or a URDF cannot be simulated.
    """
    check_masses(resolved, descriptions, source=source)
    model, bodies = build_model(resolved, descriptions)
    check_motion(model, source=source)
    during = {name: resolved.during(name) for name in resolved.phases}
    tips = list[SceneTip]()
    for body in bodies:
        for name, tip in body.config.tips.items() if isinstance(body.config, Robot) else ():
            path = f"{body.path}.tips.{name}"
            link = tip.frame or name
            names = [link.name for link in body.description.links]
            if link not in names:
                raise ScenarioError(
                    f"no link {link!r} in {body.description.path.name}; {near_names(link, names)}",
                    source=source,
                    where=(f"{path}.frame" if tip.frame else path),
                )
            frame = int(model.getFrameId(f"{body.name}/{link}", pin.FrameType.BODY))
            joint = int(model.frames[frame].parentJoint)
            references = references_of(f"{body.name}/{name}", resolved, during)
            tips.append(SceneTip(f"{body.name}/{name}", path, body, frame, joint, tip, references))
    by_label = {tip.label: tip for tip in tips}
    held = list[SceneGrasp]()
    for name, config in resolved.grasps.items():
        path = f"grasps.{name}"
        links = [
            f.name.removeprefix("target/")
            for f in model.frames
            if f.type == pin.FrameType.BODY and f.name.startswith("target/")
        ]
        frame = model.getFrameId(f"target/{config.frame}", pin.FrameType.BODY)
        if frame >= model.nframes:
            raise ScenarioError(
                f"no link {config.frame!r} in the target's URDF; {near_names(config.frame, links)}",
                source=source,
                where=f"{path}.frame",
            )
        joint = int(model.frames[frame].parentJoint)
        held.append(SceneGrasp(name, path, by_label[config.tip], int(frame), joint, config))
    grasps = tuple(held)
    q, v = initial_state(model, bodies, grasps, source=source)
    planar = is_planar(model, bodies, q)
    contacts = find_contacts(model, bodies, resolved, source)
    scene = Scene(resolved, source, model, bodies, tuple(tips), grasps, planar, q, v, (), (), contacts)
    check_inertia(scene)
    check_alignment(scene)
    check_gaps(scene)
    check_rank(scene)
    check_elements(scene)
    check_environment(scene)
    check_followed(scene)
    check_in_plane(scene)
    check_overlap(scene)
    if has_loops(scene):
        scene = dataclasses.replace(scene, v=close_velocity(scene))
    for array in (scene.q, scene.v):
        array.setflags(write=False)
    return dataclasses.replace(scene, assumptions=list_assumptions(scene), warnings=list_warnings(scene))
