"""Processor time of recordings of the servicer, 20 s, all processes together."""

from __future__ import annotations

import tempfile
from pathlib import Path

from benchmarks.process_tree import spent_s
from benchmarks.table_row import Row
from spacerobot.result import Result
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from viz.browser import program
from viz.record import USUAL, write_recording

MOST_S = {".mp4": 40.0, ".gif": 10.0}


def rows() -> list[Row]:
    """A row for each format, as it is recorded if nothing else is said."""
    if program() is None:
        return [Row("recordings of the servicer", "", "", note="not measured: no Chromium here")]
    result = simulate(load_scene("servicer"))
    with tempfile.TemporaryDirectory() as folder:
        return [_row(result, Path(folder) / f"servicer{kind}", most) for kind, most in MOST_S.items()]


def _row(result: Result, path: Path, most: float) -> Row:
    spent = spent_s(lambda: write_recording(result, path))
    per_s, (width, height) = USUAL[path.suffix]
    form = f"{path.suffix[1:].upper()}, {width} x {height}, {per_s:g} pictures a second"
    return Row(
        f"recording of 20 s of the servicer, {form}",
        "processor time of Python, Chromium and ffmpeg",
        f"{spent:.1f} s",
        f"{most:g} s",
        spent / most,
        "at most 1",
        spent <= most,
        f"{path.stat().st_size / 1e6:.1f} MB; drawn in software",
        {"processor_s": spent},
    )
