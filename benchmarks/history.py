"""Results kept with date, machine and commit, so that a regression shows."""

from __future__ import annotations

import datetime
import json
import os
import platform
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.table_row import Row
from spacerobot.compiled import find_toolchain

HISTORY = Path(__file__).with_name("history.jsonl")
CPU = ("model name", "cpu family", "model")
REGRESSION = 1.1
"""Factor by which a ratio may worsen before it is reported: quiet runs scatter by less."""


def machine() -> dict[str, Any]:
    """The processor by its maker's name where Linux states it, cores, Python and compiler."""
    toolchain, info = find_toolchain(), Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    fields = {
        key.strip(): value.strip() for key, _, value in (line.partition(":") for line in reversed(lines))
    }
    parts = [fields[key] if key == "model name" else f"{key} {fields[key]}" for key in CPU if key in fields]
    return {
        "processor": ", ".join(parts) or platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "toolchain": toolchain.summary if toolchain else "none",
    }


def load_average() -> float | None:
    """Load average of the last quarter of an hour; None where there is none, as on Windows."""
    return os.getloadavg()[2] if hasattr(os, "getloadavg") else None


def load_words() -> str:
    """The same at the end of a line about the machine."""
    load = load_average()
    return "" if load is None else f", load {load:.1f}"


def commit() -> str:
    """Measured commit, marked `dirty` if files differ from it."""
    command = ["git", "describe", "--always", "--dirty"]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()


def previous(measured_on: Mapping[str, Any], path: Path = HISTORY) -> dict[str, float]:
    """Latest kept ratio of each row on machines of the same kind."""
    latest_ratios: dict[str, float] = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
        entry = json.loads(line)
        if all(entry["machine"].get(key) == measured_on[key] for key in ("processor", "cores")):
            latest_ratios |= entry["ratios"]
    return latest_ratios


def regressions(rows: Sequence[Row], before: Mapping[str, float]) -> list[str]:
    """Rows whose ratio is worse than the kept one, in words."""
    slower = []
    for row in rows:
        name = f"{row.what} / {row.against}"
        if row.ratio is None or name not in before:
            continue
        change = row.ratio / before[name]
        larger_is_better = "faster" in row.target or "at least" in row.target
        worse = 1 / change if larger_is_better else change
        if worse > REGRESSION:
            slower.append(f"{name}: ratio {row.ratio:.3g}, kept {before[name]:.3g}")
    return slower


def keep(rows: Sequence[Row], measured_on: Mapping[str, Any], path: Path = HISTORY) -> None:
    """Append an entry with today's date, the measured commit, and the load average.

    A load average of the last quarter of an hour above the cores marks the machine as shared: ratios scatter
    more then.
    """
    ratios = {f"{row.what} / {row.against}": row.ratio for row in rows if row.ratio is not None}
    date = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    entry: dict[str, Any] = {"date": date, "commit": commit(), "machine": dict(measured_on), "ratios": ratios}
    if (load := load_average()) is not None:
        entry |= {"load_average": round(load, 1), "shared": load > (os.cpu_count() or 1)}
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(entry) + "\n")
