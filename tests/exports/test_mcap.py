"""MCAP files, read back by the readers of other projects."""

import itertools
import sys

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import spacerobot as sr
from spacerobot.common.errors import SpaceRobotError
from spacerobot.exports.ros2_definitions import DEFINITIONS, definition_text

for package in ("mcap", "mcap_protobuf", "mcap_ros2", "foxglove_schemas_protobuf"):
    pytest.importorskip(package)

START = "2026-01-02T03:04:05Z"
START_NS = 1767323045 * 10**9


@pytest.fixture(scope="module")
def result():
    """Two planar arms."""
    changes = {"simulation.duration": 1.5, "simulation.output_step": 0.25}
    return sr.simulate(sr.load_scene("docking", changes), backend="interpreted")


@pytest.fixture(scope="module")
def spatial():
    """An arm with meshes, free in space."""
    changes = {"simulation.duration": 0.5, "simulation.output_step": 0.25}
    return sr.simulate(sr.load_scene("servicer", changes), backend="interpreted")


def decoded(path):
    """Messages of a file with Foxglove's schemas: (log time, decoded) by topic, and channels by topic."""
    reader = pytest.importorskip("mcap.reader")
    factory = pytest.importorskip("mcap_protobuf.decoder").DecoderFactory()
    with path.open("rb") as file:
        opened = reader.make_reader(file, validate_crcs=True, decoder_factories=[factory])
        messages = {}
        for _, channel, message, content in opened.iter_decoded_messages():
            messages.setdefault(channel.topic, []).append((message.log_time, content))
        channels = {channel.topic: channel for channel in opened.get_summary().channels.values()}
        attachments = {one.name: one.data.decode() for one in opened.iter_attachments()}
    return messages, channels, attachments


def world_poses(transforms):
    """Homogeneous matrices of all frames, composed from the transforms of one time."""
    poses = {"world": np.eye(4)}
    for child, parent, place, quaternion in transforms:
        step = np.eye(4)
        step[:3, :3], step[:3, 3] = Rotation.from_quat(quaternion).as_matrix(), place
        poses[child] = poses[parent] @ step
    return poses


def check_poses(result, row, poses):
    """Frames of links are where Pinocchio's kinematics have them."""
    scene = result.scene()
    data = scene.model.createData()
    pin.framesForwardKinematics(scene.model, data, result.array("q")[row])
    links = [frame for frame in scene.model.frames if frame.type == pin.FrameType.BODY]
    for frame in links:
        expected = data.oMf[scene.model.getFrameId(frame.name, pin.FrameType.BODY)].homogeneous
        np.testing.assert_allclose(poses[frame.name], expected, atol=1e-12)
    assert len(poses) == 1 + len(links)


@pytest.mark.parametrize("name", ["result", "spatial"])
def test_foxgloves_messages(name, request, tmp_path):
    result = request.getfixturevalue(name)
    messages, channels, attachments = decoded(sr.export(result, tmp_path / "a.mcap", start=START))
    times = result.array("time")
    assert [stamp for stamp, _ in messages["/tf"]] == [START_NS + round(time * 1e9) for time in times]
    for row, (_, content) in enumerate(messages["/tf"]):
        rows = [
            (
                one.child_frame_id,
                one.parent_frame_id,
                [one.translation.x, one.translation.y, one.translation.z],
                [one.rotation.x, one.rotation.y, one.rotation.z, one.rotation.w],
            )
            for one in content.transforms
        ]
        check_poses(result, row, world_poses(rows))
    errors = [
        [[getattr(tip, axis) for axis in "xyz"] for tip in tips(one)]
        for _, one in messages["/signals/tip_error"]
    ]
    np.testing.assert_array_equal(errors, result.data.tip_error)
    assert all(one.unit == "m" for _, one in messages["/signals/tip_error"])
    assert channels["/signals/energy_kinetic"].metadata["unit"] == "J"
    energies = [one.value for _, one in messages["/signals/energy_kinetic"]]
    np.testing.assert_array_equal(energies, result.data.energy_kinetic)
    assert {f"/signals/{name}" for name in result.data.data_vars} <= set(messages)
    assert attachments["scenario.yaml"].startswith("name:")
    ((_, update),) = messages["/scene"]
    frames = {frame for frame, *_ in rows}
    assert {entity.frame_id for entity in update.entities} <= frames
    assert (
        sum(len(e.cubes) + len(e.cylinders) + len(e.spheres) + len(e.triangles) for e in update.entities) > 0
    )


def tips(message):
    """Nested messages of the labels, in their order."""
    return [
        getattr(message, field.name)
        for field in message.DESCRIPTOR.fields
        if field.message_type and field.name != "timestamp"
    ]


def test_events_are_lines_of_a_log(tmp_path):
    result = sr.simulate(sr.load_scene("bounce", {"simulation.duration": 2.5}), backend="interpreted")
    messages, _, _ = decoded(sr.export(result, tmp_path / "a.mcap"))
    events = result.summary["events"]
    assert events, "the scene has to have some"
    assert [line.name for _, line in messages["/events"]] == [event["who"] for event in events]
    assert [stamp for stamp, _ in messages["/events"]] == [round(event["time_s"] * 1e9) for event in events]


def test_meshes_are_triangles_of_the_entity(tmp_path):
    pytest.importorskip("mcap")
    from spacerobot.description.parts import Geometry
    from spacerobot.exports.foxglove_messages import _add_solid, _schema
    from viz.drawing.motion import DrawnSolid

    corners = np.array(list(itertools.product((0.0, 1.0), repeat=3)))
    hull = Geometry("mesh", np.ones(3), None, corners)
    entity = _schema("SceneEntity")()
    _add_solid(entity, DrawnSolid(np.eye(4), hull, np.array([0.1, 0.2, 0.3, 1.0])))
    (triangles,) = entity.triangles
    points = np.array([[point.x, point.y, point.z] for point in triangles.points])
    a, b, c = (points[np.array(triangles.indices).reshape(-1, 3)[:, k]] for k in range(3))
    # divergence theorem: the volume of the closed surface
    assert np.sum(np.einsum("ij,ij->i", a, np.cross(b, c))) / 6 == pytest.approx(1.0)


@pytest.fixture(scope="module")
def bag(spatial, tmp_path_factory):
    """Messages of a bag by topic, deserialised by rosbags with the definitions of ROS 2 Jazzy."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    path = sr.export(spatial, tmp_path_factory.mktemp("bag") / "a.mcap", ros2=True, start=START)
    messages = {}
    with rosbag2.Reader(path) as reader:
        for connection, stamp, raw in reader.messages():
            content = store.deserialize_cdr(raw, connection.msgtype)
            messages.setdefault(connection.topic, []).append((stamp, content))
    return path, messages


def test_ros2_transforms_and_robot_description(spatial, bag):
    _, messages = bag
    for row, (_, content) in enumerate(messages["/tf"]):
        rows = []
        for one in content.transforms:
            place, turn = one.transform.translation, one.transform.rotation
            pose = [place.x, place.y, place.z], [turn.x, turn.y, turn.z, turn.w]
            rows.append((one.child_frame_id, one.header.frame_id, *pose))
        check_poses(spatial, row, world_poses(rows))
    ((_, description),) = messages["/robot_description"]
    model, ours = pin.buildModelFromXML(description.data), spatial.scene().model
    links = {frame.name for frame in model.frames if frame.type == pin.FrameType.BODY}
    assert {frame for frame, *_ in rows} <= links
    assert pin.computeTotalMass(model) == pytest.approx(pin.computeTotalMass(ours), rel=1e-15)
    by_name = {str(name): inertia for name, inertia in zip(model.names, model.inertias, strict=True)}
    for name, inertia in zip(list(ours.names)[1:], list(ours.inertias)[1:], strict=True):
        if str(name) in by_name:
            assert inertia.isApprox(by_name[str(name)], 1e-12)


def test_ros2_states(spatial, bag):
    _, messages = bag
    data = spatial.data
    states = [message for _, message in messages["/joint_states"]]
    assert list(states[0].name) == [str(name) for name in data.joint.values]
    np.testing.assert_array_equal([state.position for state in states], data.joint_position)
    np.testing.assert_array_equal([state.effort for state in states], data.joint_torque)
    odometry = [message for _, message in messages["/servicer/odometry"]]
    np.testing.assert_allclose(
        [[getattr(one.pose.pose.position, axis) for axis in "xyz"] for one in odometry],
        data.body_position.sel(body="servicer"),
        atol=1e-12,
    )
    spin = [[getattr(one.twist.twist.angular, axis) for axis in "xyz"] for one in odometry]
    np.testing.assert_array_equal(spin, spatial.array("v")[:, 3:6])
    wrench = [message.wrench.force for _, message in messages[f"/grasps/{data.grasp.values[0]}/wrench"]]
    np.testing.assert_array_equal([[one.x, one.y, one.z] for one in wrench], data.grasp_force[:, 0])
    (_, last) = messages["/signals/tip_error"][-1]
    np.testing.assert_array_equal(last.data, data.tip_error[-1].values.ravel())
    assert [dim.size for dim in last.layout.dim] == list(data.tip_error.shape[1:])
    assert "[m]" in last.layout.dim[0].label


def test_ros2_is_read_by_mcaps_own_reader(spatial, bag):
    reader = pytest.importorskip("mcap_ros2.reader")
    path, messages = bag
    count = sum(1 for _ in reader.read_ros2_messages(str(path)))
    assert count == sum(len(content) for content in messages.values())
    (first,) = reader.read_ros2_messages(str(path), topics=["/robot_description"])
    assert "durability: 1" in first.channel.metadata["offered_qos_profiles"]
    assert first.log_time_ns == START_NS


@pytest.mark.parametrize("name", DEFINITIONS)
def test_definitions_are_those_of_ros2(name):
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    package, title = name.split("/")
    full = f"{package}/msg/{title}"
    found = typesys.get_types_from_msg(definition_text(name), full)
    assert found[full][1] == store.fielddefs[full][1]
    assert set(found) <= set(store.fielddefs)


def test_a_missing_package_is_named_with_its_extra(result, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    with pytest.raises(SpaceRobotError, match=r"the format mcap needs .*pip install 'spacerobot\[mcap\]'"):
        sr.export(result, tmp_path / "a.mcap")
    assert list(tmp_path.iterdir()) == []
