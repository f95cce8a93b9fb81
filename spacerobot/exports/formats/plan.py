"""Tables of plans: CSV, and C arrays with a plan follower."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from spacerobot.common.registry import registered
from spacerobot.exports.export_format import ExportFormat, NoOptions, Source
from spacerobot.exports.formats.csv import Csv

if TYPE_CHECKING:
    from spacerobot.api.results import PlanResult


@registered
class PlanTable(ExportFormat):
    """Tables of a plan's times, positions, rates, torques and wrenches."""

    name: ClassVar[str] = "plan"
    place: ClassVar[float] = 61
    summary: ClassVar[str] = "a plan's points as CSV, and as C arrays with their follower; a folder"
    takes: ClassVar[tuple[Source, ...]] = ("plan",)

    def write(self, source: PlanResult, path: Path, options: NoOptions) -> None:
        """Write ``plan.csv``, ``plan.h`` and ``plan.c``."""
        from spacerobot.flightcode.plan_table import plan_sources

        path.mkdir()
        Csv().write(source, path / "plan.csv", options)
        for name, text in plan_sources(source.data).items():
            (path / name).write_text(text, encoding="utf-8")
