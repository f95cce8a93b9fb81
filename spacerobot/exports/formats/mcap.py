"""MCAP: robot logs for Foxglove, Rerun and ROS 2."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from pydantic import Field

from spacerobot.common.optional import optional_module
from spacerobot.common.registry import registered
from spacerobot.common.section import Section
from spacerobot.exports.export_format import ExportFormat

if TYPE_CHECKING:
    from spacerobot.result import Result

EPOCH = datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)


class McapOptions(Section):
    """Options of MCAP files."""

    ros2: bool = Field(default=False, description="messages of ROS 2 instead of Foxglove's schemas")
    start: datetime.datetime = Field(default=EPOCH, description="UTC time of the beginning, ISO 8601")

    def nanoseconds(self, time_s: float) -> int:
        """Log time [ns since 1970] of a simulation time [s]."""
        start = self.start if self.start.tzinfo else self.start.replace(tzinfo=datetime.UTC)
        return (start - EPOCH) // datetime.timedelta(microseconds=1) * 1000 + round(time_s * 1e9)


@registered
class Mcap(ExportFormat):
    """Log of transforms, shapes, events and all signals."""

    name: ClassVar[str] = "mcap"
    place: ClassVar[float] = 20
    summary: ClassVar[str] = "transforms, shapes, events and every signal, for Foxglove, Rerun and ROS 2"
    suffixes: ClassVar[tuple[str, ...]] = (".mcap",)
    options: ClassVar[type[Section]] = McapOptions

    def write(self, source: Result, path: Path, options: McapOptions) -> None:
        """Write the messages of all samples, and the scenario as an attachment."""
        from spacerobot.scenario.load import to_yaml

        writers = optional_module("mcap.writer", "mcap", "the format mcap")
        with path.open("wb") as file:
            writer = writers.Writer(file)
            writer.start(profile="ros2" if options.ros2 else "", library="spacerobot")
            begin = options.nanoseconds(0.0)
            text = to_yaml(source.scenario).encode()
            writer.add_attachment(begin, begin, "scenario.yaml", "application/yaml", text)
            if options.ros2:
                from spacerobot.exports import ros2_messages

                ros2_messages.write_messages(source, writer, options.nanoseconds)
            else:
                from spacerobot.exports import foxglove_messages

                foxglove_messages.write_messages(source, writer, options.nanoseconds)
            writer.finish()
