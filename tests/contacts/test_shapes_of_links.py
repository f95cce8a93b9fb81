"""Collision shapes of URDFs in contacts: which are taken, refused and wrapped."""

from __future__ import annotations

import numpy as np
import pytest

from spacerobot.errors import ScenarioError
from tests.oracles.balls import body, scene

STL = "solid box\n{}endsolid box\n"
FACET = "facet normal 0 0 0\nouter loop\n{}endloop\nendfacet\n"
LINK = """<robot name="{name}"><link name="body">
<inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0 0 0.1"/><geometry>{geometry}</geometry></collision></link></robot>"""


def box_mesh(path, low, high):
    """An STL file of a box between two corners."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    corners = np.array(low) + corners * (np.array(high) - low)
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    lines = ("".join("vertex {} {} {}\n".format(*corners[i]) for i in triangle) for triangle in triangles)
    path.write_text(STL.format("".join(FACET.format(text) for text in lines)))


def with_shape(folder, geometry, **contact):
    """A ball, and a body with a collision shape far from it."""
    file = folder / "shaped.urdf"
    file.write_text(LINK.format(name="shaped", geometry=geometry))
    return scene(
        {
            "robots": {"one": body("one", 2.0, {"position": [5, 0, 0]})},
            "target": {"urdf": str(file), "base": {"joint": "free_flyer"}},
            "contacts": {"bump": {"between": ["one/*", "target/bo*"], "stiffness": 1e4} | contact},
        }
    )


def shape_of(found):
    ((_, shape),) = found.contacts[0].pairs
    return shape


def test_a_mesh_is_refused_by_name(tmp_path):
    box_mesh(tmp_path / "box.stl", [-1, -2, 0], [1, 4, 1])
    with pytest.raises(ScenarioError, match=r"target/body collides by a mesh, .* `wrap: box`"):
        with_shape(tmp_path, '<mesh filename="box.stl"/>')


@pytest.mark.parametrize("wrap", ["box", "capsule", "sphere"])
def test_a_wrapped_mesh_has_its_extents(tmp_path, wrap):
    box_mesh(tmp_path / "box.stl", [-1, -2, 0], [1, 4, 1])
    shape = shape_of(with_shape(tmp_path, '<mesh filename="box.stl" scale="0.1 0.1 0.1"/>', wrap=wrap))
    middle, edges = [0, 0.1, 0.05 + 0.1], [0.2, 0.6, 0.1]
    np.testing.assert_allclose(shape.placement[:3, 3], middle)
    if wrap == "box":
        assert (shape.kind, shape.measures[0]) == ("box", 0.0)
        np.testing.assert_allclose(shape.measures[1], np.array(edges) / 2)
    elif wrap == "sphere":
        assert shape.kind == "sphere"
        assert shape.measures[0] == pytest.approx(0.3)
    else:
        np.testing.assert_allclose(np.abs(shape.placement[:3, 2]), [0, 1, 0])  # along the longest edge
        np.testing.assert_allclose(np.linalg.det(shape.placement[:3, :3]), 1)
        np.testing.assert_allclose([shape.measures[0], *shape.measures[1]], [0.1, 0.2])


def test_primitives_are_taken_as_they_are_and_cylinders_wrapped_on_request(tmp_path):
    cylinder = '<cylinder radius="0.2" length="1.0"/>'
    assert shape_of(with_shape(tmp_path, cylinder)).measures == (0.2, (0.5,))
    wrapped = shape_of(with_shape(tmp_path, cylinder, wrap="capsule"))
    assert wrapped.kind == "capsule"
    np.testing.assert_allclose([wrapped.measures[0], *wrapped.measures[1]], [0.2, 0.3])
    box = shape_of(with_shape(tmp_path, '<box size="1 2 3"/>', wrap="sphere"))  # needs no wrapping
    assert (box.kind, box.measures) == ("box", (0.0, (0.5, 1.0, 1.5)))
    np.testing.assert_allclose(box.placement[:3, 3], [0, 0, 0.1])


def test_a_link_without_a_collision_shape_is_told(tmp_path):
    bare = '<sphere radius="0.1"/>'
    found = with_shape(tmp_path, bare)
    text = (tmp_path / "shaped.urdf").read_text().replace("collision", "visual")
    (tmp_path / "shaped.urdf").write_text(text)
    with pytest.raises(ScenarioError, match="no collision shape; name a pad"):
        scene(found.scenario.model_dump(mode="json"))
