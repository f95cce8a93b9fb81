"""Animation of a result or a scene in glTF."""

from __future__ import annotations

from typing import Any

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.optional import optional_module
from spacerobot.exports.link_motion import WORLD, link_motions, pose_of
from spacerobot.result import Result
from spacerobot.scene import Scene

FLOAT, UNSIGNED_INT = 5126, 5125
ARRAY, ELEMENTS = 34962, 34963
TRIANGLES, LINE_STRIP = 4, 3
METALLIC = {"foil": (1.0, 0.35), "metal": (1.0, 0.3), "solar": (0.6, 0.25), "paint": (0.0, 0.7)}
"""Metallic factor and roughness of each finish."""
TRACK = np.array([0.1, 0.4, 0.9, 1.0])
"""Colour of the paths of tips."""


def animation_file(source: Result | Scene) -> bytes:
    """Content of a binary file with a tree of nodes, one for each link, and one animation.

    The root node ``world`` rotates the z axis to glTF's vertical y axis. Positions [m] and times [s] have
    single precision. A scene has no animation.

    Raises:
        SpaceRobotError: If pygltflib is not installed.
    """
    is_result = isinstance(source, Result)
    scene = source.scene() if isinstance(source, Result) else source
    time = source.array("time") if isinstance(source, Result) else np.zeros(1)
    # keyframe times must increase in single precision: of the two samples at an event, the first is kept
    _, rows = np.unique(time.astype(np.float32), return_index=True)
    q = source.array("q")[rows] if isinstance(source, Result) else scene.q[None]
    builder = GltfBuilder()
    nodes = {WORLD: builder.node(WORLD, rotation=[-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])}
    keys = builder.accessor(time[rows], "SCALAR", bounds=True) if is_result else None
    for link in link_motions(scene, q):
        pose = {"translation": link.position[0].tolist(), "rotation": link.quaternion[0].tolist()}
        nodes[link.name] = builder.node(link.name, parent=nodes[link.parent], **pose)
        for k, solid in enumerate(link.solids):
            builder.solid(f"{link.name}.{k}", nodes[link.name], solid)
        if keys is not None and not link.is_fixed:
            builder.channel(nodes[link.name], keys, "translation", link.position)
            builder.channel(nodes[link.name], keys, "rotation", link.quaternion)
    if isinstance(source, Result):
        for k, tip in enumerate(source.array("tip")):
            builder.track(f"track of {tip}", nodes[WORLD], source.array("tip_position")[rows, k])
    return builder.to_bytes(scene.scenario.name)


class GltfBuilder:
    """Builder of a glTF file with nodes, meshes, an animation and one binary buffer.

    Raises:
        SpaceRobotError: If pygltflib is not installed.
    """

    def __init__(self) -> None:
        self._library = optional_module("pygltflib", "gltf", "the format gltf")
        self._gltf = self._library.GLTF2()
        self._animation = self._library.Animation(name="motion", samplers=[], channels=[])
        self._bytes = bytearray()
        self._materials: dict[tuple[Any, ...], int] = {}

    def accessor(self, values: Any, kind: str, *, target: int | None = None, bounds: bool = False) -> int:
        """Add numbers to the buffer and return the index of their accessor.

        Args:
            values: Numbers (n, ...), stored in single precision, or 32-bit indices.
            kind: glTF type, such as ``VEC3``.
            target: glTF target of the buffer view.
            bounds: Whether to store minimum and maximum.
        """
        library, array = self._library, np.asarray(values)
        array = np.ascontiguousarray(array, dtype="<u4" if array.dtype.kind in "iu" else "<f4")
        view = library.BufferView(
            buffer=0, byteOffset=len(self._bytes), byteLength=array.nbytes, target=target
        )
        self._bytes += array.tobytes()
        self._gltf.bufferViews.append(view)
        rows = array.reshape(len(array), -1)
        limits = {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()} if bounds else {}
        component = UNSIGNED_INT if array.dtype.kind == "u" else FLOAT
        self._gltf.accessors.append(
            library.Accessor(
                bufferView=len(self._gltf.bufferViews) - 1,
                componentType=component,
                count=len(array),
                type=kind,
                **limits,
            )
        )
        return len(self._gltf.accessors) - 1

    def node(self, name: str, *, parent: int | None = None, **pose: Any) -> int:
        """Add a node with a pose relative to its parent and return its index."""
        self._gltf.nodes.append(self._library.Node(name=name, children=[], **pose))
        index = len(self._gltf.nodes) - 1
        if parent is not None:
            self._gltf.nodes[parent].children.append(index)
        return index

    def solid(self, name: str, parent: int, solid: Any) -> None:
        """Add a shape with its material to a node."""
        from viz.drawing.geometry import surface
        from viz.drawing.meshes import mesh_file, shown_meshes

        if solid.geometry.kind == "mesh":
            file = mesh_file(solid.geometry)
            mesh = shown_meshes([file])[file]
        else:
            mesh = surface(solid.geometry)
        # flat shading: triangles share no vertices, and each vertex has the normal of its triangle
        corners = mesh.vertices[mesh.triangles].reshape(-1, 3)
        edges = corners.reshape(-1, 3, 3)
        normals = np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0])
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        flat = np.repeat(
            np.where(lengths > 0, normals / np.where(lengths > 0, lengths, 1), [0, 0, 1]), 3, axis=0
        )
        attributes = {
            "POSITION": self.accessor(corners, "VEC3", target=ARRAY, bounds=True),
            "NORMAL": self.accessor(flat, "VEC3", target=ARRAY),
        }
        rgba = solid.rgba
        if mesh.colours is not None:
            shades = np.repeat((mesh.colours / 255.0) ** 2.2, 3, axis=0)
            attributes["COLOR_0"] = self.accessor(shades, "VEC3", target=ARRAY)
            rgba = np.array([1.0, 1.0, 1.0, rgba[3]])
        place, turn = pose_of(solid.placement)
        index = self._mesh(name, attributes, TRIANGLES, self._material(rgba, solid.finish))
        self.node(name, parent=parent, translation=place, rotation=turn, mesh=index)

    def track(self, name: str, parent: int, points: Array) -> None:
        """Add a polyline through points (n, 3) [m] to a node."""
        if len(points) > 1:
            attributes = {"POSITION": self.accessor(points, "VEC3", target=ARRAY, bounds=True)}
            index = self._mesh(name, attributes, LINE_STRIP, self._material(TRACK, "paint"))
            self.node(name, parent=parent, mesh=index)

    def channel(self, node: int, keys: int, path: str, values: Array) -> None:
        """Animate the translation (n, 3) or rotation (n, 4) of a node at the times of an accessor."""
        output = self.accessor(values, "VEC3" if path == "translation" else "VEC4")
        sampler = self._library.AnimationSampler(input=keys, output=output, interpolation="LINEAR")
        self._animation.samplers.append(sampler)
        target = self._library.AnimationChannelTarget(node=node, path=path)
        channel = self._library.AnimationChannel(sampler=len(self._animation.samplers) - 1, target=target)
        self._animation.channels.append(channel)

    def to_bytes(self, title: str) -> bytes:
        """Content of the binary glTF file."""
        library, gltf = self._library, self._gltf
        gltf.asset = library.Asset(version="2.0", generator="spacerobot")
        gltf.scenes, gltf.scene = [library.Scene(name=title, nodes=[0])], 0
        if self._animation.channels:
            gltf.animations.append(self._animation)
        gltf.buffers = [library.Buffer(byteLength=len(self._bytes))]
        gltf.set_binary_blob(bytes(self._bytes))
        return b"".join(gltf.save_to_bytes())

    def _mesh(self, name: str, attributes: dict[str, int], mode: int, material: int) -> int:
        library = self._library
        filled = library.Attributes(**attributes)
        primitive = library.Primitive(attributes=filled, mode=mode, material=material)
        self._gltf.meshes.append(library.Mesh(name=name, primitives=[primitive]))
        return len(self._gltf.meshes) - 1

    def _material(self, rgba: Array, finish: str) -> int:
        """Index of the material of an sRGB colour and a finish; glTF's colour factors are linear."""
        key = (*rgba.tolist(), finish)
        if key not in self._materials:
            metalness, roughness = METALLIC[finish]
            colour = [*(rgba[:3] ** 2.2).tolist(), float(rgba[3])]
            look = self._library.PbrMetallicRoughness(
                baseColorFactor=colour, metallicFactor=metalness, roughnessFactor=roughness
            )
            mode = "BLEND" if rgba[3] < 1 else "OPAQUE"
            material = self._library.Material(
                name=finish, pbrMetallicRoughness=look, alphaMode=mode, alphaCutoff=None
            )
            self._gltf.materials.append(material)
            self._materials[key] = len(self._gltf.materials) - 1
        return self._materials[key]
