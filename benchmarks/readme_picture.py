"""``python -m benchmarks.readme_picture [FILE]``: record a simulated docking for the gallery."""

from __future__ import annotations

import sys
from pathlib import Path

from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from viz.recording.record import write_recording

TARGET = Path(__file__).parents[1] / "docs" / "images" / "docking.gif"


def main(target: Path = TARGET) -> None:
    """Write the recording."""
    result = simulate(load_scene("docking"))
    write_recording(result, target, frames_per_s=5, speed=6, size_px=(480, 290))


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
