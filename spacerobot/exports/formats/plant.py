"""FMU: functional mock-up unit of a scene."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from pydantic import Field

from spacerobot.common.registry import registered
from spacerobot.common.section import Section
from spacerobot.exports.export_format import ExportFormat, Source

if TYPE_CHECKING:
    from spacerobot.scene import Scene


class PlantOptions(Section):
    """Options of the format ``plant``."""

    fmi: Literal[2, 3] = Field(default=3, description="version of the standard, 2 or 3")
    open: bool = Field(
        default=False, description="without controllers: the commands of all actuators are inputs"
    )
    vary: tuple[str, ...] = Field(
        default=(),
        description="dotted paths of numbers that are parameters although they are exactly zero: [PATH, ...]",
    )


@registered
class PlantFmu(ExportFormat):
    """FMU of the plant, including its events, for co-simulation."""

    name: ClassVar[str] = "plant"
    place: ClassVar[float] = 30
    summary: ClassVar[str] = "plant with its events as an FMU for co-simulation, Linux binary and C++ sources"
    suffixes: ClassVar[tuple[str, ...]] = (".fmu",)
    takes: ClassVar[tuple[Source, ...]] = ("scene",)
    options: ClassVar[type[Section]] = PlantOptions

    def write(self, source: Scene, path: Path, options: PlantOptions) -> None:
        """Compile and write the FMU."""
        from spacerobot.fmu import build_fmu

        path.write_bytes(build_fmu(source, fmi=options.fmi, is_open=options.open, vary=options.vary))
