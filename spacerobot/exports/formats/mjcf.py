"""MJCF: a scene in MuJoCo's format."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from pydantic import Field

from spacerobot.common.registry import registered
from spacerobot.common.section import Section
from spacerobot.exports.export_format import ExportFormat, Source

if TYPE_CHECKING:
    from spacerobot.scene import Scene


class MjcfOptions(Section):
    """Options of MJCF."""

    visuals: bool = Field(default=True, description="write shapes that are only seen")


@registered
class Mjcf(ExportFormat):
    """Bodies, joints, grasps, contacts and motors of a scene."""

    name: ClassVar[str] = "mjcf"
    place: ClassVar[float] = 30
    summary: ClassVar[str] = "bodies, joints, grasps, contacts and motors for MuJoCo, with the initial state"
    suffixes: ClassVar[tuple[str, ...]] = (".xml", ".mjcf")
    takes: ClassVar[tuple[Source, ...]] = ("scene",)
    options: ClassVar[type[Section]] = MjcfOptions

    def write(self, source: Scene, path: Path, options: MjcfOptions) -> None:
        """Write a file whose keyframe ``initial`` is the initial state."""
        from spacerobot.exports.mjcf_scene import scene_file

        path.write_bytes(scene_file(source, visuals=options.visuals))
