"""``python -m benchmarks.readme_picture [SCENARIO ...]``: record the films of the README and the gallery."""

from __future__ import annotations

import sys
from pathlib import Path

from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from viz.recording.record import write_recording

IMAGES = Path(__file__).parents[1] / "docs" / "images"
SIZES_PX = {"capture": (480, 300), "docking": (480, 290)}


def main(*names: str) -> None:
    """Write the recordings of scenarios; all if none is named."""
    for name in names or SIZES_PX:
        result = simulate(load_scene(name))
        write_recording(result, IMAGES / f"{name}.gif", frames_per_s=5, speed=6, size_px=SIZES_PX[name])


if __name__ == "__main__":
    main(*sys.argv[1:])
