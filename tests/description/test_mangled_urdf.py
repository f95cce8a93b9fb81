"""A mangled URDF gives a description that Pinocchio can build, or one line that says what is wrong."""

from __future__ import annotations

import copy
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from lxml import etree

from spacerobot.common.errors import DescriptionError
from spacerobot.description import Description, read_description
from spacerobot.description.bodies import check_bodies, welded_bodies

GOOD = b"""<?xml version="1.0"?>
<robot name="r">
  <material name="red"><color rgba="1 0 0 1"/></material>
  <link name="base">
    <inertial><origin xyz="0 0 0.1" rpy="0 0 1"/><mass value="5"/>
      <inertia ixx="1" iyy="1.2" izz="1.3" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><origin xyz="0 0 1"/><geometry><box size="1 2 3"/></geometry><material name="red"/></visual>
    <collision><geometry><cylinder radius="0.1" length="1"/></geometry></collision>
  </link>
  <link name="arm">
    <inertial><mass value="2"/><inertia ixx="0.1" iyy="0.2" izz="0.25"/></inertial>
    <visual><geometry><mesh filename="package://r/arm.stl" scale="1 1 1"/></geometry></visual>
  </link>
  <link name="hand">
    <inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1"/></inertial>
    <visual><geometry><sphere radius="0.1"/></geometry></visual>
  </link>
  <link name="tip"/>
  <joint name="slide" type="prismatic">
    <origin xyz="1 0 0" rpy="0 1.5707963 0"/><parent link="base"/><child link="arm"/><axis xyz="0 0 2"/>
    <limit lower="-1" upper="1" effort="10" velocity="1"/><dynamics damping="0.1" friction="0"/>
  </joint>
  <joint name="turn" type="continuous">
    <parent link="arm"/><child link="hand"/><axis xyz="0 1 0"/>
  </joint>
  <joint name="mount" type="fixed"><parent link="hand"/><child link="tip"/></joint>
  <transmission name="t"/>
</robot>
"""
ODD_VALUES = ["nan", "inf", "-inf", "1e400", "-1", "0", "1e-320", "1e12", "1e16"]
ODD_VALUES += ["1,5", "0x10", "1_0", "\uff11", "${pi}"]
ODD_WORDS = [
    "",
    " ",
    "1 2",
    "0 0 0",
    "1 2 3 4 5",
    "text",
    "base",
    "arm",
    "fixed",
    "planar",
    "package://",
    "../..",
]
odd = st.sampled_from(ODD_VALUES + ODD_WORDS)
edit = st.tuples(st.integers(0, len(GOOD) - 1), st.integers(0, 2), st.binary(max_size=3))


def settings_of(examples: int) -> settings:
    return settings(
        deadline=None,
        max_examples=examples,
        derandomize=True,
        suppress_health_check=[HealthCheck.function_scoped_fixture],
    )


def judged(path: Path) -> Description:
    """Description that can be simulated on a floating base, no joint locked."""
    description = read_description(path).settled({}, ())
    bodies = welded_bodies(description.links, description.joints, description.root)
    check_bodies(bodies, path, floating=True)
    return description


def read_or_refuse(path: Path) -> Description | str:
    """The description or the refusal's one line; any other error goes through."""
    try:
        return judged(path)
    except DescriptionError as error:
        return str(error)


def check(path: Path, data: bytes) -> None:
    """The property itself: refused in one line, or fit for Pinocchio."""
    path.write_bytes(data)
    description = read_or_refuse(path)
    if isinstance(description, str):
        assert description.startswith(str(path))
        assert "\n" not in description
        assert "yourdfpy" not in description, "to be found by our own checks, which name the element"
        return
    xml = description.to_pinocchio_xml("x/")
    model = pin.buildModelFromXML(xml, pin.JointModelFreeFlyer())
    moving = {f"x/{joint.name}" for joint in description.joints if joint.kind != "fixed"}
    assert set(model.names) == {"universe", "root_joint"} | moving
    assert all(model.existFrame(f"x/{link.name}", pin.FrameType.BODY) for link in description.links)
    shapes = pin.buildGeomFromUrdfString(model, xml, pin.GeometryType.VISUAL)
    assert shapes.ngeoms == sum(len(link.visuals) for link in description.links)
    mass_matrix = pin.crba(model, model.createData(), pin.neutral(model))
    assert np.all(np.isfinite(mass_matrix))
    assert np.all(np.diag(mass_matrix) >= 0)  # what nothing resists is found with the scene


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "mangled.urdf"


def test_the_unmangled_text_is_good(path: Path) -> None:
    path.write_bytes(GOOD)
    assert len(read_description(path).warnings) == 2  # the mesh, and the joint without <dynamics>
    check(path, GOOD)


@settings_of(60)
@given(cut=st.integers(0, len(GOOD) - 1), more=st.binary(max_size=5))
def test_truncated(path: Path, cut: int, more: bytes) -> None:
    check(path, GOOD[:cut] + more)


@settings_of(200)
@given(edits=st.lists(edit, min_size=1, max_size=4))
def test_bytes_replaced_dropped_or_inserted(path: Path, edits: list[tuple[int, int, bytes]]) -> None:
    data = bytearray(GOOD)
    for position, dropped, inserted in edits:
        data[position : position + dropped] = inserted
    check(path, bytes(data))


@settings_of(300)
@given(data=st.data())
def test_elements_and_attributes_mangled(path: Path, data: st.DataObject) -> None:
    root = etree.fromstring(GOOD)
    for _ in range(data.draw(st.integers(1, 3))):
        element = data.draw(st.sampled_from(list(root.iter())))
        action = data.draw(st.sampled_from(["drop", "repeat", "move", "value", "forget", "rename"]))
        parent = element.getparent()
        if action == "value" and element.attrib:
            element.set(data.draw(st.sampled_from(sorted(element.attrib))), data.draw(odd))
        elif action == "forget" and element.attrib:
            del element.attrib[data.draw(st.sampled_from(sorted(element.attrib)))]
        elif action == "rename":
            element.tag = data.draw(st.sampled_from(["link", "joint", "origin", "mimic", "bogus", "robot"]))
        elif parent is not None and action == "drop":
            parent.remove(element)
        elif parent is not None and action == "repeat":
            parent.append(copy.deepcopy(element))
        elif parent is not None and action == "move":
            inner = set(element.iter())
            target = data.draw(st.sampled_from([other for other in root.iter() if other not in inner]))
            target.append(element)
    check(path, etree.tostring(root))


@settings_of(300)
@given(data=st.data())
def test_one_number_of_each_kind_is_odd(path: Path, data: st.DataObject) -> None:
    """Single numbers inside an otherwise good file: the mangling most likely to be accepted."""
    root = etree.fromstring(GOOD)
    fields = [
        (element, name)
        for element in root.iter()
        for name in element.attrib
        if name not in ("name", "link", "type", "filename")
    ]
    element, name = data.draw(st.sampled_from(fields))
    words = element.get(name).split()
    words[data.draw(st.integers(0, len(words) - 1))] = data.draw(st.sampled_from(ODD_VALUES))
    element.set(name, " ".join(words))
    check(path, etree.tostring(root))
