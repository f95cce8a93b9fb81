"""What the animated page shows, as plain data: bodies, poses, paths, forces and errors over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from spacerobot.result import Result
from spacerobot.scene import Scene
from viz.figures.collect import check_comparable
from viz.figures.style import labels_of
from viz.geometry import Array
from viz.meshcat_scene import changed_descriptions, node_data, packed, poses, rounded
from viz.motion import Motion, bounds, extremes, initial_motion, pick_rows, sample_motion

FRAMES_PER_S = 25.0
"""Of simulated time; the page interpolates between them."""

MOST_FRAMES = 1500
MOST_ERRORS = 4000

_ARROW_SHARE = 0.1  # the longest arrow, as a share of the scene's size


def animation(*results: Result, title: str | None = None, autoplay: bool = True) -> dict[str, Any]:
    """Data of a page that plays one result, or compares several.

    Parameters
    ----------
    results
        What to show; unfinished ones are shown up to where they went.
    title
        Heading of the page; the scenarios' names if not given.
    autoplay
        Whether it plays at once.

    Raises
    ------
    ResultError
        If the results cannot be compared.
    """
    check_comparable(results)
    scenes = [result.scene() for result in results]
    motions = [
        sample_motion(
            result, scene, pick_rows(result.data.time.values, rate_hz=FRAMES_PER_S, most=MOST_FRAMES)
        )
        for result, scene in zip(results, scenes, strict=True)
    ]
    boxes = [_box(result, motion) for result, motion in zip(results, motions, strict=True)]
    low, high = np.min([box[0] for box in boxes], axis=0), np.max([box[1] for box in boxes], axis=0)
    scale = float(np.linalg.norm(high - low))
    force = max(_greatest_force(result, motion) for result, motion in zip(results, motions, strict=True))
    labels = labels_of(results)
    runs = [
        _run_data(*parts, label, _ARROW_SHARE * scale / force if force else 0.0)
        for *parts, label in zip(results, scenes, motions, labels, strict=True)
    ]
    return {
        "title": title or " and ".join(labels),
        "about": _about(results[0], scenes[0]),
        "notices": _notices(results, scenes, labels),
        "planar": scenes[0].planar,
        "box": [rounded(low), rounded(high)],
        "reach": [rounded(point) for motion in motions for point in extremes(motion, low, high)],
        "scale": scale,
        "greatest_force": force,
        "autoplay": autoplay,
        "runs": runs,
    }


def still(scene: Scene, *, about: str = "not simulated yet") -> dict[str, Any]:
    """Data of a page that shows a scene as it begins."""
    motion = initial_motion(scene)
    low, high = bounds(motion)
    run = {
        "label": scene.scenario.name,
        "completed": True,
        "nodes": node_data(motion.nodes),
        "time": packed(motion.time),
        "poses": poses(motion),
        "tip_names": [],
        "tips": "",
        "references": [],
        "target": None,
        "grasp_tips": [],
        "forces": "",
        "mates": "",
        "metres_per_newton": 0.0,
        "error_time": packed(motion.time),
        "errors": [],
    }
    return {
        "title": scene.scenario.name,
        "about": about,
        "notices": list(scene.warnings),
        "planar": scene.planar,
        "box": [rounded(low), rounded(high)],
        "reach": [rounded(point) for point in extremes(motion, low, high)],
        "scale": float(np.linalg.norm(high - low)),
        "greatest_force": 0.0,
        "autoplay": False,
        "runs": [run],
    }


def _run_data(
    result: Result, scene: Scene, motion: Motion, label: str, metres_per_newton: float
) -> dict[str, Any]:
    data, rows = result.data, motion.rows
    tips = [str(tip) for tip in data.tip.values]
    finer = pick_rows(data.time.values, rate_hz=1e9, most=MOST_ERRORS)
    error = np.linalg.norm(data.tip_error.values[finer], axis=-1)
    target = scene.target
    return {
        "label": label,
        "completed": result.completed,
        "nodes": node_data(motion.nodes),
        "time": packed(motion.time),
        "poses": poses(motion),
        "tip_names": tips,
        "tips": packed(data.tip_position.values[rows]),
        "references": [packed(data.tip_reference.sel(tip=tip).values[rows]) for tip in tips],
        "target": packed(data.body_position.sel(body=target.name).values[rows]) if target else None,
        "grasp_tips": [tips.index(grasp.tip.label) for grasp in scene.grasps],
        "forces": packed(data.grasp_force.values[rows]),
        "mates": packed(motion.mates),
        "metres_per_newton": metres_per_newton,
        "error_time": packed(data.time.values[finer]),
        "errors": [packed(error[:, k]) for k in range(len(tips))],
    }


def _box(result: Result, motion: Motion) -> tuple[Array, Array]:
    """Box around bodies and references, m."""
    low, high = bounds(motion)
    reference = result.data.tip_reference.values[motion.rows].reshape(-1, 3)
    if len(reference):
        low, high = np.minimum(low, reference.min(axis=0)), np.maximum(high, reference.max(axis=0))
    return low, high


def _greatest_force(result: Result, motion: Motion) -> float:
    """Greatest grip force, N; of a diverged rollout, before its last instants."""
    force = np.linalg.norm(result.data.grasp_force.values[motion.rows], axis=-1)
    kept = force if result.completed else force[: max(1, int(0.8 * len(force)))]
    return float(kept.max(initial=0.0))


def _about(result: Result, scene: Scene) -> str:
    engine = result.summary["engine"]["name"]
    kind = "planar" if scene.planar else "spatial"
    text = f"{kind}, {result.scenario.simulation.duration:g} s by {engine}"
    return f"{text}. {result.scenario.description}" if result.scenario.description else text


def _notices(results: Sequence[Result], scenes: Sequence[Scene], labels: Sequence[str]) -> list[str]:
    """What a viewer must know before believing the picture."""
    found = []
    for result, scene, label in zip(results, scenes, labels, strict=True):
        who = f"{label}: " if len(results) > 1 else ""
        lines = []
        if not result.completed:
            end, wanted = result.data.time.values[-1], result.scenario.simulation.duration
            lines.append(f"The rollout diverged after {end:.4g} s of {wanted:g} s and is shown up to there.")
        lines += [*scene.warnings, *changed_descriptions(result, scene)]
        found += [who + line for line in lines]
    return list(dict.fromkeys(found))
