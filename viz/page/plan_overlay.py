"""Comparison of a plan with its simulation: pale bodies, planned curves, keep-out shapes, cones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import xarray as xr
from scipy.interpolate import CubicSpline

from spacerobot.common.errors import ResultError
from spacerobot.result import Result
from spacerobot.scene import Scene
from spacerobot.scene.contacts import find_pairs
from viz.drawing.motion import SceneGeometry, pad_solids, place, scene_nodes
from viz.page.animation import FRAMES_PER_S, animation
from viz.page.meshcat_scene import packed, poses, rounded, solid_data

CONE = (0.55, 0.8, 1.0, 0.25)
"""Colour and opacity of approach cones."""
LONG = 0.1
"""Length of a cone, as a fraction of the scene's size."""


def beside_its_plan(simulation: Result, scene: Scene, plan: xr.Dataset) -> dict[str, Any]:
    """Data of a page that plays a result together with the plan that it follows, drawn pale.

    Args:
        simulation: The result.
        scene: Scene of the plan, with its plan section.
        plan: Content of ``plan.nc``.

    Raises:
        ResultError: If the result has other bodies or joints.
    """
    if simulation.data.q.shape[1] != plan.q.shape[1]:
        raise ResultError("was not flown by this plan: its bodies are others", source=simulation.folder)
    data = animation(simulation, title=f"{simulation.scenario.name}: the plan, followed")
    (run,) = data["runs"]
    # The plan's motion in frames; between its points configurations are splined.
    end = float(plan.time.values[-1])
    time = np.linspace(0.0, end, max(2, round(end * FRAMES_PER_S) + 1))
    # Two rows at the boundary of two phases have the same time; one of them is used.
    first = np.append(True, np.diff(plan.time.values) > 0)
    rows = plan.time.values[first]
    q, tips = (CubicSpline(rows, plan[name].values[first], axis=0)(time) for name in ("q", "tip_position"))
    motion = place(scene, SceneGeometry.of(scene), q, time)
    target = None
    if run["target"] is not None and scene.target is not None:
        bases = [(node.body, node.is_base) for node in motion.nodes]
        target = packed(motion.position[:, bases.index((scene.target.name, True))])
    # planned curves of the quantities that are simulated and planned
    plotted_quantities = {"joint angle": ("joint_position", 180 / np.pi), "joint torque": ("torque", 1.0)}
    labels, curves = [str(joint) for joint in plan.joint.values], []
    for quantity in run["quantities"]:
        name, scale = plotted_quantities.get(quantity["title"], (None, 1.0))
        if name is not None:
            signals = [
                signal | {"values": packed(plan[name].sel(joint=signal["name"]).values * scale)}
                for signal in quantity["signals"]
                if signal["name"] in labels
            ]
            curves.append(quantity | {"signals": signals})
    ghost = run | {
        "label": "plan",
        "pale": True,
        "completed": True,
        "time": packed(motion.time),
        "poses": poses(motion),
        "tips": packed(tips),
        "target": target,
        "fine_time": packed(plan.time.values),
        "errors": [],
        "quantities": curves,
    }
    marked = _marks(scene, LONG * float(data["scale"]))
    nodes = [
        node | {"solids": [*node["solids"], *marked.get(scene_node.joint, ())]}
        for node, scene_node in zip(run["nodes"], scene_nodes(simulation.scene()), strict=True)
    ]
    return data | {"runs": [run | {"nodes": nodes}, ghost], "over": True}


def _marks(scene: Scene, length: float) -> dict[int, list[dict[str, Any]]]:
    """Keep-out zones, and approach cones of a length [m], by the joint that carries them."""
    plan = scene.scenario.plan
    marks: dict[int, list[dict[str, Any]]] = {}
    if plan is None:
        return marks
    # pads that stay apart, each once
    pairs = [
        pair
        for part in plan.by_phase.values()
        for section, name, limit in part.every_limit()
        if (apart := limit.separated) is not None
        for pair in find_pairs(scene, apart.between, apart.wrap, f"plan.{section}.{name}")
    ]
    for shape in {shape.label: shape for pair in pairs for shape in pair if shape.path is not None}.values():
        marks.setdefault(shape.joint, []).extend(map(solid_data, pad_solids(scene, shape, pairs)))
    # cones that open from their mating frames against the direction of approach
    cones = {
        (section, name): limit.approach_cone
        for part in plan.by_phase.values()
        for section, name, limit in part.every_limit()
    }
    for cone in filter(None, cones.values()):
        frame = scene.model.frames[scene.model.getFrameId(f"target/{cone.frame}", pin.FrameType.BODY)]
        back = -np.array(cone.axis) / np.linalg.norm(cone.axis)
        turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), back).toRotationMatrix()
        placement = frame.placement * pin.SE3(turn, back * length / 2)
        wide = cone.radius + length * np.tan(np.radians(cone.half_angle_deg))
        geometry = {"kind": "cone", "size": rounded([cone.radius, wide, length]), "rgba": list(CONE)}
        geometry["matrix"] = rounded(placement.homogeneous.T)
        marks.setdefault(int(frame.parentJoint), []).append(geometry)
    return marks
