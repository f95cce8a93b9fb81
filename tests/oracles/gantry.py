"""A tip on two perpendicular slides, joined to a body that floats: motion along a line in closed form."""

from __future__ import annotations

import functools
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.linalg import expm

from spacerobot.common.arrays import Array
from spacerobot.scenario.load import validate
from spacerobot.scene import Scene, build_scene

TARGET_MASS, TOOL_MASS, SPEED = 6.0, 0.7, 0.2
SPRING, DAMPER = 90.0, 3.0
"""Mass of the target and of the tool [kg], speed of the target [m/s], spring and damper of the grasp."""
CONTROLLERS = "robots.arm.tips.tip.controllers"
_GANTRY = f"""<robot name="gantry">
<link name="base"><inertial><mass value="10"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="bridge"><inertial><mass value="1.5"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="carriage"><inertial><mass value="3.3"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tool"><inertial><mass value="{TOOL_MASS}"/>
  <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tip"/>
<joint name="along" type="prismatic"><parent link="base"/><child link="bridge"/><axis xyz="1 0 0"/>
  <limit lower="-9" upper="9" effort="1000" velocity="100"/></joint>
<joint name="across" type="prismatic"><parent link="bridge"/><child link="carriage"/><axis xyz="0 1 0"/>
  <limit lower="-9" upper="9" effort="1000" velocity="100"/><dynamics damping="0.4"/></joint>
<joint name="flange" type="fixed"><parent link="carriage"/><child link="tool"/></joint>
<joint name="mount" type="fixed"><parent link="tool"/><child link="tip"/></joint>
</robot>"""
_TARGET = f"""<robot name="target"><link name="body"><inertial><mass value="{TARGET_MASS}"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""


@functools.cache
def _folder() -> tempfile.TemporaryDirectory[str]:
    folder = tempfile.TemporaryDirectory(prefix="gantry_")
    (Path(folder.name) / "gantry.urdf").write_text(_GANTRY, encoding="utf-8")
    (Path(folder.name) / "target.urdf").write_text(_TARGET, encoding="utf-8")
    return folder


def gantry_scene(
    controller: dict[str, Any], changes: dict[str, Any] | None = None, grasp: str = "compliant"
) -> Scene:
    """Scene of a gantry at rest whose tip a spring joins to a body that moves along x.

    Args:
        controller: Section of the tip's controller.
        changes: Changes by dotted path.
        grasp: Kind of the grasp; others than ``compliant`` have no spring.
    """
    spring = {"stiffness": SPRING, "damping": DAMPER} if grasp == "compliant" else {}
    document = {
        "name": "gantry",
        "robots": {
            "arm": {
                "urdf": "gantry.urdf",
                "base": {"joint": "planar"},
                "joints": {"along": {"offset": 0.4}, "across": {"offset": 0.3}},
                "tips": {"tip": {"reference": {"kind": "hold"}, "controllers": {"soft": controller}}},
            }
        },
        "target": {
            "urdf": "target.urdf",
            "base": {"joint": "planar", "close_grasp": "hold", "velocity": [SPEED, 0, 0]},
        },
        "grasps": {"hold": {"tip": "arm/tip", "frame": "body", "kind": grasp} | spring},
        "simulation": {"duration": 2, "output_step": 0.05, "step": 0.002},
    }
    source = Path(_folder().name) / "scenario.yaml"
    source.write_text(yaml.safe_dump(document), encoding="utf-8")
    return build_scene(validate(document, source=source), changes or {}, source=source)


def masses_in_line(inertia: float, damping: float, stiffness: float, times: Array) -> Array:
    """Displacements of the tip and the target, and the force on the tip, (n, 3).

    Of ``M x'' + D x' + K x = f`` and ``m y'' = -f`` with the grasp's ``f = k (y - x) + d (y' - x')``.
    """
    spring, damper = np.array([1, 0, -1, 0]) * SPRING, np.array([0, 1, 0, -1]) * DAMPER
    pull = -(spring + damper)
    own = np.array([stiffness, damping, 0, 0])
    rate = np.array([[0, 1, 0, 0], (pull - own) / inertia, [0, 0, 0, 1], -pull / TARGET_MASS])
    states = np.array([expm(rate * t) @ [0, 0, 0, SPEED] for t in times])
    return np.column_stack([states[:, 0], states[:, 2], states @ pull])
