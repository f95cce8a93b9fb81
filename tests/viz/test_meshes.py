"""Meshes are drawn; one that has gone is drawn as a box, and said to be."""

import shutil

import numpy as np
import pytest

from spacerobot.description import shipped_urdf_folder
from spacerobot.scene import load_scene
from spacerobot.simulate import simulate
from viz.animation import animation
from viz.geometry import load_mesh
from viz.page import animation_page

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture
def meshed(tmp_path):
    """The paper's scenario for 0.1 s with an object that is drawn as a mesh."""
    (tmp_path / "shape.obj").write_text(TETRAHEDRON)
    text = (shipped_urdf_folder() / "rectangle.urdf").read_text()
    box = text[text.index("<geometry>") : text.index("</geometry>")]
    mesh = '<geometry><mesh filename="shape.obj" scale="0.2 0.2 0.2"/>'
    (tmp_path / "object.urdf").write_text(text.replace(box, mesh, 1))
    shutil.copy(shipped_urdf_folder() / "planar_arm.urdf", tmp_path)
    changes = {"target.urdf": str(tmp_path / "object.urdf"), "simulation.duration": 0.1}
    return simulate(load_scene("paper", changes))


def test_a_mesh_is_drawn_and_a_missing_one_is_a_box_with_a_warning(browser, meshed, tmp_path):
    kinds = {solid["kind"] for node in animation(meshed)["runs"][0]["nodes"] for solid in node["solids"]}
    assert "mesh" in kinds
    path = tmp_path / "page.html"
    path.write_text(animation_page(meshed), encoding="utf-8")
    browser.open(path.as_uri())
    browser.wait_for("document.body?.dataset.ready === 'true'")
    assert browser.complaints == []
    (tmp_path / "shape.obj").unlink()
    data = animation(meshed)
    assert not [s for node in data["runs"][0]["nodes"] for s in node["solids"] if s["kind"] == "mesh"]
    assert any("shape.obj" in notice for notice in data["notices"])


def test_vertices_are_scaled(tmp_path):
    path = tmp_path / "shape.obj"
    path.write_text(TETRAHEDRON)
    vertices, triangles = load_mesh(path, (2.0, 1.0, 1.0))
    np.testing.assert_allclose(vertices.max(axis=0), [2, 1, 1])
    assert triangles.shape == (4, 3)
