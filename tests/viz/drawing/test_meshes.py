"""Meshes are drawn; one that has gone is drawn as a box, and said to be."""

import base64
import re
import shutil

import numpy as np
import pytest
from PIL import Image

from spacerobot.description import Geometry, shipped_urdf_folder
from spacerobot.description.meshes import read_mesh
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from viz.drawing.geometry import surface
from viz.drawing.meshes import MOST_TRIANGLES, MeshFile, TriangleMesh, load_mesh, shown_meshes, simplified
from viz.drawing.motion import finish_of
from viz.drawing.raster import Faces, cover, draw_faces
from viz.figures import docking, to_bytes
from viz.page.animation import animation
from viz.page.page import animation_page
from viz.recording.record import frames

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture
def meshed(tmp_path):
    """The paper's scenario for 20 ms with an object that is drawn as a mesh."""
    (tmp_path / "shape.obj").write_text(TETRAHEDRON)
    text = (shipped_urdf_folder() / "rectangle.urdf").read_text()
    box = text[text.index("<geometry>") : text.index("</geometry>")]
    mesh = '<geometry><mesh filename="shape.obj" scale="0.2 0.2 0.2"/>'
    (tmp_path / "object.urdf").write_text(text.replace(box, mesh, 1))
    shutil.copy(shipped_urdf_folder() / "planar_arm.urdf", tmp_path)
    changes = {"target.urdf": str(tmp_path / "object.urdf"), "simulation.duration": 0.02}
    return simulate(load_scene("paper", changes), backend="interpreted")


def test_a_mesh_is_drawn_and_a_missing_one_is_a_box_with_a_warning(browser, meshed, tmp_path):
    kinds = {solid["kind"] for node in animation(meshed)["runs"][0]["nodes"] for solid in node["solids"]}
    assert "mesh" in kinds
    path = tmp_path / "page.html"
    path.write_text(animation_page(meshed), encoding="utf-8")
    browser.open(path.as_uri())
    browser.wait_for("document.body?.dataset.ready === 'true'")
    assert browser.errors == []
    (tmp_path / "shape.obj").unlink()
    data = animation(meshed)
    assert not [s for node in data["runs"][0]["nodes"] for s in node["solids"] if s["kind"] == "mesh"]
    assert any("shape.obj" in notice for notice in data["notices"])


def test_vertices_are_scaled(tmp_path):
    path = tmp_path / "shape.obj"
    path.write_text(TETRAHEDRON)
    vertices, triangles, _ = load_mesh(MeshFile(path, (2.0, 1.0, 1.0)))
    np.testing.assert_allclose(vertices.max(axis=0), [2, 1, 1])
    assert triangles.shape == (4, 3)


def ball(rings, radius=0.1):
    """A ball of 4 rings^2 triangles."""
    angle = np.linspace(0, 2 * np.pi, 2 * rings, endpoint=False)
    polar = np.linspace(0, np.pi, rings + 1)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    flat = np.sin(polar)[:, None, None] * circle
    vertices = np.concatenate([flat, np.broadcast_to(np.cos(polar)[:, None, None], (*flat.shape[:2], 1))], -1)
    below = (len(angle) * np.arange(rings)[:, None] + np.arange(len(angle))).ravel()
    beside = below - below % len(angle) + (below + 1) % len(angle)
    up = len(angle)
    quads = [np.stack([below, below + up, beside + up], 1), np.stack([below, beside + up, beside], 1)]
    return TriangleMesh(radius * vertices.reshape(-1, 3), np.concatenate(quads))


def write_obj(path, surface):
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in surface.vertices]
    lines += [f"f {a} {b} {c}" for a, b, c in surface.triangles + 1]
    path.write_text("\n".join(lines) + "\n")
    return MeshFile(path, (1.0, 1.0, 1.0))


@pytest.fixture(scope="module")
def dense(tmp_path_factory):
    """The paper's scenario for 20 ms whose object is drawn as balls of 67 600 triangles."""
    folder = tmp_path_factory.mktemp("dense")
    write_obj(folder / "ball.obj", ball(130))
    text = (shipped_urdf_folder() / "rectangle.urdf").read_text()
    first, *others = re.split("<visual>.*?</visual>", text, flags=re.DOTALL)
    shape = '<visual><geometry><mesh filename="ball.obj"/></geometry></visual>'
    (folder / "object.urdf").write_text(first + 2 * shape + "".join(others))
    changes = {"target.urdf": str(folder / "object.urdf"), "simulation.duration": 0.02}
    return simulate(load_scene("paper", changes), backend="interpreted")


def test_a_dense_mesh_stands_in_a_page_once_and_with_no_more_than_can_be_seen(dense):
    data = animation(dense, dense)
    solids = [s for run in data["runs"] for node in run["nodes"] for s in node["solids"]]
    assert [s["mesh"] for s in solids if s["kind"] == "mesh"] == [0] * 4
    (mesh,) = data["meshes"]
    triangles = np.frombuffer(base64.b64decode(mesh["triangles"]), dtype="<u4")
    assert MOST_TRIANGLES / 3 < len(triangles) / 3 <= MOST_TRIANGLES
    page = animation_page(dense, dense)
    assert page.count(mesh["vertices"]) == 1
    assert len(page) < 5e6


def test_pictures_of_meshes_are_pixels_and_stay_small(dense, paper):
    drawn = docking(dense, frames=2)
    assert all(axes.images for axes in drawn.axes)
    assert len(to_bytes(drawn, "svg")) < 2e6
    assert not any(axes.images for axes in docking(paper, frames=2).axes)
    picture = np.asarray(frames(dense, rate_hz=20, size_px=(320, 200)).picture(0))
    assert picture.shape == (200, 320, 3)
    assert (picture < 160).all(axis=-1).mean() > 0.01


def test_a_simplified_mesh_is_near_what_it_was_and_keeps_edges(tmp_path):
    fine = ball(120)
    coarse = simplified(fine, 0.01)
    assert len(coarse.triangles) < len(fine.triangles) / 10
    np.testing.assert_allclose(np.linalg.norm(coarse.vertices, axis=1), 0.1, atol=1e-3)
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, 41)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    place = np.arange(40 * 41).reshape(40, 41)[:, :40].ravel()
    quads = np.concatenate(
        [np.stack([place, place + 41, place + 42], 1), np.stack([place, place + 42, place + 1], 1)]
    )
    roof = TriangleMesh(np.column_stack([grid, -np.abs(grid[:, 0] - 0.5)]), quads)
    flat = simplified(roof, 0.09)
    np.testing.assert_allclose(flat.vertices[:, 2], -np.abs(flat.vertices[:, 0] - 0.5), atol=5e-3)
    assert flat.vertices[:, 2].max() > -5e-3


def test_meshes_share_what_can_be_shown_and_small_ones_stay_recognisable(tmp_path):
    large, small = (
        write_obj(tmp_path / "large.obj", ball(180, 50.0)),
        write_obj(tmp_path / "small.obj", ball(60)),
    )
    shown = shown_meshes([large, small, large])
    assert list(shown) == [large, small]
    assert sum(len(surface.triangles) for surface in shown.values()) <= MOST_TRIANGLES
    np.testing.assert_allclose(np.linalg.norm(shown[small].vertices, axis=1), 0.1, atol=5e-3)
    assert len(shown[small].triangles) > 300
    few = write_obj(tmp_path / "few.obj", ball(10))
    assert shown_meshes([few])[few] == load_mesh(few)


@pytest.mark.parametrize(
    ("geometry", "area"),
    [
        (Geometry("box", np.array([1.0, 2.0, 3.0])), 22.0),
        (Geometry("cylinder", np.array([0.5, 2.0])), 2.5 * np.pi),
        (Geometry("sphere", np.array([0.5])), np.pi),
    ],
)
def test_triangles_of_primitives_close_and_look_outwards(geometry, area):
    corners = surface(geometry).vertices[surface(geometry).triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    assert np.linalg.norm(normals, axis=1).sum() == pytest.approx(area, rel=0.02)
    np.testing.assert_allclose(normals.sum(axis=0), 0, atol=1e-12)
    assert (np.sum(normals * corners.mean(axis=1), axis=1) >= 0).all()


def test_the_nearest_face_is_seen_and_clear_ones_let_others_through():
    triangle, nearer = np.array([[0.0, 0, 0], [40, 0, 0], [0, 40, 0]]), np.array([0, 0, 1.0])
    corners = np.stack([triangle + nearer, triangle, triangle + 2 * nearer])
    red, blue, veil = [1.0, 0, 0, 1], [0.0, 0, 1, 1], [0.0, 1, 0, 0.5]
    picture = draw_faces(Faces(corners[:2], np.array([red, blue]), np.arange(2)), 20, 20)
    np.testing.assert_allclose(picture[9, 9], red)
    picture = draw_faces(Faces(corners, np.array([red, blue, veil]), np.arange(3)), 20, 20)
    np.testing.assert_allclose(picture[9, 9], [0.5, 0.5, 0, 1])


def test_covered_area_is_that_of_the_triangles_whichever_way_round():
    rng = np.random.default_rng(3)
    for corners in rng.uniform(-20, 80, (40, 1, 3, 3)):
        inside = cover(corners, 100, 100, fine=1)[5:60, 5:60].sum()
        assert inside == cover(corners[:, ::-1], 100, 100, fine=1)[5:60, 5:60].sum()
    corners = np.array([[[10.0, 10, 0], [70, 20, 0], [30, 80, 0]], [[5.0, 5, 0], [5, 90, 0], [5, 40, 0]]])
    assert cover(corners, 100, 100, fine=4).sum() == pytest.approx(2000, rel=2e-3)


def test_a_mesh_is_read_once_and_again_where_its_file_has_changed(tmp_path):
    file = tmp_path / "shape.obj"
    file.write_text(TETRAHEDRON)
    first = read_mesh(file, (1.0, 1.0, 1.0))
    assert read_mesh(file, (1.0, 1.0, 1.0)) is first
    assert read_mesh(file, (2.0, 1.0, 1.0)) is not first
    file.write_text(TETRAHEDRON + "v 0 0 2\nf 1 3 5\n")
    assert read_mesh(file, (1.0, 1.0, 1.0)).num_tris == first.num_tris + 1


def coloured(folder, materials):
    """A tetrahedron of two materials, its first two faces and its last two."""
    (folder / "shape.mtl").write_text(materials)
    vertices = [line for line in TETRAHEDRON.splitlines() if line.startswith("v")]
    faces = [line.split()[1:] for line in TETRAHEDRON.splitlines() if line.startswith("f")]
    placed = [" ".join(f"{corner}/{1 + (k > 1)}" for corner in face) for k, face in enumerate(faces)]
    one, two = ([f"f {face}" for face in some] for some in (placed[:2], placed[2:]))
    parts = ["usemtl one", *one, "usemtl two", *two]
    places = ["vt 0.25 0.5", "vt 0.75 0.5"]
    (folder / "shape.obj").write_text("\n".join(["mtllib shape.mtl", *vertices, *places, *parts, ""]))
    return load_mesh(MeshFile(folder / "shape.obj", (2.0, 1.0, 1.0)))


def test_triangles_have_the_colours_of_their_materials(tmp_path):
    mesh = coloured(tmp_path, "newmtl one\nKd 1 0 0\nnewmtl two\nKd 0 0 1\n")
    # the faces at the origin but one are red: those whose middles are in the planes z = 0 and y = 0
    middles = mesh.vertices[mesh.triangles].mean(axis=1)
    red = np.isclose(middles[:, 2], 0) | np.isclose(middles[:, 1], 0)
    assert red.sum() == 2
    np.testing.assert_array_equal(mesh.colours, np.where(red[:, None], [255, 0, 0], [0, 0, 255]))
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), [2, 1, 1])


def test_triangles_have_the_colours_of_their_texture(tmp_path):
    Image.fromarray(np.array([[[0, 200, 0], [90, 0, 90]]], dtype=np.uint8)).save(tmp_path / "paint.png")
    mesh = coloured(tmp_path, "newmtl one\nmap_Kd paint.png\nnewmtl two\nmap_Kd paint.png\n")
    found, counts = np.unique(mesh.colours, axis=0, return_counts=True)
    np.testing.assert_allclose(found, [[0, 200, 0], [90, 0, 90]], atol=2)
    assert (counts == 2).all()


def test_a_mesh_without_materials_has_no_colours(tmp_path):
    (tmp_path / "shape.obj").write_text(TETRAHEDRON)
    assert load_mesh(MeshFile(tmp_path / "shape.obj", (1.0, 1.0, 1.0))).colours is None


@pytest.mark.parametrize(
    ("material", "finish"),
    [("gold", "foil"), ("MLI", "foil"), ("solar_left", "solar"), ("silver", "metal"), ("white", "paint")],
)
def test_a_material_is_finished_as_its_name_says(material, finish):
    assert finish_of(material) == finish
