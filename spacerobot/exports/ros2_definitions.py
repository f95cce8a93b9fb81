"""Definitions of ROS 2 messages, copied from their packages without comments."""

from __future__ import annotations

from collections.abc import Iterator

DEFINITIONS = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "std_msgs/String": "string data",
    "std_msgs/MultiArrayDimension": "string label\nuint32 size\nuint32 stride",
    "std_msgs/MultiArrayLayout": "MultiArrayDimension[] dim\nuint32 data_offset",
    "std_msgs/Float64MultiArray": "MultiArrayLayout layout\nfloat64[] data",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1",
    "geometry_msgs/Transform": "Vector3 translation\nQuaternion rotation",
    "geometry_msgs/TransformStamped": "std_msgs/Header header\nstring child_frame_id\nTransform transform",
    "geometry_msgs/Pose": "Point position\nQuaternion orientation",
    "geometry_msgs/PoseWithCovariance": "Pose pose\nfloat64[36] covariance",
    "geometry_msgs/Twist": "Vector3 linear\nVector3 angular",
    "geometry_msgs/TwistWithCovariance": "Twist twist\nfloat64[36] covariance",
    "geometry_msgs/Wrench": "Vector3 force\nVector3 torque",
    "geometry_msgs/WrenchStamped": "std_msgs/Header header\nWrench wrench",
    "nav_msgs/Odometry": "std_msgs/Header header\nstring child_frame_id\n"
    "geometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist",
    "sensor_msgs/JointState": "std_msgs/Header header\nstring[] name\nfloat64[] position\n"
    "float64[] velocity\nfloat64[] effort",
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "rcl_interfaces/Log": "byte DEBUG=10\nbyte INFO=20\nbyte WARN=30\nbyte ERROR=40\nbyte FATAL=50\n"
    "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\nstring function\n"
    "uint32 line",
}
"""Fields by message type; types of the same package are named without the package."""
SEPARATOR = "=" * 80


def definition_text(name: str) -> str:
    """Definition of a message type and of all types in it, in MCAP's encoding ``ros2msg``.

    Args:
        name: Type without ``msg``, such as ``sensor_msgs/JointState``.
    """
    names = [name]
    for one in names:
        names += [nested for nested in _field_types(one) if nested not in names]
    parts = [DEFINITIONS[name], *(f"MSG: {nested}\n{DEFINITIONS[nested]}" for nested in names[1:])]
    return f"\n{SEPARATOR}\n".join(parts)


def _field_types(name: str) -> Iterator[str]:
    """Iterate over the message types of a message's fields."""
    package = name.partition("/")[0]
    for line in DEFINITIONS[name].splitlines():
        kind = line.split()[0].partition("[")[0]
        if (full := kind if "/" in kind else f"{package}/{kind}") in DEFINITIONS:
            yield full
