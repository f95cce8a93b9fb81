"""Finding descriptions and the meshes they name."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from spacerobot.common.errors import DescriptionError
from spacerobot.description import find, find_urdf, read_description, shipped_urdf_folder
from spacerobot.description.meshes import resolve_mesh, stand_in

TETRAHEDRON = """\
v 0 0 0
v 1 0 0
v 0 1 0
v 0 0 1
f 1 3 2
f 1 2 4
f 1 4 3
f 2 3 4
"""


@pytest.mark.parametrize("name", ["rectangle", "rectangle.urdf"])
def test_shipped_by_name(name: str, tmp_path: Path) -> None:
    assert find_urdf(name) == shipped_urdf_folder() / "rectangle.urdf"
    assert find_urdf(name, tmp_path) == shipped_urdf_folder() / "rectangle.urdf"


def test_a_users_file_comes_before_a_shipped_one(tmp_path: Path) -> None:
    scenario, own = tmp_path / "scenario.yaml", tmp_path / "rectangle.urdf"
    scenario.touch()
    (tmp_path / "elsewhere").mkdir()
    own.touch()
    assert find_urdf("rectangle.urdf", scenario) == own
    assert find_urdf("rectangle.urdf", tmp_path) == own
    assert find_urdf("../rectangle.urdf", tmp_path / "elsewhere") == own
    assert find_urdf(str(own)) == find_urdf(own, Path("/")) == own


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("rectangel", "rectangel: no such URDF file.*did you mean rectangle.urdf"),
        ("rectangel.urdf", "did you mean rectangle.urdf"),
        ("/rectangle.urdf", "^/rectangle.urdf: no such URDF file.*did you mean rectangle.urdf"),
        ("sub/rectangle.urdf", "no such URDF file.*did you mean rectangle.urdf"),
        (
            "data/arm/model.urdf",
            "no such URDF file.*; there is no folder data/arm$",
        ),
        ("arms/my_amr.urdf", "no such URDF file.*; did you mean arms/my_arm.urdf"),
        ("arms/panda.urdf", "no such URDF file.*; (did you mean panda_arm.urdf|check the path)"),
        ("../urdf/rectangle.urdf", "no such URDF file"),
        ("", "allowed: ball.urdf"),
        (".", "allowed: ball.urdf"),
        ("..", "allowed: ball.urdf"),
        ("a\0b", "no such URDF file"),
        ("x" * 5000, "no such URDF file"),
    ],
)
def test_what_is_not_found_lists_near_names(name: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "arms").mkdir()
    (tmp_path / "arms" / "my_arm.urdf").touch()
    for relative_to in (tmp_path,) if "/my_" in name else (None, tmp_path):
        with pytest.raises(DescriptionError, match=message):
            find_urdf(name, relative_to)


def test_shipped_folder_of_an_installed_wheel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A wheel carries the files inside the package, where they come before any folder beside it."""
    package = tmp_path / "spacerobot"
    (package / "description").mkdir(parents=True)
    monkeypatch.setattr(find, "__file__", str(package / "description" / "find.py"))
    with pytest.raises(DescriptionError, match="install spacerobot again"):
        shipped_urdf_folder()
    (tmp_path / "urdf").mkdir()
    assert shipped_urdf_folder() == tmp_path / "urdf"
    (package / "_urdf").mkdir()
    assert shipped_urdf_folder() == package / "_urdf"


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    """``ws/src/arm/{urdf,meshes}`` and ``ws/src/parts``, with a mesh in each."""
    source = tmp_path / "ws" / "src"
    for folder in ("arm/urdf", "arm/meshes", "parts"):
        (source / folder).mkdir(parents=True)
    for mesh in ("arm/meshes/link.obj", "arm/urdf/beside.obj", "parts/bolt.obj", "outside.obj"):
        (source / mesh).write_text(TETRAHEDRON)
    return source


@pytest.mark.parametrize(
    ("filename", "found"),
    [
        ("package://arm/meshes/link.obj", "arm/meshes/link.obj"),
        ("package://parts/bolt.obj", "parts/bolt.obj"),
        ("../meshes/link.obj", "arm/meshes/link.obj"),
        ("beside.obj", "arm/urdf/beside.obj"),
        ("package://arm/meshes/../urdf/beside.obj", "arm/urdf/beside.obj"),
        ("package://arm/none.obj", None),
        ("package://arm/../outside.obj", None),
        ("package://other/link.obj", None),
        ("package://../outside.obj", None),
        ("package:///outside.obj", None),
        ("package://arm", None),
        ("package://arm/meshes", None),
        ("http://example.org/link.obj", None),
        ("model://arm/meshes/link.obj", None),
        ("x" * 5000, None),
    ],
)
def test_meshes_are_found_or_not(workspace: Path, filename: str, found: str | None) -> None:
    mesh = resolve_mesh(filename, workspace / "arm" / "urdf" / "arm.urdf")
    assert mesh == (workspace / found if found else None)


def test_packages_of_the_environment(workspace: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Below an entry of ROS_PACKAGE_PATH, the entry itself, ``share`` of a prefix; near ones go first."""
    far = workspace.parent.parent / "far" / "robot.urdf"
    uri, mesh = "package://parts/bolt.obj", workspace / "parts" / "bolt.obj"
    monkeypatch.delenv("ROS_PACKAGE_PATH", raising=False)
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    assert resolve_mesh(uri, far) is None
    for entry in (workspace.parent, workspace, workspace / "parts"):
        monkeypatch.setenv("ROS_PACKAGE_PATH", f"/none{os.pathsep}{entry}")
        assert resolve_mesh(uri, far) == mesh
        assert resolve_mesh("package://parts/../outside.obj", far) is None
        assert resolve_mesh("package://pa*/bolt.obj", far) is None
        assert find_urdf(uri, far) == mesh  # of any kind of file
    shared = workspace.parent / "install" / "share" / "parts"
    shutil.copytree(workspace / "parts", shared)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(workspace.parent / "install"))
    assert resolve_mesh(uri, far) == mesh
    monkeypatch.delenv("ROS_PACKAGE_PATH")
    assert resolve_mesh(uri, far) == shared / "bolt.obj"
    assert resolve_mesh(uri, workspace / "arm" / "a.urdf") == mesh
    with pytest.raises(DescriptionError, match=r"^package://parts/none\.urdf: no such URDF"):
        find_urdf("package://parts/none.urdf", far)


def test_missing_meshes_are_one_warning_and_unused_collision_meshes_none(tmp_path: Path, urdf) -> None:
    def shape(kind: str, name: str) -> str:
        return f'<{kind}><geometry><mesh filename="package://lost/{name}.stl"/></geometry></{kind}>'

    def description(*kinds: str):
        links = [
            urdf.link(f"l{i}", urdf.INERTIAL + "".join(shape(kind, f"{kind}{i}") for kind in kinds))
            for i in range(5)
        ]
        return read_description(
            urdf.write(*links, *(urdf.joint(f"j{i}", "l0", f"l{i}") for i in range(1, 5)))
        )

    warned = description("visual", "collision")
    assert warned.warnings == (
        "a box replaces mesh 'package://lost/visual0.stl' not found (link l0), "
        "'package://lost/visual1.stl' not found (link l1), 'package://lost/visual2.stl' not found (link l2) "
        "and 2 more; packages are looked for above the URDF, in ROS_PACKAGE_PATH and in AMENT_PREFIX_PATH",
    )
    assert [(len(link.visuals), len(link.collisions)) for link in warned.links] == [(1, 0)] * 5
    drawn = description("collision")  # as nothing else is there to draw
    assert "collision0.stl' not found" in drawn.warnings[0]
    assert all(link.collisions[0].geometry.kind == "box" for link in drawn.links)


def test_meshes_by_absolute_path_and_file_uri(workspace: Path) -> None:
    mesh = workspace / "outside.obj"
    assert resolve_mesh(str(mesh), workspace / "a.urdf") == mesh
    assert resolve_mesh(mesh.as_uri(), workspace / "a.urdf") == mesh
    assert resolve_mesh(f"package://arm/{mesh}", workspace / "arm" / "a.urdf") is None


def mesh_robot(folder: Path, filename: str, inertial: str) -> Path:
    place = '<origin xyz="0 0 1"/>'
    visual = f'<visual>{place}<geometry><mesh filename="{filename}" scale="2 2 2"/></geometry></visual>'
    path = folder / "own.urdf"
    path.write_text(f'<robot name="r"><link name="a">{inertial}{visual}</link></robot>')
    return path


def test_a_mesh_reaches_pinocchio(workspace: Path, urdf) -> None:
    path = mesh_robot(workspace / "arm" / "urdf", "package://arm/meshes/link.obj", urdf.INERTIAL)
    description = read_description(path)
    assert description.warnings == ()
    xml = description.to_pinocchio_xml("s/")
    model = pin.buildModelFromXML(xml, pin.JointModelFreeFlyer())
    shape = pin.buildGeomFromUrdfString(model, xml, pin.GeometryType.VISUAL).geometryObjects[0]
    assert Path(shape.meshPath) == workspace / "arm" / "meshes" / "link.obj"
    np.testing.assert_array_equal(shape.meshScale, (2, 2, 2))
    np.testing.assert_array_equal(shape.placement.translation, (0, 0, 1))


FACET = """solid m
facet normal 0 0 1
outer loop
vertex 0 0 0
vertex 1 0 0
vertex 0 {} 0
endloop
endfacet
endsolid m
"""


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        (None, "not found"),
        ("rubbish", "cannot be read"),
        ("", "cannot be read"),
        *((FACET.format(number), "cannot be read") for number in ("nan", "inf", "1e400")),
    ],
)
def test_a_box_of_the_same_inertia_stands_in(tmp_path: Path, content: str | None, fault: str) -> None:
    """The box that stands in for a missing mesh is the uniform body with the link's own inertia."""
    if content is not None:
        (tmp_path / "m.stl").write_text(content)
    inertial = (
        '<inertial><origin xyz="1 2 3" rpy="0.3 -0.4 0.5"/><mass value="3"/>'
        '<inertia ixx="1" iyy="1.2" izz="1.5" ixy="0.1"/></inertial>'
    )
    description = read_description(mesh_robot(tmp_path, "m.stl", inertial))
    assert description.warnings == (f"a box replaces mesh 'm.stl' {fault} (link a)",)
    link = description.links[0]
    box = link.visuals[0]
    turn = box.placement[:3, :3]
    assert np.linalg.det(turn) == pytest.approx(1)
    uniform = pin.Inertia.FromBox(3, *box.geometry.size).inertia
    np.testing.assert_allclose(turn @ uniform @ turn.T, link.inertia, atol=1e-12)
    np.testing.assert_array_equal(box.placement[:3, 3], (1, 2, 3))
    xml = description.to_pinocchio_xml("s/")
    model = pin.buildModelFromXML(xml)
    assert pin.buildGeomFromUrdfString(model, xml, pin.GeometryType.VISUAL).ngeoms == 1


def test_stand_in_frames_are_right_handed() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        inertia = turn @ np.diag(rng.uniform(1, 1.9, 3)) @ turn.T
        box = stand_in(2.0, np.zeros(3), inertia)
        own = box.placement[:3, :3]
        assert np.linalg.det(own) == pytest.approx(1)
        uniform = pin.Inertia.FromBox(2, *box.geometry.size).inertia
        np.testing.assert_allclose(own @ uniform @ own.T, inertia, atol=1e-12)


def test_users_files_anywhere_on_disk(tmp_path: Path) -> None:
    folder = tmp_path / "my röbots, all" / "a b"
    folder.mkdir(parents=True)
    path = folder / "arm & hand.urdf"
    shutil.copy(find_urdf("servicer"), path)
    assert read_description(find_urdf(path.name, folder)).path == path
