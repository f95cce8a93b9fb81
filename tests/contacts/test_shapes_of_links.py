"""Collision shapes of URDFs in contacts: which are taken, refused and wrapped."""

from __future__ import annotations

import coal
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from spacerobot.common.errors import ScenarioError
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
def test_a_wrapped_mesh_is_inside_its_shape(tmp_path, wrap):
    box_mesh(tmp_path / "box.stl", [-1, -2, 0], [1, 4, 1])
    shape = shape_of(with_shape(tmp_path, '<mesh filename="box.stl" scale="0.1 0.1 0.1"/>', wrap=wrap))
    middle, edges = [0, 0.1, 0.05 + 0.1], [0.2, 0.6, 0.1]
    np.testing.assert_allclose(shape.placement[:3, 3], middle)
    if wrap == "box":
        assert shape.config.kind == "box"
        np.testing.assert_allclose(shape.config.size, edges)
    elif wrap == "sphere":
        assert shape.config.kind == "sphere"
        assert shape.config.radius == pytest.approx(np.linalg.norm(edges) / 2)
    else:
        np.testing.assert_allclose(np.abs(shape.placement[:3, 2]), [0, 1, 0])  # along the longest edge
        np.testing.assert_allclose(np.linalg.det(shape.placement[:3, :3]), 1)
        radius, half = shape.config.radius, shape.config.length / 2
        assert radius**2 - 0.1**2 - 0.05**2 == pytest.approx((0.3 - half) ** 2)  # through the corners
        assert 0.1 < radius < 0.2


@pytest.mark.parametrize("wrap", ["box", "capsule", "sphere"])
def test_no_point_of_a_mesh_is_nearer_than_what_wraps_it(tmp_path, wrap):
    """Tapered and off its axes, from 200 places: coal's distance of the mesh against that of the wrap."""
    draw = np.random.default_rng(5)
    points = draw.uniform(-1, 1, (40, 3)) * [0.1, 0.3, 0.06] + [0.02, 0.1, 0]
    points[:, [0, 2]] *= 0.3 + points[:, [1]]
    hull = ConvexHull(points)
    lines = ("".join("vertex {} {} {}\n".format(*points[i]) for i in face) for face in hull.simplices)
    (tmp_path / "box.stl").write_text(STL.format("".join(FACET.format(text) for text in lines)))
    shape = shape_of(with_shape(tmp_path, '<mesh filename="box.stl"/>', wrap=wrap))
    mesh, ball = coal.MeshLoader().load(str(tmp_path / "box.stl"), np.ones(3)), coal.Sphere(0.01)
    lifted = coal.Transform3s(np.eye(3), np.array([0, 0, 0.1]))  # the collision's own origin
    own = coal.Transform3s(shape.placement[:3, :3], shape.placement[:3, 3])
    nearer = []
    for place in draw.normal(0, 1, (200, 3)):
        at = coal.Transform3s(np.eye(3), 0.6 * place / np.linalg.norm(place) + [0, 0.1, 0.1])
        gaps = [
            coal.distance(one, of, ball, at, coal.DistanceRequest(), coal.DistanceResult())
            for one, of in ((mesh, lifted), (shape.config.coal(), own))
        ]
        nearer.append(gaps[0] - gaps[1])
    assert min(nearer) > -1e-6
    assert min(nearer) < 2e-2  # and tight somewhere


def test_primitives_are_taken_as_they_are_and_cylinders_wrapped_on_request(tmp_path):
    cylinder = '<cylinder radius="0.2" length="1.0"/>'
    bare = shape_of(with_shape(tmp_path, cylinder)).config
    assert (bare.kind, bare.radius, bare.length) == ("cylinder", 0.2, 1.0)
    wrapped = shape_of(with_shape(tmp_path, cylinder, wrap="capsule"))
    assert wrapped.config.kind == "capsule"
    radius, half = wrapped.config.radius, wrapped.config.length / 2
    assert radius**2 - 0.2**2 == pytest.approx((0.5 - half) ** 2, abs=1e-12)  # through the rims
    box = shape_of(with_shape(tmp_path, '<box size="1 2 3"/>', wrap="sphere"))  # needs no wrapping
    assert (box.config.kind, box.config.size) == ("box", (1.0, 2.0, 3.0))
    np.testing.assert_allclose(box.placement[:3, 3], [0, 0, 0.1])


def test_a_link_without_a_collision_shape_is_told(tmp_path):
    bare = '<sphere radius="0.1"/>'
    found = with_shape(tmp_path, bare)
    text = (tmp_path / "shaped.urdf").read_text().replace("collision", "visual")
    (tmp_path / "shaped.urdf").write_text(text)
    with pytest.raises(ScenarioError, match="no collision shape; name a pad"):
        scene(found.scenario.model_dump(mode="json"))
