"""Flight code: C99 of a scenario's periodic controllers, estimators and detections."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from pydantic import Field

from spacerobot.common.registry import registered
from spacerobot.common.section import Section
from spacerobot.exports.export_format import ExportFormat, Source

if TYPE_CHECKING:
    from spacerobot.scene import Scene


class ControllerCodeOptions(Section):
    """Options of :class:`ControllerCode`."""

    precision: Literal["double", "float"] = Field(default="double", description="double or float")
    steps: int = Field(default=2000, ge=1, le=1_000_000, description="steps of the test vectors")


@registered
class ControllerCode(ExportFormat):
    """Periodic controllers, estimators, plan followers and detections as C99 with test vectors."""

    name: ClassVar[str] = "controller"
    place: ClassVar[float] = 60
    summary: ClassVar[str] = (
        "periodic controllers, estimators and detections as C99 with test vectors; a folder"
    )
    takes: ClassVar[tuple[Source, ...]] = ("scene",)
    options: ClassVar[type[Section]] = ControllerCodeOptions

    def write(self, source: Scene, path: Path, options: ControllerCodeOptions) -> None:
        """Write the folder of the flight code; see :func:`spacerobot.flightcode.package.write_package`."""
        from spacerobot.closedloop.loop_cache import cached_closed_loop
        from spacerobot.closedloop.onboard_ports import OnboardLoopBuilder
        from spacerobot.flightcode.extract import onboard_software
        from spacerobot.flightcode.flyable import prepared_scene
        from spacerobot.flightcode.package import write_package

        scene = prepared_scene(source)
        software = onboard_software(scene, cached_closed_loop(scene, kind=OnboardLoopBuilder))
        write_package(software, path, options.precision, options.steps)
