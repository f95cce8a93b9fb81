"""Messages of a result in a ROS 2 bag, which ``ros2 bag play`` replays for RViz.

=============================  =====================================  ========================================
topic                          type                                   content
=============================  =====================================  ========================================
``/robot_description``         ``std_msgs/String``                    URDF of the whole scene, once
``/tf``                        ``tf2_msgs/TFMessage``                 all links, from the frame ``world`` on
``/joint_states``              ``sensor_msgs/JointState``             joints of all arms
``/BODY/odometry``             ``nav_msgs/Odometry``                  floating bases; twist in their own axes
``/grasps/NAME/wrench``        ``geometry_msgs/WrenchStamped``        on the target, axes of ``world``
``/rosout``                    ``rcl_interfaces/Log``                 events
``/signals/NAME``              ``std_msgs/Float64MultiArray``         each variable; labels in the layout
=============================  =====================================  ========================================
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from lxml import etree

from spacerobot.common.optional import optional_module
from spacerobot.exports.link_motion import WORLD, link_motions
from spacerobot.exports.ros2_definitions import definition_text
from spacerobot.exports.signals import time_variables
from spacerobot.result import Result
from spacerobot.result.events import what_happened
from spacerobot.scene import Scene
from spacerobot.scene.model import link_inertia

Message = Mapping[str, Any]
LATCHED = """- history: 1
  depth: 1
  reliability: 1
  durability: 1
  deadline: {sec: 9223372036, nsec: 854775807}
  lifespan: {sec: 9223372036, nsec: 854775807}
  liveliness: 1
  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}
  avoid_ros_namespace_conventions: false
"""
"""Quality of service (keep last, reliable, transient local) by which late subscribers receive the last
message.

Numbers are used instead of names: every version of rosbag2 reads them if the file's metadata record
``rosbag2`` has no version; without that record, newer versions expect names.
"""
INFO, WARN = 20, 30


class Ros2Channels:
    """Channels of a bag by topic; a channel is registered with its first message."""

    def __init__(self, writer: Any, clock: Callable[[float], int]) -> None:
        self._writer, self._clock = writer, clock
        self._encoder = optional_module("mcap_ros2._dynamic", "mcap", "the format mcap").serialize_dynamic
        self._ids, self._schemas = dict[str, int](), dict[str, tuple[int, Any]]()

    def add(
        self,
        topic: str,
        kind: str,
        message: Message,
        time_s: float,
        metadata: Mapping[str, str] | None = None,
    ) -> None:
        """Add a message to a topic at a simulation time [s].

        Args:
            topic: Name of the topic.
            kind: Message type without ``msg``, such as ``sensor_msgs/JointState``.
            message: Fields of the message.
            time_s: Simulation time [s].
            metadata: Metadata of the channel.
        """
        package, name = kind.split("/")
        if kind not in self._schemas:
            full, text = f"{package}/msg/{name}", definition_text(kind)
            encode = self._encoder(full, text)[full]
            self._schemas[kind] = self._writer.register_schema(full, "ros2msg", text.encode()), encode
        schema, encode = self._schemas[kind]
        if topic not in self._ids:
            self._ids[topic] = self._writer.register_channel(topic, "cdr", schema, dict(metadata or {}))
        stamp = self._clock(time_s)
        self._writer.add_message(self._ids[topic], stamp, encode(message), stamp)

    def stamp(self, time_s: float) -> Message:
        """Time stamp of a simulation time [s]."""
        seconds, nanoseconds = divmod(self._clock(time_s), 10**9)
        return {"sec": seconds, "nanosec": nanoseconds}

    def header(self, time_s: float, frame: str) -> Message:
        """Header with a simulation time [s] and a frame."""
        return {"stamp": self.stamp(time_s), "frame_id": frame}


def write_messages(result: Result, writer: Any, clock: Callable[[float], int]) -> None:
    """Write all messages of a result.

    Args:
        result: The result.
        writer: Started ``mcap.writer.Writer``.
        clock: Function from simulation time [s] to time in the bag [ns since 1970].

    Raises:
        SpaceRobotError: If an optional package is missing.
    """
    channels, scene, times = Ros2Channels(writer, clock), result.scene(), result.array("time").tolist()
    writer.add_metadata("rosbag2", {"writer": "spacerobot"})
    metadata = {"offered_qos_profiles": LATCHED}
    text = {"data": scene_urdf(scene)}
    channels.add("/robot_description", "std_msgs/String", text, times[0], metadata)
    for event in result.summary.get("events", []):
        line = {
            "stamp": channels.stamp(event["time_s"]),
            "level": WARN if event["kind"] in ("slipped", "failed") else INFO,
            "name": event["who"],
            "msg": what_happened(event),
            "file": "",
            "function": "",
            "line": 0,
        }
        channels.add("/rosout", "rcl_interfaces/Log", line, event["time_s"])
    _write_motion(channels, result, scene)
    for name, variable in time_variables(result.data):
        unit = str(variable.attrs.get("units", "1"))
        layout, stride = list[Message](), variable[0].size
        for dim, size in zip(variable.dims[1:], variable.shape[1:], strict=True):
            labels = ", ".join(str(label) for label in result.data[dim].values)
            layout.append({"label": f"{dim}: {labels} [{unit}]", "size": size, "stride": stride})
            stride //= max(size, 1)
        metadata = {"unit": unit, "description": str(variable.attrs.get("long_name", name))}
        rows = variable.values.reshape(len(times), -1).astype(float).tolist()
        for time, row in zip(times, rows, strict=True):
            message = {"layout": {"dim": layout, "data_offset": 0}, "data": row}
            channels.add(f"/signals/{name}", "std_msgs/Float64MultiArray", message, time, metadata)


def _write_motion(channels: Ros2Channels, result: Result, scene: Scene) -> None:
    """Write transforms, joint states, odometry and wrenches of all samples."""
    links = link_motions(scene, result.array("q"))
    data, v, names = result.data, result.array("v"), [str(name) for name in result.array("joint")]
    rows = [result.array(key).tolist() for key in ("joint_position", "joint_velocity", "joint_torque")]
    grasps = [str(name) for name in result.array("grasp")] if "grasp_force" in data else []
    forces, torques = (result.array(key) for key in ("grasp_force", "grasp_torque")) if grasps else ((), ())
    roots = {link.name: link for link in links if link.parent == WORLD}
    floating = [
        (body, roots[f"{body.name}/{body.description.root}"]) for body in scene.bodies if body.root_joint
    ]
    for i, time in enumerate(result.array("time").tolist()):
        transforms = [
            {
                "header": channels.header(time, link.parent),
                "child_frame_id": link.name,
                "transform": {"translation": xyz(link.position[i]), "rotation": xyzw(link.quaternion[i])},
            }
            for link in links
        ]
        channels.add("/tf", "tf2_msgs/TFMessage", {"transforms": transforms}, time)
        if names:
            position, velocity, effort = (row[i] for row in rows)
            state = {"name": names, "position": position, "velocity": velocity, "effort": effort}
            state["header"] = channels.header(time, "")
            channels.add("/joint_states", "sensor_msgs/JointState", state, time)
        for body, link in floating:
            joint = scene.model.joints[body.root_joint]
            rate = v[i, joint.idx_v : joint.idx_v + joint.nv]
            # the velocity of a planar base has components along x and y and about z
            twist = rate if joint.nv == 6 else np.array([rate[0], rate[1], 0, 0, 0, rate[2]])
            odometry = {
                "header": channels.header(time, WORLD),
                "child_frame_id": link.name,
                "pose": {
                    "pose": {"position": xyz(link.position[i]), "orientation": xyzw(link.quaternion[i])},
                    "covariance": [0.0] * 36,
                },
                "twist": {
                    "twist": {"linear": xyz(twist[:3]), "angular": xyz(twist[3:])},
                    "covariance": [0.0] * 36,
                },
            }
            channels.add(f"/{body.name}/odometry", "nav_msgs/Odometry", odometry, time)
        for k, name in enumerate(grasps):
            wrench = {"force": xyz(forces[i][k]), "torque": xyz(torques[i][k])}
            message = {"header": channels.header(time, WORLD), "wrench": wrench}
            channels.add(f"/grasps/{name}/wrench", "geometry_msgs/WrenchStamped", message, time)


def xyz(values: Any) -> Message:
    """Message fields of a vector (3,)."""
    return dict(zip("xyz", map(float, values), strict=True))


def xyzw(values: Any) -> Message:
    """Message fields of a quaternion (4,)."""
    return dict(zip("xyzw", map(float, values), strict=True))


def scene_urdf(scene: Scene) -> str:
    """URDF of all bodies of a scene, connected to the link ``world`` by floating or fixed joints.

    Names of links and joints are those of the model, such as ``servicer/left_link_1``. Mass properties are
    those of the scenario. Meshes have ``file://`` addresses, which RViz reads.
    """
    from scipy.spatial.transform import Rotation

    robot = etree.Element("robot", name=scene.scenario.name)
    etree.SubElement(robot, "link", name=WORLD)
    for body in scene.bodies:
        part = etree.fromstring(body.description.to_pinocchio_xml(f"{body.name}/").encode())
        for link in part.iter("link"):
            _set_inertial(link, body.config.links.get(link.get("name").partition("/")[2]))
        robot.extend(part)
        kind = "floating" if body.root_joint else "fixed"
        joint = etree.SubElement(robot, "joint", name=f"{body.name}/{WORLD}", type=kind)
        etree.SubElement(joint, "parent", link=WORLD)
        etree.SubElement(joint, "child", link=f"{body.name}/{body.description.root}")
        if not body.root_joint:
            rpy = Rotation.from_euler("xyz", body.base.rotation_deg, degrees=True).as_euler("xyz")
            origin = {"xyz": _text(body.base.position), "rpy": _text(rpy)}
            etree.SubElement(joint, "origin", origin)
    for shape in [*robot.iter("collision"), *robot.iter("visual")]:
        mesh = shape.find("geometry/mesh")
        if mesh is not None and mesh.get("filename") == "None":  # convex hull of points, without a file
            shape.getparent().remove(shape)
        elif mesh is not None:
            mesh.set("filename", f"file://{mesh.get('filename')}")
    return str(etree.tostring(robot, encoding="unicode", pretty_print=True))


def _set_inertial(link: Any, config: Any) -> None:
    """Replace the mass properties of a link by those of the scenario."""
    for old in link.findall("inertial"):
        link.remove(old)
    if config is None or not config.mass:
        return
    inertia = link_inertia(config)
    element = etree.SubElement(link, "inertial")
    etree.SubElement(element, "origin", xyz=_text(inertia.lever), rpy="0 0 0")
    etree.SubElement(element, "mass", value=repr(float(inertia.mass)))
    terms = {
        f"i{'xyz'[j]}{'xyz'[k]}": repr(float(inertia.inertia[j, k])) for j in range(3) for k in range(j, 3)
    }
    etree.SubElement(element, "inertia", terms)


def _text(values: Any) -> str:
    return " ".join(repr(float(value)) for value in values)
