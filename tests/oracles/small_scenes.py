"""Small scenes in which every feature of the schema can be switched on, built from YAML as a user would."""

from __future__ import annotations

import functools
import re
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from spacerobot.description.planar import PlanarBase, PlanarLink, planar_arm_urdf, rectangle_urdf
from spacerobot.scenario import Scenario
from spacerobot.scenario.document import parse_yaml
from spacerobot.scenario.load import validate
from spacerobot.scene import Scene, build_scene

ODD_ARM = """<robot name="odd_arm">
<link name="base"><inertial><origin xyz="0.02 -0.03 0.05"/><mass value="30"/>
  <inertia ixx="3" iyy="4" izz="5" ixy="0.2" ixz="-0.1" iyz="0.3"/></inertial></link>
<link name="a"><inertial><origin xyz="0.1 0.02 0" rpy="0.3 0 0.2"/><mass value="3"/>
  <inertia ixx="0.05" iyy="0.2" izz="0.21" ixy="0.01" ixz="0" iyz="0.02"/></inertial></link>
<link name="b"><inertial><origin xyz="0 0.15 0"/><mass value="2.5"/>
  <inertia ixx="0.15" iyy="0.04" izz="0.16" ixy="0" ixz="0.01" iyz="0"/></inertial></link>
<link name="c"><inertial><origin xyz="0 0 0.1"/><mass value="2"/>
  <inertia ixx="0.09" iyy="0.1" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="d"><inertial><origin xyz="0.05 0 0.05"/><mass value="1.5"/>
  <inertia ixx="0.03" iyy="0.03" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tip"/>
<link name="elbow"/>
<joint name="slant" type="revolute"><parent link="base"/><child link="a"/>
  <origin xyz="0.3 0.1 0.05" rpy="0.2 -0.4 0.7"/><axis xyz="0.6 0 0.8"/>
  <limit lower="-3" upper="3" effort="8" velocity="2"/><dynamics damping="0.3"/></joint>
<joint name="round" type="continuous"><parent link="a"/><child link="b"/>
  <origin xyz="0.3 0 0" rpy="0 0.5 0"/><axis xyz="0 1 0"/>
  <limit effort="6" velocity="2"/><dynamics damping="0.2"/></joint>
<joint name="slide" type="prismatic"><parent link="b"/><child link="c"/>
  <origin xyz="0 0.3 0" rpy="-0.6 0 0.3"/><axis xyz="0 0 -1"/>
  <limit lower="-1" upper="1" effort="40" velocity="1"/><dynamics damping="2"/></joint>
<joint name="wrist" type="revolute"><parent link="c"/><child link="d"/>
  <origin xyz="0 0.05 0.2" rpy="0.1 0 0"/><axis xyz="1 0 0"/>
  <limit lower="-3" upper="3" effort="5" velocity="2"/></joint>
<joint name="tip_mount" type="fixed"><parent link="d"/><child link="tip"/>
  <origin xyz="0.1 0.05 0.15" rpy="0.4 0.2 -0.3"/></joint>
<joint name="elbow_mount" type="fixed"><parent link="b"/><child link="elbow"/>
  <origin xyz="0 0.2 0.05" rpy="0 0 0.3"/></joint>
</robot>"""

FLAPPED_BOX = """<robot name="flapped_box">
<link name="body"><inertial><origin xyz="0.01 0 0.02"/><mass value="12"/>
  <inertia ixx="1.2" iyy="1.5" izz="1.8" ixy="0.1" ixz="0" iyz="0.05"/></inertial></link>
<link name="flap"><inertial><origin xyz="0 0.2 0"/><mass value="1"/>
  <inertia ixx="0.02" iyy="0.01" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="left"/><link name="right"/>
<joint name="hinge" type="revolute"><parent link="body"/><child link="flap"/>
  <origin xyz="0.1 0.2 0"/><axis xyz="1 0 0"/>
  <limit lower="-3" upper="3" effort="1" velocity="1"/><dynamics damping="0.05"/></joint>
<joint name="left_mount" type="fixed"><parent link="body"/><child link="left"/>
  <origin xyz="-0.3 0.05 0.1" rpy="0.2 0.1 0"/></joint>
<joint name="right_mount" type="fixed"><parent link="body"/><child link="right"/>
  <origin xyz="0.3 0 0" rpy="0 0 3"/></joint>
</robot>"""

ARM_SIGNALS = (
    "joint_position",
    "joint_rate",
    "tip_position",
    "tip_velocity",
    "tip_orientation",
    "tip_angular_velocity",
)
"""Signals of the sensors of an arm and its tips."""

PLANAR = """
name: flat
robots:
  one:
    urdf: arm.urdf
    base: {joint: planar, velocity: [0.01, -0.02, 0], spin_deg: [0, 0, 1.5], rotation_deg: [0, 0, 10]}
    joints: {joint_1: {angle_deg: 50, rate_deg: 3}, joint_2: {angle_deg: -70}, joint_3: {angle_deg: 35}}
    tips:
      tip:
        pid: {kp: 30, ki: 20, kd: 6}
        amnesia: {ge: 40, ta: 2}
        reference: {kind: circle, radius: 0.08, duration: 2}
  two:
    urdf: arm.urdf
    base: {joint: planar, rotation_deg: [0, 0, 180], close_grasp: right}
    joints: {joint_1: {angle_deg: -40}, joint_2: {angle_deg: 60}, joint_3: {angle_deg: 20}}
    tips:
      tip:
        pid: {kp: 50, ki: 10, kd: 9}
        reference: {kind: line, displacement: [0.05, -0.1, 0], duration: 1.5}
target:
  urdf: plate.urdf
  base: {joint: planar, close_grasp: left, rotation_deg: [0, 0, 20]}
grasps:
  left: {tip: one/tip, frame: mate_1, kind: compliant, stiffness: 90, damping: 7}
  right: {tip: two/tip, frame: mate_2, kind: compliant, stiffness: 120, damping: 11}
simulation: {duration: 2, step: 0.004, output_step: 0.1}
"""

SPATIAL = """
name: deep
robots:
  one:
    urdf: odd_arm.urdf
    base:
      joint: free_flyer
      rotation_deg: [20, -30, 40]
      velocity: [0.01, 0.02, -0.01]
      spin_deg: [1, -2, 3]
    joints:
      slant: {angle_deg: 20, rate_deg: 2}
      round: {angle_deg: -50}
      slide: {offset: 0.05, speed: -0.02}
      wrist: {angle_deg: 30}
    tips:
      tip:
        pid: {kp: 30, ki: 20, kd: 4}
        amnesia: {ge: 40, ta: 2}
        reference: {kind: circle, radius: 0.08, plane_deg: [30, 20, -10], start_deg: 25, end_deg: -200,
                    duration: 2, rotation_deg: [10, -20, 5]}
  two:
    urdf: odd_arm.urdf
    base: {joint: free_flyer, close_grasp: right, rotation_deg: [0, 0, 170]}
    joints: {slant: {angle_deg: -10}, round: {angle_deg: 30}, wrist: {angle_deg: -20}}
    tips:
      tip:
        pid: {kp: 50, ki: 10, kd: 5}
        reference: {kind: line, displacement: [0.05, -0.1, 0.03], duration: 1.5, rotation_deg: [0, 15, 0]}
target:
  urdf: flapped_box.urdf
  base: {joint: free_flyer, close_grasp: left, rotation_deg: [5, 10, 15], spin_deg: [0, 1, 0]}
  joints: {hinge: {angle_deg: 15, rate_deg: -4}}
grasps:
  left: {tip: one/tip, frame: left, kind: compliant, stiffness: 90, damping: 7}
  right: {tip: two/tip, frame: right, kind: compliant, stiffness: 120, damping: 11}
simulation: {duration: 2, step: 0.004, output_step: 0.1}
"""

ONE_SPATIAL_ARM = re.sub(r"  two:.*?(?=target:)|  right:.*?\n", "", SPATIAL, flags=re.DOTALL)
"""One arm and its target; in the plane there are two arms."""


@functools.cache
def folder() -> Path:
    """Folder with the small robots' URDFs, removed with the process."""
    place = Path(_keep().name)
    arm = planar_arm_urdf(
        links=3,
        link=PlanarLink(length_m=0.4, mass_kg=4.0, inertia_kg_m2=(0.06, 0.05)),
        base=PlanarBase(mass_kg=40.0, inertia_kg_m2=6.0, radius_m=0.3),
        damping=0.4,
    )
    parts = {
        "arm": arm,
        "plate": rectangle_urdf(mass_kg=8.0, inertia_kg_m2=0.7),
        "odd_arm": ODD_ARM,
        "flapped_box": FLAPPED_BOX,
        "rotors": _with_rotors(arm, "base", "0 0 1"),
        "odd_rotors": _with_rotors(ODD_ARM, "base", "0 0 1", "0.6 0 -0.8", "0 1 0"),
    }
    for name, text in parts.items():
        (place / f"{name}.urdf").write_text(text, encoding="utf-8")
    return place


def _with_rotors(urdf: str, root: str, *axes: str) -> str:
    """A URDF with rotors about these axes on its root link."""
    parts = "".join(
        f'<link name="disc{i}"><inertial><mass value="0.5"/>'
        '<inertia ixx="0.03" iyy="0.03" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        f'<joint name="rotor{i}" type="continuous"><parent link="{root}"/><child link="disc{i}"/>'
        f'<origin xyz="0.1 0.05 0"/><axis xyz="{axis}"/><dynamics damping="0.02"/></joint>'
        for i, axis in enumerate(axes)
    )
    return urdf.replace("</robot>", f"{parts}</robot>")


@functools.cache
def _keep() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="small_scenes_")


def small_scene(text: str, changes: Mapping[str, Any] | Sequence[tuple[str, Any]] | None = None) -> Scene:
    """Scene of a YAML text whose URDFs lie in :func:`folder`, with values changed by dotted path."""
    return build_scene(_scenario(text), changes or {}, source=folder() / "scenario.yaml")


@functools.cache
def _scenario(text: str) -> Scenario:
    source = folder() / "scenario.yaml"
    return validate(parse_yaml(text, source=source), source=source)


def random_x(scene: Scene, rng: np.random.Generator, size: int, spread: float = 0.3) -> np.ndarray:
    """A state on the manifold near the initial one, all its other entries random."""
    q = pin.integrate(scene.model, np.array(scene.q), spread * rng.normal(size=scene.model.nv))
    return np.concatenate([q, spread * rng.normal(size=size - scene.model.nq)])
