"""``python -m benchmarks.gallery_pictures [FILE ...]``: films and pictures of README and gallery."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from PIL import Image

from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from viz.recording.record import write_poster, write_recording

IMAGES = Path(__file__).parents[1] / "docs" / "images"
FILMS_PX = {"capture": (480, 300), "docking": (480, 290)}
"""Width and height [pixels] of the film of each scenario."""

PICTURE_PX, JPEG_QUALITY = (960, 540), 85
DRAWN_PX, PIXEL_RATIO = (1728, 972), 3.0
"""Size at which a picture is drawn before it is reduced, and how much larger than usual its texts are: on a
telephone it is 350 pixels wide."""


class Picture(NamedTuple):
    """Scenario of a picture and its time [s]; None is the first capture, or the middle without one."""

    scenario: str
    at: float | None = None


PICTURES = {
    "ssrms": Picture("ssrms"),
    "ets7": Picture("ets7"),
    "capture": Picture("capture"),
    "capture_held": Picture("capture", 29.0),
    "servicer-wheels": Picture("servicer-wheels", 9.0),
    "docking": Picture("docking", 16.7),
    "detumble": Picture("detumble", 1.0),
    "bounce": Picture("bounce"),
}
"""Pictures by the end of their files' names; the gallery names the same times."""


def main(*files: str) -> None:
    """Write films (``capture.gif``) and pictures (``space_ssrms.jpg``); all if none is named."""
    for name, size_px in FILMS_PX.items():
        if not files or f"{name}.gif" in files:
            result = simulate(load_scene(name))
            write_recording(result, IMAGES / f"{name}.gif", frames_per_s=5, speed=6, size_px=size_px)
    for name, (scenario, at) in PICTURES.items():
        if not files or f"space_{name}.jpg" in files:
            with tempfile.TemporaryDirectory() as folder:
                poster = Path(folder) / "poster.png"
                write_poster(
                    simulate(load_scene(scenario)), poster, at=at, size_px=DRAWN_PX, pixel_ratio=PIXEL_RATIO
                )
                picture = Image.open(poster).convert("RGB").resize(PICTURE_PX, Image.Resampling.LANCZOS)
            picture.save(IMAGES / f"space_{name}.jpg", quality=JPEG_QUALITY, optimize=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
