"""CSV: comma-separated values of all signals."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from spacerobot.common.registry import registered
from spacerobot.exports.export_format import ExportFormat, NoOptions, Source
from spacerobot.exports.signals import signals

if TYPE_CHECKING:
    from spacerobot.api.results import PlanResult
    from spacerobot.result import Result


@registered
class Csv(ExportFormat):
    """Table with a column for each signal."""

    name: ClassVar[str] = "csv"
    place: ClassVar[float] = 10
    summary: ClassVar[str] = "every signal as a column, units in the heading"
    suffixes: ClassVar[tuple[str, ...]] = (".csv",)
    takes: ClassVar[tuple[Source, ...]] = ("result", "plan")

    def write(self, source: Result | PlanResult, path: Path, options: NoOptions) -> None:
        """Write a row for each sample (RFC 4180), with enough digits to reproduce every number."""
        del options
        columns = list(signals(source.data))
        with path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["time [s]", *(f"{signal.name} [{signal.unit}]" for signal in columns)])
            times = source.data.time.values.tolist()
            writer.writerows(zip(times, *(signal.values.tolist() for signal in columns), strict=True))
