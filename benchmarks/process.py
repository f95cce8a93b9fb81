"""Times of ``spacerobot run paper`` from process start to files on disk, and of its parts."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.table_row import Row
from benchmarks.timing import time_of

RUNS = 5


def rows() -> list[Row]:
    """Rows of the whole process with a warm cache, of commands' processor times, and of the import."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "paper"
        command = [str(Path(sys.executable).with_name("spacerobot")), "run", "paper", "--out", str(out)]
        if not Path(command[0]).exists():
            program = "from spacerobot.cli.app import main; main()"
            command = [sys.executable, "-c", program, *command[1:]]
        before = children_s()
        median_s = statistics.median(_run(command) for _ in range(RUNS))
        busy = (children_s() - before) / RUNS
        timing = json.loads((out / "summary.json").read_text(encoding="utf-8"))["timing_s"]
        run_row = _start("`spacerobot run paper`, processor time", command, 6.5)
    bare = statistics.median(_run([sys.executable, "-c", "import spacerobot"]) for _ in range(RUNS))
    python = statistics.median(_run([sys.executable, "-c", "pass"]) for _ in range(RUNS))
    inside = ("closed_loop", "compile_or_load", "rollout")
    parts = ", ".join(f"{name.replace('_', ' ')} {timing[name]:.2f} s" for name in inside)
    rest = median_s - sum(timing[name] for name in inside)
    return [
        Row(
            "`spacerobot run paper`, process start to files",
            "",
            f"{median_s:.2f} s",
            note=f"{parts}, imports and files {rest:.2f} s; {busy:.2f} s of processor time",
            numbers={"timing_s": timing, "processor_s": busy},
        ),
        run_row,
        _start("`spacerobot --help`, processor time", [sys.executable, "-m", "spacerobot", "--help"], 1.4),
        Row("`import spacerobot`", "bare Python", f"{bare * 1e3:.0f} ms", f"{python * 1e3:.0f} ms"),
    ]


def _start(what: str, command: list[str], most: float) -> Row:
    """Row of the smallest processor time of a command against that of importing its libraries, in turns."""
    bare = [sys.executable, "-c", "import numpy, casadi, pinocchio"]
    ours, theirs = (
        min(times) for times in zip(*((_busy(command), _busy(bare)) for _ in range(RUNS)), strict=True)
    )
    ratio = ours / theirs
    texts = f"{ours:.2f} s", f"{theirs:.2f} s"
    return Row(what, "import numpy, casadi, pinocchio", *texts, ratio, f"at most {most:g}", ratio <= most)


def _busy(command: list[str]) -> float:
    before = children_s()
    _run(command)
    return children_s() - before


def children_s() -> float:
    """Processor time of all child processes that have ended and been waited for [s]."""
    times = os.times()
    return times.children_user + times.children_system


def _run(command: list[str]) -> float:
    # as for a user, imported modules have been compiled to bytecode before
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return time_of(lambda: subprocess.run(command, check=True, capture_output=True, env=environment))
