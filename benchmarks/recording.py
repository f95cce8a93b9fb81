"""Processor time of recordings of 20 s of the servicer, all processes together."""

from __future__ import annotations

import tempfile
from pathlib import Path

from benchmarks.process_tree import spent_s
from benchmarks.table_row import Row
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from viz.recording.browser import program
from viz.recording.record import USUAL, write_recording

MOST_S = {".mp4": 40.0, ".gif": 10.0}


def rows() -> list[Row]:
    """One row for each format, with its default settings."""
    if program() is None:
        return [Row("recordings of the servicer", "", "", note="not measured: no Chromium here")]
    result, table = simulate(load_scene("servicer")), []
    with tempfile.TemporaryDirectory() as folder:
        for kind, most in MOST_S.items():
            path, (per_s, (width, height)) = Path(folder) / f"servicer{kind}", USUAL[kind]
            processor_s = spent_s(lambda path=path: write_recording(result, path))
            form = f"{kind[1:].upper()}, {width} x {height}, {per_s:g} pictures a second"
            what = (
                f"recording of 20 s of the servicer, {form}",
                "processor time of Python, Chromium and ffmpeg",
            )
            size = f"{path.stat().st_size / 1e6:.1f} MB; drawn in software"
            ratio = processor_s / most
            cells = f"{processor_s:.1f} s", f"{most:g} s", ratio, "at most 1", ratio <= 1, size
            table.append(Row(*what, *cells, {"processor_s": processor_s}))
    return table
