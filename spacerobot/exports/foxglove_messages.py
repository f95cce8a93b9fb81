"""Messages of a result in Foxglove's protobuf schemas.

``/tf`` contains the transforms of all links, ``/scene`` their shapes, ``/events`` the events as log messages,
and ``/signals/NAME`` each variable as a message with a field for each label.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from spacerobot.common.optional import optional_module
from spacerobot.exports.link_motion import LinkMotion, link_motions
from spacerobot.exports.signals import signals, time_variables
from spacerobot.result import Result
from spacerobot.result.events import what_happened

if TYPE_CHECKING:
    import xarray as xr

    from viz.drawing.motion import DrawnSolid

Clock = Callable[[float], int]
"""Function from simulation time [s] to log time [ns since 1970]."""
ALARMING = ("slipped", "failed")
"""Kinds of events with the log level of warnings."""


class FoxgloveChannels:
    """Channels of a log by topic; a channel is registered with its first message."""

    def __init__(self, writer: Any, clock: Clock) -> None:
        self._writer, self.clock, self._ids = writer, clock, dict[str, int]()
        self._register = optional_module("mcap_protobuf.schema", "mcap", "the format mcap").register_schema

    def add(self, topic: str, message: Any, time_s: float, metadata: dict[str, str] | None = None) -> None:
        """Add a message to a topic at a simulation time [s]."""
        if topic not in self._ids:
            schema = self._register(self._writer, type(message))
            self._ids[topic] = self._writer.register_channel(topic, "protobuf", schema, metadata or {})
        stamp = self.clock(time_s)
        self._writer.add_message(self._ids[topic], stamp, message.SerializeToString(), stamp)

    def stamp(self, time_s: float) -> Any:
        """Protobuf time stamp of a simulation time [s]."""
        timestamp = optional_module("google.protobuf.timestamp_pb2", "mcap", "the format mcap").Timestamp()
        timestamp.FromNanoseconds(self.clock(time_s))
        return timestamp


def write_messages(result: Result, writer: Any, clock: Clock) -> None:
    """Write all messages of a result.

    Args:
        result: The result.
        writer: ``mcap.writer.Writer`` that is started.
        clock: Times of the log.

    Raises:
        SpaceRobotError: If a package is missing.
    """
    channels, times = FoxgloveChannels(writer, clock), result.array("time")
    links = link_motions(result.scene(), result.array("q"))
    _write_scene(channels, links, float(times[0]))
    _write_transforms(channels, links, times)
    log = _schema("Log")
    for event in result.summary.get("events", []):
        level = log.WARNING if event["kind"] in ALARMING else log.INFO
        stamp = channels.stamp(event["time_s"])
        line = log(timestamp=stamp, level=level, message=what_happened(event), name=event["who"])
        channels.add("/events", line, event["time_s"])
    for name, variable in time_variables(result.data):
        _write_signal(channels, result.data, name, variable)


def _schema(name: str) -> Any:
    module = optional_module(f"foxglove_schemas_protobuf.{name}_pb2", "mcap", "the format mcap")
    return getattr(module, name)


def _write_transforms(channels: FoxgloveChannels, links: Sequence[LinkMotion], times: Any) -> None:
    transform, transforms = _schema("FrameTransform"), _schema("FrameTransforms")
    vector, quaternion = _schema("Vector3"), _schema("Quaternion")
    for i, time in enumerate(times.tolist()):
        stamp = channels.stamp(time)
        rows = []
        for link in links:
            x, y, z = link.position[i].tolist()
            qx, qy, qz, qw = link.quaternion[i].tolist()
            rows.append(
                transform(
                    timestamp=stamp,
                    parent_frame_id=link.parent,
                    child_frame_id=link.name,
                    translation=vector(x=x, y=y, z=z),
                    rotation=quaternion(x=qx, y=qy, z=qz, w=qw),
                )
            )
        channels.add("/tf", transforms(transforms=rows), time)


def _write_scene(channels: FoxgloveChannels, links: Sequence[LinkMotion], time: float) -> None:
    """Write an entity for each link, which moves with the link's frame."""
    entity, update, stamp = _schema("SceneEntity"), _schema("SceneUpdate"), channels.stamp(time)
    entities = []
    for link in links:
        scene_entity = entity(timestamp=stamp, frame_id=link.name, id=link.name, frame_locked=True)
        for solid in link.solids:
            _add_solid(scene_entity, solid)
        if link.solids:
            entities.append(scene_entity)
    channels.add("/scene", update(entities=entities), time)


def _add_solid(entity: Any, solid: DrawnSolid) -> None:
    """Add a solid to an entity, as a primitive or as triangles."""
    from spacerobot.exports.link_motion import pose_of
    from viz.drawing.meshes import load_mesh, mesh_file

    (x, y, z), (qx, qy, qz, qw) = pose_of(solid.placement)
    pose = _schema("Pose")(
        position=_schema("Vector3")(x=x, y=y, z=z),
        orientation=_schema("Quaternion")(x=qx, y=qy, z=qz, w=qw),
    )
    red, green, blue, alpha = solid.rgba.tolist()
    colour, vector = _schema("Color")(r=red, g=green, b=blue, a=alpha), _schema("Vector3")
    kind, size = solid.geometry.kind, solid.geometry.size.tolist()
    if kind == "box":
        entity.cubes.add(pose=pose, size=vector(x=size[0], y=size[1], z=size[2]), color=colour)
    elif kind == "sphere":
        diameter = 2 * size[0]
        entity.spheres.add(pose=pose, size=vector(x=diameter, y=diameter, z=diameter), color=colour)
    elif kind == "cylinder":
        wide = vector(x=2 * size[0], y=2 * size[0], z=size[1])
        entity.cylinders.add(pose=pose, size=wide, bottom_scale=1.0, top_scale=1.0, color=colour)
    else:
        mesh, point = load_mesh(mesh_file(solid.geometry)), _schema("Point3")
        triangles = entity.triangles.add(pose=pose, color=colour)
        if mesh.colours is None:
            triangles.points.extend(point(x=a, y=b, z=c) for a, b, c in mesh.vertices.tolist())
            triangles.indices.extend(mesh.triangles.ravel().tolist())
        else:  # Foxglove colours vertices, the mesh its triangles: vertices are not shared by triangles
            corners = mesh.vertices[mesh.triangles].reshape(-1, 3).tolist()
            shades = np.repeat(mesh.colours / 255.0, 3, axis=0).tolist()
            triangles.points.extend(point(x=a, y=b, z=c) for a, b, c in corners)
            triangles.colors.extend(_schema("Color")(r=r, g=g, b=b, a=alpha) for r, g, b in shades)


def _write_signal(channels: FoxgloveChannels, data: xr.Dataset, name: str, variable: xr.DataArray) -> None:
    """Write a variable as a topic.

    Each message contains the unit of the variable. If units differ between labels, the channel's metadata
    have the unit of each label.
    """
    labels = [[str(label) for label in data[dim].values] for dim in variable.dims[1:]]
    message = message_type(name, labels)
    columns = list(signals(data[[name]].assign_coords(data.coords)))
    units = {column.unit for column in columns}
    unit = units.pop() if len(units) == 1 else str(variable.attrs.get("units", "1"))
    metadata = {"unit": unit, "description": str(variable.attrs.get("long_name", name))}
    if units:
        metadata |= {f"unit {','.join(column.labels)}": column.unit for column in columns}
    fields = [field_names(dimension) for dimension in labels]
    for time, values in zip(data.time.values.tolist(), variable.values, strict=True):
        filled = message(unit=unit)
        filled.timestamp.FromNanoseconds(channels.clock(time))
        if not labels:
            filled.value = float(values)
        for index in np.ndindex(values.shape) if labels else ():
            place = filled
            for dimension, k in zip(fields[:-1], index[:-1], strict=True):
                place = getattr(place, dimension[k])
            setattr(place, fields[-1][index[-1]], float(values[index]))
        channels.add(f"/signals/{name}", filled, time, metadata)


def field_names(labels: Sequence[str]) -> list[str]:
    """Unique names of protobuf fields for labels, of letters, digits and ``_``."""
    names = list[str]()
    for label in labels:
        name = re.sub(r"\W", "_", label, flags=re.ASCII)
        name = name if re.match(r"[A-Za-z_]", name) else f"_{name}"
        while name in names or name in ("timestamp", "unit"):
            name += "_"
        names.append(name)
    return names


def message_type(name: str, labels: Sequence[Sequence[str]]) -> Any:
    """Message class of a variable with the fields ``timestamp``, ``unit``, and one for each label.

    With several dimensions, messages are nested. A variable without labels has the field ``value``.

    Args:
        name: Name of the variable.
        labels: Labels of each dimension after time.
    """
    descriptors = optional_module("google.protobuf.descriptor_pb2", "mcap", "the format mcap")
    pools = optional_module("google.protobuf.descriptor_pool", "mcap", "the format mcap")
    factory = optional_module("google.protobuf.message_factory", "mcap", "the format mcap")
    timestamps = optional_module("google.protobuf.timestamp_pb2", "mcap", "the format mcap")
    kinds = descriptors.FieldDescriptorProto
    title = "".join(part.capitalize() for part in re.split(r"\W|_", name) if part)
    file = descriptors.FileDescriptorProto(
        name=f"spacerobot/{title}.proto", package="spacerobot", syntax="proto3"
    )
    file.dependency.append(timestamps.DESCRIPTOR.name)
    top = file.message_type.add(name=title)
    one = kinds.LABEL_OPTIONAL
    stamp = ".google.protobuf.Timestamp"
    top.field.add(name="timestamp", number=1, type=kinds.TYPE_MESSAGE, type_name=stamp, label=one)
    top.field.add(name="unit", number=2, type=kinds.TYPE_STRING, label=one)
    message, path, first = top, f".spacerobot.{title}", 3
    for depth, dimension in enumerate(labels or [["value"]]):
        inner = depth + 1 < len(labels)
        path = f"{path}.Level{depth + 1}" if inner else path
        for number, field in enumerate(field_names(dimension), start=first):
            if inner:
                message.field.add(
                    name=field, number=number, type=kinds.TYPE_MESSAGE, type_name=path, label=one
                )
            else:
                message.field.add(name=field, number=number, type=kinds.TYPE_DOUBLE, label=one)
        if inner:
            message, first = message.nested_type.add(name=f"Level{depth + 1}"), 1
    pool = pools.DescriptorPool()
    pool.AddSerializedFile(timestamps.DESCRIPTOR.serialized_pb)
    pool.Add(file)
    return factory.GetMessageClass(pool.FindMessageTypeByName(f"spacerobot.{title}"))
