"""glTF, read by trimesh, and as the specification has its accessors and channels."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import spacerobot as sr

pygltflib = pytest.importorskip("pygltflib")
Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # glTF's y axis to our z axis


@pytest.fixture(scope="module")
def result():
    changes = {"simulation.duration": 1.0, "simulation.output_step": 0.25}
    return sr.simulate(sr.load_scene("servicer", changes), backend="interpreted")


@pytest.fixture(scope="module")
def path(result, tmp_path_factory):
    return sr.export(result, tmp_path_factory.mktemp("gltf") / "a.glb")


def values(gltf, index):
    accessor = gltf.accessors[index]
    view, width = gltf.bufferViews[accessor.bufferView], {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor.type]
    kind = {5126: "<f4", 5125: "<u4"}[accessor.componentType]
    start = view.byteOffset + (accessor.byteOffset or 0)
    array = np.frombuffer(gltf.binary_blob(), kind, accessor.count * width, start)
    return array.reshape(accessor.count, width)


def test_trimesh_reads_the_scene_where_it_begins(result, path):
    trimesh = pytest.importorskip("trimesh")
    from viz.drawing.motion import bounds, initial_motion

    read = trimesh.load_scene(path)
    scene = result.scene()
    # without tracks: bounds of what trimesh reads as triangles
    solids = [geometry for geometry in read.geometry.values() if hasattr(geometry, "faces")]
    assert len(solids) == sum(len(node.solids) for node in initial_motion(scene).nodes)
    ours = bounds(initial_motion(scene))
    found = trimesh.Scene()
    for name in read.graph.nodes_geometry:
        transform, geometry = read.graph[name]
        if hasattr(read.geometry[geometry], "faces"):
            found.add_geometry(read.geometry[geometry], transform=transform)
    corners = np.sort(np.stack(found.bounds) @ Z_UP.T, axis=0)
    np.testing.assert_allclose(corners, np.stack(ours), atol=0.05)


def test_the_animation_moves_every_link_as_it_moved(result, path):
    gltf = pygltflib.GLTF2().load_binary(str(path))
    (animation,) = gltf.animations
    scene = result.scene()
    parents = {child: k for k, node in enumerate(gltf.nodes) for child in node.children}
    index = {node.name: k for k, node in enumerate(gltf.nodes)}
    tracks = {
        (channel.target.node, channel.target.path): animation.samplers[channel.sampler]
        for channel in animation.channels
    }
    times = values(gltf, animation.samplers[0].input).ravel()
    np.testing.assert_allclose(times, result.array("time"), atol=1e-6)
    assert (np.diff(times) > 0).all()

    def pose(node, row):
        here, matrix = gltf.nodes[node], np.eye(4)
        rotation, place = here.rotation or [0, 0, 0, 1], here.translation or [0, 0, 0]
        if (node, "rotation") in tracks:
            rotation = values(gltf, tracks[node, "rotation"].output)[row]
            place = values(gltf, tracks[node, "translation"].output)[row]
        matrix[:3, :3], matrix[:3, 3] = Rotation.from_quat(rotation).as_matrix(), place
        return pose(parents[node], row) @ matrix if node in parents else matrix

    data = scene.model.createData()
    for row in range(len(times)):
        pin.framesForwardKinematics(scene.model, data, result.array("q")[row])
        for frame in scene.model.frames:
            if frame.type == pin.FrameType.BODY:
                expected = data.oMf[scene.model.getFrameId(frame.name, pin.FrameType.BODY)]
                found = pose(index[frame.name], row)
                np.testing.assert_allclose(Z_UP @ found[:3, 3], expected.translation, atol=1e-5)
                np.testing.assert_allclose(Z_UP @ found[:3, :3], expected.rotation, atol=1e-5)


def test_accessors_and_channels_are_valid(path):
    gltf = pygltflib.GLTF2().load_binary(str(path))
    size = len(gltf.binary_blob())
    assert gltf.buffers[0].byteLength <= size
    for k, accessor in enumerate(gltf.accessors):
        view, array = gltf.bufferViews[accessor.bufferView], values(gltf, k)
        assert view.byteOffset % 4 == 0
        assert view.byteOffset + view.byteLength <= size
        assert array.nbytes == view.byteLength
        assert np.isfinite(array).all()
        if accessor.min:
            np.testing.assert_array_equal(array.min(axis=0), np.array(accessor.min, dtype="f4"))
            np.testing.assert_array_equal(array.max(axis=0), np.array(accessor.max, dtype="f4"))
    for mesh in gltf.meshes:
        (primitive,) = mesh.primitives
        assert gltf.accessors[primitive.attributes.POSITION].min, "the specification requires it"
        assert 0 <= primitive.material < len(gltf.materials)
        if primitive.attributes.NORMAL is not None:
            lengths = np.linalg.norm(values(gltf, primitive.attributes.NORMAL), axis=1)
            np.testing.assert_allclose(lengths, 1, atol=1e-5)
    for sampler in gltf.animations[0].samplers:
        assert gltf.accessors[sampler.input].min
        assert gltf.accessors[sampler.input].count == gltf.accessors[sampler.output].count
    for channel in gltf.animations[0].channels:
        if channel.target.path == "rotation":
            quaternion = values(gltf, gltf.animations[0].samplers[channel.sampler].output)
            np.testing.assert_allclose(np.linalg.norm(quaternion, axis=1), 1, atol=1e-6)
            # neighbours lie on one side, so that viewers take the short way
            assert (np.sum(quaternion[1:] * quaternion[:-1], axis=1) > 0).all()


def test_tracks_are_lines_through_the_tips(result, path):
    gltf = pygltflib.GLTF2().load_binary(str(path))
    lines = [mesh for mesh in gltf.meshes if mesh.primitives[0].mode == 3]
    assert [mesh.name for mesh in lines] == [f"track of {tip}" for tip in result.data.tip.values]
    points = values(gltf, lines[0].primitives[0].attributes.POSITION)
    np.testing.assert_allclose(points, result.data.tip_position[:, 0], atol=1e-6)


def test_a_scenario_has_no_animation(tmp_path):
    gltf = pygltflib.GLTF2().load_binary(str(sr.export("paper", tmp_path / "a.glb")))
    assert not gltf.animations
    assert gltf.meshes
