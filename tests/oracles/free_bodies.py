"""Two free bodies, one with a tip and one with a mating frame: a robot without joints, and a target."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from spacerobot.scene import Scene, load_scene

BODY = """<robot name="{name}">
<link name="body"><inertial><origin xyz="{com}"/><mass value="{mass}"/>
  <inertia ixx="{i[0]}" iyy="{i[1]}" izz="{i[2]}" ixy="{i[3]}" ixz="0" iyz="{i[4]}"/></inertial></link>
<link name="{frame}"/>
<joint name="{frame}_mount" type="fixed"><parent link="body"/><child link="{frame}"/>
  <origin xyz="{at}" rpy="{rpy}"/></joint>
</robot>"""

FLAT = {
    "base": {"joint": "planar", "velocity": [0.05, 0.01, 0], "spin_deg": [0, 0, 3]},
    "target": {"joint": "planar", "velocity": [-0.01, 0.02, 0], "spin_deg": [0, 0, -5]},
}
DEEP = {
    "base": {"joint": "free_flyer", "velocity": [0.05, 0.01, -0.004], "spin_deg": [2, -1, 3]},
    "target": {"joint": "free_flyer", "velocity": [-0.01, 0.02, 0.01], "spin_deg": [-3, 4, -5]},
}

ENVELOPE = {
    "distance": 0.09,
    "misalignment_deg": 8,
    "closing_speed": 0.2,
    "lateral_speed": 0.15,
    "spin_deg": 20,
}
"""Limits of all kinds, within which the tip captures the mating frame."""


def free_bodies(folder: Path, bases: Mapping[str, Any], grasp: Mapping[str, Any], **sections: Any) -> Scene:
    """Scene of the two, tip and mating frame 0.1 m apart along x, with one grasp called ``left``."""
    flat = bases is FLAT
    high, tilt = ("0", 0.0) if flat else ("0.03", 0.05)  # nothing that a plane would have to hold
    chaser = {"com": f"0.02 -0.01 {high}", "i": (0.9, 1.1, 1.4, 0.1, tilt)}
    object_ = {"com": f"-0.03 0.02 {high}", "i": (0.3, 0.35, 0.4, 0.02, tilt)}
    frames = {
        "chaser": BODY.format(name="chaser", frame="tip", mass=30, at="0.4 0.05 0", rpy="0 0 0", **chaser),
        "thing": BODY.format(name="thing", frame="mate", mass=8, at="-0.2 0.03 0", rpy="0 0 0", **object_),
    }
    for name, text in frames.items():
        (folder / f"{name}.urdf").write_text(text)
    document = {
        "robots": {"one": {"urdf": "chaser.urdf", "base": bases["base"], "tips": {"tip": {}}}},
        "target": {"urdf": "thing.urdf", "base": {"position": [0.7, 0.02, 0], **bases["target"]}},
        "grasps": {"left": {"tip": "one/tip", "frame": "mate", "begins": "open", **grasp}},
        "simulation": {"duration": 3.0, "step": 0.01},
        **sections,
    }
    path = folder / "bodies.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    return load_scene(path)
