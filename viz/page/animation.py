"""Data of the animated page: bodies, poses, paths, forces and errors over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.result import Result
from spacerobot.result.trust import warning
from spacerobot.scene import Scene
from viz.drawing.motion import (
    BodyMotion,
    SceneGeometry,
    bounds,
    extremes,
    greatest_force,
    initial_motion,
    only,
    passive_positions,
    pick_rows,
    sample_motion,
)
from viz.drawing.view import first_view, view_of
from viz.figures.collect import check_comparable
from viz.figures.labels import labels_of
from viz.page.centres_of_mass import NO_MASSES, mass_data
from viz.page.contacts import NO_CONTACTS, NO_GRIPS, NO_PLUMES, contact_data, grip_data, plume_data
from viz.page.events import event_data
from viz.page.limits import drawn_limits
from viz.page.meshcat_scene import Meshes, changed_descriptions, packed, poses, rounded
from viz.page.panel import panel_data
from viz.page.planet import has_backdrop, limb_view, planet_data
from viz.page.reaction_wheels import NO_REACTION_WHEELS, reaction_wheel_data
from viz.page.shots import box_corners, shots
from viz.page.signals import chart_rows, quantities, signal_data

FRAMES_PER_S = 25.0
"""Frames per second of simulated time; the page interpolates between them."""

MOST_FRAMES = 1500

ENLARGED = (10, 100)
"""Factors for enlarged deflections of flexible links."""

FIRST_SHOWN = 2
"""Number of results shown when the page of several opens."""

_ARROW_SHARE = 0.07  # the longest arrow, as a share of the scene's size
_NEAREST_SHARE = 0.06  # half of what the close view shows at the least, likewise


def animation(
    *results: Result,
    title: str | None = None,
    autoplay: bool = True,
    names: Sequence[str] | None = None,
    first: int = FIRST_SHOWN,
) -> dict[str, Any]:
    """Data of a page that plays one result, or compares several.

    Args:
        results: Results to show; unfinished ones are shown up to their end.
        title: Heading of the page; names of the results if None.
        autoplay: Whether the animation starts automatically.
        names: Names of the results; their folders or scenarios if None.
        first: Number of results shown at first; the others are selected in the panel.

    Raises:
        ResultError: If the results cannot be compared.
    """
    check_comparable(results)
    labels = list(names or labels_of(results))
    data = shown_data([look_at(r, name) for r, name in zip(results, labels, strict=True)], title, autoplay)
    return data | {"panel": panel_data(results, labels) | {"first": first}}


def shown_data(
    results: Sequence[AnimatedResult], title: str | None = None, autoplay: bool = False
) -> dict[str, Any]:
    """Data of a page for prepared results, without the side panel."""
    meshes = Meshes(node for one in results for node in one.motion.nodes)
    # box around bodies and references, m
    corners = [bounds(one.motion, diverged=not one.result.completed) for one in results]
    references = [one.result.array("tip_reference")[one.motion.rows].reshape(-1, 3) for one in results]
    low = np.vstack([*(lowest for lowest, _ in corners), *references]).min(axis=0)
    high = np.vstack([*(highest for _, highest in corners), *references]).max(axis=0)
    scale = float(np.linalg.norm(high - low))
    force = max(greatest_force(one.result) for one in results)
    first = results[0]
    view = view_of(first.result, first.scene)
    if not first.scene.planar:
        view = limb_view(view, planet_data(first.result, first.motion.rows))
    # description of the shown results, for a reader who does not know the scenario
    engine = first.result.summary["engine"]["name"]
    scenario, kind = first.result.scenario, "planar" if first.scene.planar else "spatial"
    simulated_s = max(float(one.result.array("time")[-1]) for one in results)
    words = f"{kind}, {simulated_s:.4g} s, simulated by {engine}"
    if scenario.description and len({one.result.scenario.name for one in results}) == 1:
        words = f"{scenario.description} ({words})"
    # warnings to display next to the picture
    prefixes = [f"{one.label}: " if len(results) > 1 else "" for one in results]
    lines = [
        k + line for k, one in zip(prefixes, results, strict=True) for line in notices(one.result, one.scene)
    ]
    # points around what the tips do: the object, tips and references; none without tips
    near = list[Array]()
    for one in results:
        motion, target = one.motion, one.scene.target
        tips = [one.result.array(name)[motion.rows] for name in ("tip_reference", "tip_position")]
        points = [path.reshape(-1, 3) for path in tips]
        if not len(points[0]):
            continue
        if target is not None:
            points.append(extremes(only(motion, target.name), low, high))
        together = np.clip(np.concatenate(points), low, high)
        middle, half = (together.min(axis=0) + together.max(axis=0)) / 2, np.ptp(together, axis=0) / 2
        # a tip that holds still would alone fill the view
        half = np.maximum(half, np.minimum(_NEAREST_SHARE * scale, (high - low) / 2))
        near += list(box_corners(middle, half))
    labels = [one.label for one in results]
    heading = (
        f"{labels[0]} and {len(labels) - 1} others" if len(labels) > FIRST_SHOWN else " and ".join(labels)
    )
    return {
        "title": title or heading,
        "about": words,
        "notices": list(dict.fromkeys(lines)),
        "planar": first.scene.planar,
        "backdrop": has_backdrop(first.scene),
        "towards": rounded(view.towards),
        "shots": shots(results[0].result, results[0].scene, results[0].motion, view, (low, high)),
        "box": [rounded(low), rounded(high)],
        "reach": [rounded(point) for one in results for point in extremes(one.motion, low, high)],
        "near": [rounded(point) for point in near],
        "scale": scale,
        "longest_arrow": _ARROW_SHARE,
        "greatest_force": force,
        "autoplay": autoplay,
        "meshes": meshes.data(),
        "runs": [run_data(one) | {"nodes": meshes.node_data(one.motion.nodes)} for one in results],
    }


@dataclass(frozen=True, eq=False)
class AnimatedResult:
    """Result with its scene, its motion, and its label.

    ``bent`` are motions with enlarged deflections of flexible links, by factor.
    """

    result: Result
    scene: Scene
    motion: BodyMotion
    label: str
    bent: Mapping[int, BodyMotion] = field(default_factory=dict)


def look_at(
    result: Result, label: str, scene: Scene | None = None, stage: SceneGeometry | None = None
) -> AnimatedResult:
    """Result prepared for display.

    ``scene`` is the result's own, and ``stage`` the scene's geometry; both are built if None.
    """
    scene = scene or result.scene()
    rows = pick_rows(result.array("time"), rate_hz=FRAMES_PER_S, most=MOST_FRAMES)
    stage = stage or SceneGeometry.of(scene)
    bent = {k: sample_motion(result, scene, rows, stage, k) for k in ENLARGED if passive_positions(scene)}
    return AnimatedResult(result, scene, sample_motion(result, scene, rows, stage), label, bent)


def still(scene: Scene, *, about: str | None = None) -> dict[str, Any]:
    """Data of a page that shows a scene's initial state.

    ``about`` is the caption, its description by default.
    """
    motion = initial_motion(scene)
    low, high = bounds(motion)
    meshes = Meshes(motion.nodes)
    run = {
        "label": scene.scenario.name,
        "completed": True,
        "nodes": meshes.node_data(motion.nodes),
        "time": packed(motion.time),
        "poses": poses(motion),
        "tip_names": [],
        "tips": "",
        "references": [],
        "target": None,
        "tip_nodes": [],
        "grasp_tips": [],
        "forces": "",
        "mates": "",
        "grips": NO_GRIPS,
        "contacts": NO_CONTACTS,
        "plumes": NO_PLUMES,
        "wheels": NO_REACTION_WHEELS,
        "masses": NO_MASSES,
        "planet": None,
        "fine_time": packed(motion.time),
        "errors": [],
        "quantities": [],
    }
    return {
        "title": scene.scenario.name,
        "about": about if about is not None else scene.scenario.description or "",
        "notices": list(scene.warnings),
        "planar": scene.planar,
        "backdrop": has_backdrop(scene),
        "towards": rounded(first_view(scene).towards),
        "box": [rounded(low), rounded(high)],
        "reach": [rounded(point) for point in extremes(motion, low, high)],
        "near": [],
        "shots": [],
        "scale": float(np.linalg.norm(high - low)),
        "longest_arrow": _ARROW_SHARE,
        "greatest_force": 0.0,
        "autoplay": False,
        "meshes": meshes.data(),
        "runs": [run],
    }


def run_data(animated: AnimatedResult) -> dict[str, Any]:
    """Data of a run that depend on its numbers: all except its nodes."""
    result, motion = animated.result, animated.motion
    rows = motion.rows
    tips = [str(tip) for tip in result.array("tip")]
    shown_over_time = quantities(result)
    finer = chart_rows(result, shown_over_time)
    error, led = result.array("tip_error")[finer], result.led_tips
    references, bodies = result.array("tip_reference")[rows], result.array("body_position")[rows]
    target = animated.scene.target
    node_joints, carrying = [node.joint for node in motion.nodes], [tip.joint for tip in animated.scene.tips]
    return {
        "label": animated.label,
        "completed": result.completed,
        "time": packed(motion.time),
        "poses": poses(motion),
        **({"bent": {str(k): poses(one) for k, one in animated.bent.items()}} if animated.bent else {}),
        "tip_names": tips,
        "tips": packed(result.array("tip_position")[rows]),
        "references": [packed(references[:, k]) for k in range(len(tips))],
        "target": packed(bodies[:, list(result.array("body")).index(target.name)]) if target else None,
        "tip_nodes": [node_joints.index(joint) if joint in node_joints else 0 for joint in carrying],
        "grasp_tips": [tips.index(grasp.tip.label) for grasp in animated.scene.grasps],
        "forces": packed(result.array("grasp_force")[rows]),
        "mates": packed(motion.mates),
        "grips": grip_data(result, rows),
        "contacts": contact_data(result, rows),
        "plumes": plume_data(result, rows),
        "wheels": reaction_wheel_data(result, motion),
        "masses": mass_data(result, animated.scene, motion),
        "planet": planet_data(result, rows),
        "events": event_data(result),
        "fine_time": packed(result.array("time")[finer]),
        "errors": [packed(error[:, k]) if tip in led else None for k, tip in enumerate(tips)],
        "quantities": signal_data(shown_over_time, finer, drawn_limits(animated.scene)),
    }


def notices(result: Result, scene: Scene) -> list[str]:
    """Warnings to display next to pictures of a result, one line each."""
    lines = []
    if not result.completed:
        end, duration = result.array("time")[-1], result.scenario.simulation.duration
        lines.append(f"The rollout diverged after {end:.4g} s of {duration:g} s and is shown up to there.")
    status_warning = warning(result.summary["status"])
    if status_warning is not None:
        lines.append(f"{status_warning[0].upper()}{status_warning[1:]}.")
    return [*lines, *scene.warnings, *changed_descriptions(result, scene)]
