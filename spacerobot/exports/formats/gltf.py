"""glTF: animation for Blender and web viewers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from spacerobot.common.registry import registered
from spacerobot.exports.export_format import ExportFormat, NoOptions, Source

if TYPE_CHECKING:
    from spacerobot.result import Result
    from spacerobot.scene import Scene


@registered
class Gltf(ExportFormat):
    """Animation with meshes, materials and paths of tips."""

    name: ClassVar[str] = "gltf"
    place: ClassVar[float] = 40
    summary: ClassVar[str] = "animation with meshes, materials and tracks of tips, for Blender and the web"
    suffixes: ClassVar[tuple[str, ...]] = (".glb",)
    takes: ClassVar[tuple[Source, ...]] = ("result", "scene")

    def write(self, source: Result | Scene, path: Path, options: NoOptions) -> None:
        """Write a binary file; see :func:`spacerobot.exports.gltf_file.animation_file`."""
        from spacerobot.exports.gltf_file import animation_file

        del options
        path.write_bytes(animation_file(source))
